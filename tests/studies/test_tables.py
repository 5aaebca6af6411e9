"""Tables and sentences of the studies of a user's scene, from rows with known numbers."""

import numpy as np
import pytest

from studies.models.__main__ import describe_distances, distance_table
from studies.stability.cases import ALL, BLOWN, STABLE
from studies.stability.tables import describe_result, largest_steps

STEPS = {4: 0.025, 8: 0.0125, 512: 4.9e-5}  # steps: dt [s]


def cells(method, outcomes, **more):
    """Return the cells of a method: the outcome of each number of steps; None for an error."""
    rows = []
    for steps, outcome in outcomes.items():
        row = {"scene": "mine", "over": "stiffness", "stiffness": 1.0, "limit": None, **more}
        row |= {"method": method, "steps": steps, "status": "ok" if outcome else "error"}
        rows.append(row | ({"dt": STEPS[steps], "outcome": outcome} if outcome else {}))
    return rows


def test_steps_beyond_what_was_tried_are_ranges():
    rows = cells("bdf2", {4: STABLE, 8: STABLE}) + cells("newmark", {4: STABLE, 8: STABLE})
    rows += cells("central_difference", {4: BLOWN, 512: BLOWN}, limit=3e-5)
    rows += cells("backward_euler", {4: BLOWN, 8: STABLE}) + cells("implicit_midpoint", {8: None})
    (line,) = largest_steps(rows, (STABLE,))
    assert line["bdf2"] == line["newmark"] == "≥ 25 ms"
    assert line["central_difference"] == "< 49 µs (predicted 30 µs)"
    assert line["backward_euler"] == "12.5 ms"
    assert line["implicit_midpoint"] == line["energy_momentum"] == "-"
    words = describe_result(rows)
    assert words == (
        "- mine: newmark, bdf2 are right up to 25 ms, the largest step that was tried."
    )
    assert list(ALL).index("newmark") < list(ALL).index("bdf2")


def test_methods_that_are_never_right_have_no_best_step():
    rows = cells("bdf2", {4: BLOWN}) + cells("newmark", {4: None})
    assert (
        describe_result(rows) == "- mine: no method is right at any of the steps that were tried."
    )


def test_distances_of_models_are_relative_to_the_displacement():
    start = np.zeros((4, 3))
    ends = {"StVK": start + [0, 0, 0.2], "Springs": start + [0, 0, 0.21], "NeoHookean": start + 0.2}
    rows = [
        {"model": model, "status": "ok", "x": x.ravel(), "start": start.ravel(), "cpu_seconds": 1.0}
        for model, x in ends.items()
    ]
    table = {line["model"]: line for line in distance_table(rows)}
    assert table["Springs"]["rms distance [%]"] == pytest.approx(5.0)
    assert table["Springs"]["rms distance [m]"] == pytest.approx(0.01)
    assert table["NeoHookean"]["largest [%]"] == pytest.approx(100 * np.sqrt(2))
    words = describe_distances(rows)
    assert words.startswith("Springs ends 5 % of the displacement away from StVK; NeoHookean ends")
    failed = [rows[0] | {"status": "failed"}, *rows[1:]]
    assert "nothing to compare" in describe_distances(failed)
