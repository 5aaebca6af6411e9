"""The record that the studies of validation share."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import trapezoid

import fecloth as fc
from fecloth.simulation.quantity import parse_quantity
from fecloth.study.budgeting.result import make_budget
from fecloth.terms.membranes.curves import Curve
from studies.validation import __main__ as every
from studies.validation.bias.__main__ import WIDTH, net_angle, net_force, stress
from studies.validation.comparison import (
    PARTS,
    Comparison,
    from_budget,
    table,
)
from studies.validation.knits import joint_covariance, uncertainty_table

NUMBERS = dict(zip(PARTS, (1.0, 2.0, 4.0, 6.0, 8.0, 12.0), strict=True))  # of squares 265


def compared(measured: float, **changes) -> Comparison:
    given = {"predicted": 100.0, "measured": measured, **NUMBERS, **changes}
    return Comparison("folder", "strip", "force", "N", **given)


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
    (row,) = table([inside, compared(0.0, kind="shown"), compared(0.0, kind="fitted")])
    assert row["agrees"] == "yes"
    assert row["quantity"] == "force [N]"
    assert row["predicted"] == "100 ± 11"
    (row,) = table([outside])
    assert row["difference"].startswith(f"{sign * 41:+d} ± 16 (")
    assert row["agrees"] == "**no**"
    assert outside.difference == pytest.approx(1.25 * sign * limit)


def test_an_unknown_part_gives_no_agreement():
    assert not compared(100.0, start=math.nan).agrees


def test_a_budget_gives_its_parts():
    opened = SimpleNamespace(name="strip", first=SimpleNamespace(energies=()))
    text, known = "reaction.right.x", {"value": 50.0, "space": 1.0, "time": 2.0, "solver": 3.0}
    known |= {"input": 4.0, "start": 5.0}
    measured = {text: (90.0, 6.0)}
    asked = [parse_quantity(text)]
    answer = make_budget(opened, asked, known, measured, [], np.zeros((0, 0)), is_single=True)
    (each,) = from_budget(answer, "folder", "strip", {text: "force"})
    expected = {**known, "scatter": 6.0, "predicted": known["value"], "measured": 90.0}
    assert {name: getattr(each, name) for name in (*PARTS, "predicted", "measured")} == {
        name: expected[name] for name in (*PARTS, "predicted", "measured")
    }
    assert (each.quantity, each.unit, each.kind) == ("force", "N", "predicted")
    assert each.total == pytest.approx(answer.total)
    assert each.difference == answer.difference
    assert each.agrees == answer.agrees


def test_the_force_of_a_net_is_the_slope_of_its_energy():
    """Of W (L − 3 W/2) ∫ τ dγ up to γ, and W² of it up to γ/2; L = 3 W."""
    stiffness = [150.0, 60.0, 20.0, 30.0, 60.0, 150.0, 400.0, 1000.0]
    angles = [0.03, 0.12, 0.3, 0.5, 0.65, 0.8, 0.9, 1.0]
    curve = Curve.through(
        "shear", fc.MembraneTable(shear={"angle": angles, "stiffness": stiffness}).shear
    )

    def energy(drawn: float) -> float:
        def work(gamma: float) -> float:  # ∫ τ dγ with τ = S cos γ at E = sin γ
            g = np.linspace(0.0, gamma, 20001)
            return float(trapezoid(stress(curve, np.sin(g)) * np.cos(g), g))

        gamma = float(net_angle(np.array([drawn]))[0])
        return WIDTH**2 * (1.5 * work(gamma) + work(gamma / 2))

    slope = (energy(0.0801) - energy(0.0799)) / 2e-4
    assert net_force(np.array([0.08]), stiffness)[0] == pytest.approx(slope, rel=1e-5)


def test_covariance_of_fitted_and_given_numbers():
    """Fitted y = own noise + A p with independent p: V = [own + A Vp Aᵀ, A Vp; Vp Aᵀ, Vp]."""
    own = np.array([[4.0, 1.0], [1.0, 9.0]])
    A, u = np.array([[2.0, -1.0], [0.5, 3.0]]), np.array([0.2, 0.4])
    V = joint_covariance(own, (A * u).T, u)
    Vp = np.diag(u**2)
    np.testing.assert_allclose(V, np.block([[own + A @ Vp @ A.T, A @ Vp], [Vp @ A.T, Vp]]))
    fabric = fc.Fabric(0.3, (300.0, 200.0), 0.35, 80.0, uncertainty=uncertainty_table(V))
    np.testing.assert_allclose(
        fabric.uncertainty.covariance(
            fabric,
            ["tensile_stiffness.0", "tensile_stiffness.1", "shear_stiffness", "poisson_ratio"],
        ),
        V,
    )


def test_the_page_has_the_predictions_of_all_folders():
    page = (every.HERE / "README.md").read_text(encoding="utf-8")
    assert page == every.write_page(every.left_out(), every.predictions())
    folders = {path.parent.name for path in every.HERE.glob("*/comparison.csv")}
    assert folders == set(every.FOLDERS)
