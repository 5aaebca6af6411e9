"""`Answer` in words and in summary.json, and what is no number."""

import math

import numpy as np
import pytest

import fecloth as fc
from fecloth.simulation.account import Accounts
from fecloth.simulation.answer import answer_quantities, list_answers, places_of, refining_command
from fecloth.simulation.quantity import parse_quantity
from fecloth.simulation.quantity_values import RunRecord
from fecloth.simulation.time_error import TimeError

REFINING = ("fecloth", "converge", "my cloth.toml")
KNOWN = fc.Answer(0.5, 0.02, {"time": 0.02}, "m", (0.6, 0.1))
UNKNOWN = fc.Answer(0.5, parts={"solver": 1e-9}, unit="m")
PURE = fc.Answer(5.0)
NONE = fc.Answer(math.nan, unit="s")


def test_an_unknown_error_names_the_command_as_a_shell_reads_it():
    words = "fecloth converge 'my cloth.toml' --quantity 'max tip.z'"
    assert refining_command("max tip.z", UNKNOWN, REFINING) == words
    for answer in (KNOWN, NONE):
        assert refining_command("tip.z", answer, REFINING) == ""
    assert refining_command("tip.z", UNKNOWN, ()) == ""


def test_lines_have_name_value_unit_error_and_what_was_measured():
    answers = {"tip.z": KNOWN, "sag": UNKNOWN, "folds": PURE, "period of tip.z": NONE}
    first, second, third, last = list_answers(answers, ())
    assert first == "tip.z            0.500 ± 0.020 m (time); measured 0.60 ± 0.10 m"
    assert second == "sag              0.5 m ± not known (solver 1e-09 m)"
    assert third == "folds            5 ± not known"
    assert last == "period of tip.z  no value in this run"


def test_entries_of_summary_json_have_none_for_what_is_not_known():
    entry = {"value": 0.5, "uncertainty": None, "parts": {"solver": 1e-9}, "unit": "m"}
    assert UNKNOWN.entry() == entry
    assert KNOWN.entry()["measured"] == [0.6, 0.1]
    assert NONE.entry()["value"] is None


def error_in_time(relative, moved):
    error = TimeError(np.zeros((3, 3)), (0.0, 0), None, moved, relative=relative)
    return Accounts({TimeError.name: error})


def record():
    times = np.linspace(0.0, 1.0, 5)
    columns = {f"tip.{axis}": values * times for axis, values in zip("xyz", (0, 3, 4), strict=True)}
    columns |= {"sag": 0.1 * times, "StVK": times, "least_distance:SelfContact": times + np.inf}
    return RunRecord(times, columns, probes=("tip",), energies=("StVK",))


@pytest.mark.parametrize(
    ("text", "value", "time"),
    [
        ("tip.y", 3.0, 0.01 * 5.0),  # the tip moves 5 m, the mean of the cloth 2 m
        ("tip.z at 0.5 s", 2.0, 0.01 * 5.0),
        ("tip", 5.0, 0.01 * 5.0),
        ("sag", 0.1, 0.01 * 2.0),
        ("StVK", 1.0, None),
        ("reaction.left.x", 0.0, None),
        ("least_distance.SelfContact", None, 0.01 * 2.0),
    ],
)
def test_the_error_in_time_scales_with_what_moves_further(text, value, time):
    quantity = parse_quantity(text)
    accounts = error_in_time(relative=0.01, moved=2.0)
    with np.errstate(invalid="ignore"):
        (answer,) = answer_quantities([quantity], record(), accounts, {}).values()
    assert answer.value == value or (value is None and math.isnan(answer.value))
    assert answer.parts == ({} if time is None else {"time": pytest.approx(time)})
    assert math.isnan(answer.uncertainty) == (time is None)


@pytest.mark.parametrize("relative", [math.nan, 0.51])
def test_an_error_that_is_not_resolved_is_not_known(relative):
    accounts = error_in_time(relative, moved=2.0)
    (answer,) = answer_quantities([parse_quantity("tip.z")], record(), accounts, {}).values()
    assert math.isnan(answer.uncertainty)
    assert answer.parts == {}


def test_probes_answer_where_they_are_and_columns_by_name():
    probes = [fc.Probe("corner at left", "left"), "line_force:left.x", "folds"]
    names = [f"corner at left.{axis}" for axis in "xyz"]
    assert [str(q) for q in places_of(probes)] == [*names, "line_force.left.x", "folds"]
    assert [q.column for q in places_of(probes)][3:] == ["line_force:left.x", "folds"]
