"""The record that the studies of validation share."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

import fecloth as fc
from fecloth.simulation.quantity import parse_quantity
from fecloth.study.budgeting.result import make_budget
from studies.validation.comparison import (
    COLUMNS,
    PARTS,
    Comparison,
    from_budget,
    read_comparisons,
    write_comparisons,
)

NUMBERS = dict(zip(PARTS, (1.0, 2.0, 4.0, 6.0, 8.0, 12.0), strict=True))  # of squares 265


def compared(measured: float, **changes) -> Comparison:
    given = {"predicted": 100.0, "measured": measured, **NUMBERS, **changes}
    return Comparison("folder", "strip", "force", "N", **given)


def test_the_total_is_the_root_of_the_sum_of_squares():
    assert compared(90.0).total == pytest.approx(math.sqrt(265), rel=1e-14)
    assert compared(90.0).own == pytest.approx(math.sqrt(121), rel=1e-14)


@pytest.mark.parametrize("name", PARTS)
def test_each_part_counts_in_the_total(name):
    alone = Comparison("folder", "strip", "force", "N", 1.0, **{name: 3.0})
    assert alone.total == 3.0
    assert alone.own == (0.0 if name == "scatter" else 3.0)


@pytest.mark.parametrize("sign", [-1, 1])
def test_agrees_at_a_part_of_twice_the_total(sign):
    limit = 2 * math.sqrt(265)
    inside, outside = compared(100 - 0.8 * sign * limit), compared(100 - 1.25 * sign * limit)
    assert inside.agrees
    assert not outside.agrees
    assert "agrees within twice its uncertainty of 16" in inside.sentence()
    assert "of which 12 are of the measurement" in inside.sentence()
    assert f"the law is wrong by {sign * 41:+d} ± 16 N" in outside.sentence("law")
    assert outside.difference == pytest.approx(1.25 * sign * limit)


def test_there_is_no_verdict_without_a_measurement():
    for each in (compared(math.nan, scatter=0.0), compared(0.0, kind="shown")):
        assert each.agrees is None
        assert each.row()["agrees"] == ""
    assert "was not measured" in compared(math.nan).sentence()


def test_an_unknown_part_gives_no_agreement():
    assert not compared(100.0, start=math.nan).agrees
    assert "not known" in compared(100.0, start=math.nan).sentence()


@pytest.mark.parametrize("changes", [{"kind": "guess"}, {"space": -1.0}])
def test_wrong_records_are_refused(changes):
    with pytest.raises(fc.InputError):
        compared(1.0, **changes)


def test_another_unit_has_the_same_verdict():
    each = compared(110.0).scaled(1e3, "mN")
    assert each.difference == pytest.approx(-1e4)
    assert each.total == pytest.approx(1e3 * math.sqrt(265))


def test_a_file_is_read_as_it_was_written(tmp_path):
    both = [compared(71.3), compared(math.nan, scatter=0.0, kind="shown")]
    write_comparisons(tmp_path, both)
    header = (tmp_path / "comparison.csv").read_text().splitlines()[0]
    assert header == ",".join(COLUMNS)
    first, second = read_comparisons(tmp_path / "comparison.csv")
    assert first == both[0]
    assert second.row() == both[1].row()


def test_a_budget_gives_its_parts():
    opened = SimpleNamespace(name="strip", first=SimpleNamespace(energies=()))
    text, known = "reaction.right.x", {"value": 50.0, "space": 1.0, "time": 2.0, "solver": 3.0}
    known |= {"input": 4.0, "start": 5.0}
    measured = {text: (90.0, 6.0)}
    asked = [parse_quantity(text)]
    answer = make_budget(opened, asked, known, measured, [], np.zeros((0, 0)), single=True)
    (each,) = from_budget(answer, "folder", "strip", {text: "force"})
    expected = {**known, "scatter": 6.0, "predicted": known["value"], "measured": 90.0}
    assert {name: getattr(each, name) for name in (*PARTS, "predicted", "measured")} == {
        name: expected[name] for name in (*PARTS, "predicted", "measured")
    }
    assert (each.quantity, each.unit, each.kind) == ("force", "N", "predicted")
    assert each.total == pytest.approx(answer.total)
    assert each.difference == answer.difference
    assert each.agrees == answer.agrees
