"""The drape test of `studies.validation.drape`: its fabrics, starts and parts by hand."""

import math

import numpy as np
import pytest

from studies.validation.drape.cases import list_cases
from studies.validation.drape.parts import predict
from studies.validation.drape.specimen import (
    DENSITY,
    HEIGHT,
    SPECIMEN,
    SUPPORT,
    UNCERTAIN,
    H,
    lift,
    make_fabric,
)

WOOL = "wool tropical"


def test_kes_numbers_become_a_fabric():
    fabric = make_fabric(WOOL)
    assert fabric.areal_density == pytest.approx(0.1629)
    assert fabric.bending[0] == pytest.approx(0.067 * 9.80665e-5)
    assert fabric.hysteresis[1] == pytest.approx(0.033 * 9.80665e-3)
    assert fabric.bias_rigidity == fabric.bending[0]


def rim_and_support(count=720):
    angle = 2 * math.pi * np.arange(count) / count
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    return np.concatenate([SPECIMEN * circle, SUPPORT * circle])


def test_a_start_is_flat_on_the_support_and_1_mm_high_at_the_rim():
    X = rim_and_support()
    for start in (1, 2):
        x = lift(X, start)
        assert np.abs(x[720:, 2]).max() < 1e-12 * HEIGHT
        assert np.abs(x[:720, 2]).max() == pytest.approx(HEIGHT, rel=1e-3)
    assert np.abs(lift(X, 1) - lift(X, 2)).max() > 0.1 * HEIGHT


def made_up(case):
    """A row whose coefficient is known: linear in the start, h², load steps, factor and support."""
    points = 40 + 2 * case["start"] + 1e4 * case["h"] ** 2
    points += {"bending_rigidity": 3, "shear_stiffness": -1, "bias_rigidity": 2}.get(
        case.get("key"), 0
    ) * math.log(case.get("factor", 1.0))
    points += 0.5 * (case.get("steps", 20) == 40) + 2.0 * (case.get("support") == "disks")
    values = {"coefficient": points, "folds": 4 + case["start"] % 2}
    if case["model"] == "friction":
        values = {f"{end}_{k}": v for end in ("laid", "shaken") for k, v in values.items()}
    return case | values | {"status": "ok"}


@pytest.mark.parametrize("end", ["elastic", "laid"])
def test_parts_of_made_up_rows(end):
    p = predict([made_up(case) for case in list_cases([WOOL])], WOOL, end)
    assert p.value == pytest.approx(40 + 2 * 3 + 1e4 * H[-1] ** 2)
    # Order 2 is found, so the uncertainty is 1.25 times the error of the mesh; half of it counts.
    assert p.space == pytest.approx(0.5 * 1.25 * 1e4 * H[-1] ** 2)
    assert p.start == pytest.approx(2 * math.sqrt(2.5))
    assert p.steps == pytest.approx(0.5)
    assert p.support == pytest.approx(2 / math.sqrt(3))
    assert p.constants["bending_rigidity"] == pytest.approx(3 * math.log(1.1))
    assert p.constants["shear_stiffness"] == pytest.approx(-math.log(2.0))
    assert p.mass == pytest.approx(DENSITY * (3 - 1))
    stiff = (
        (3 * math.log(1.1)) ** 2
        + math.log(2.0) ** 2
        + (2 * math.log(UNCERTAIN["bias_rigidity"])) ** 2
    )
    squares = stiff + p.mass**2 + p.support**2
    assert p.input == pytest.approx(math.sqrt(squares))
    assert p.folds == [5, 4, 5, 4, 5]


def test_a_prediction_agrees_within_twice_its_total():
    p = predict([made_up(case) for case in list_cases([WOOL])], WOOL, "laid")
    total = p.coefficient(p.value).total
    assert p.coefficient(p.value - 1.9 * total).agrees is True
    assert p.coefficient(p.value - 2.1 * total).agrees is False
    assert p.number_of_folds(5).agrees is None
