"""Drag: the force on a plate, and its terminal speed."""

import numpy as np
import pytest
from conftest import affine, flat, rough
from support.tiers import stories_except

import fecloth as fc
from fecloth.integrators import METHODS
from fecloth.verify import observed_order

# steps are coarse and meshes small by intent
pytestmark = pytest.mark.filterwarnings("ignore::fecloth.errors.FeclothWarning")

LAWS = ("linear", "quadratic")
TIGHT = fc.Newton(tolerance=1e-12)
G, RHO = 9.81, 0.2


def square(w, law):
    """|w| w or w."""
    return np.linalg.norm(w) * w if law == "quadratic" else w


# --- force and tangents ---------------------------------------------------------------------------


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("pattern", ["unstructured", "cross"])
def test_a_plate_that_moves_without_turning(pattern, law, isotropic):
    """The force is the closed form for the deformed area, and acts at the centre."""
    cloth = fc.Cloth.rectangle(1.0, 0.6, h=0.17, pattern=pattern)
    F = np.array([[1.1, 0.3], [0.0, 0.9], [0.2, -0.4]])
    area = 0.6 * np.cross(F[:, 0], F[:, 1])
    size = np.linalg.norm(area)
    n, v, u = area / size, np.array([1.0, -2.0, 3.0]), np.array([4.0, 0.5, 0.0])
    for term, w in ((fc.Drag(0.7, 0.2, law), v), (fc.Wind(tuple(u), 0.7, 0.2, law), v - u)):
        across = np.dot(w, n) * n
        expected = -size * (0.7 * square(across, law) + 0.2 * square(w - across, law))
        system = fc.System(cloth, isotropic, [term])
        x = affine(cloth, F)
        force = system.force(system.state(x, np.tile(v, (len(x), 1))))
        np.testing.assert_allclose(force.sum(axis=0), expected, rtol=1e-12)
        moment = np.cross(F @ [0.5, 0.3], expected)
        np.testing.assert_allclose(np.cross(x, force).sum(axis=0), moment, rtol=1e-11)


# --- closed forms ---------------------------------------------------------------------------------


@pytest.mark.stories
@pytest.mark.parametrize("law", LAWS)
def test_fall_of_a_level_plate_to_its_terminal_velocity(law, sheet, isotropic):
    """ρ v′ = ρ g − k vᵖ: v = v∞ tanh(g t/v∞) with v∞ = √(ρ g/k), or v∞ (1 − e^(−k t/ρ))."""
    k = 0.7
    system = fc.System(sheet, isotropic, [fc.StVK(), fc.Drag(k, 0.1, law), fc.Gravity()])
    if law == "quadratic":
        limit = np.sqrt(RHO * G / k)
        exact = limit * np.tanh(G * 0.2 / limit)
    else:
        limit = RHO * G / k
        exact = -limit * np.expm1(-k / RHO * 0.2)

    def speeds(method, dt, t_end):
        given = {"solver": "direct", "newton": TIGHT}
        return fc.run(system, method, system.rest(), dt, t_end, **given).state.v

    errors = []
    for dt in (0.02, 0.01):
        v = speeds(fc.ImplicitMidpoint(), dt, 0.2)
        assert np.ptp(v, axis=0).max() < 1e-10  # it stays a plate
        errors.append(abs(v[0, 2] + exact))
    assert errors[-1] < 1e-3 * limit
    assert observed_order([2, 1], errors) == pytest.approx(2.0, abs=0.15)
    end = speeds(fc.BackwardEuler(), 0.1, 8.0)
    np.testing.assert_allclose(end[:, 2], -limit, rtol=1e-8)


@pytest.mark.parametrize("term", stories_except(["drag", "wind"], "wind"))
@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("method", ["backward_euler", "implicit_midpoint"])
def test_momentum_of_a_falling_sheet_changes_by_the_force_of_the_stage(
    method, law, term, sheet, isotropic, rng
):
    """m Δv = dt (m g + Σ F) at the stage, in every step and for any shape of the sheet.

    What Newton leaves is at most 1e-13 of the step's forces, ‖M a‖ + Σ ‖f_term‖ at its first
    iterate; that is up to 500 N here, of a stiff membrane, and over n nodes adds up to √n of it.
    """
    loads = {"drag": fc.Drag(0.7, 0.1, law), "wind": fc.Wind((2.0, "z", 1.0), 0.7, 0.1, law)}
    system = fc.System(sheet, isotropic, [fc.StVK(), loads[term], fc.Gravity()])
    load_scene = fc.System(sheet, isotropic, [loads[term]])
    start = system.state(rough(sheet, rng, 0.002), rng.standard_normal((len(sheet.X), 3)))
    mass, dt = system.nodal_mass, 0.005
    for _, info in fc.march(
        system, METHODS[method](), start, dt, 0.05, solver="direct", newton=fc.Newton(1e-13)
    ):
        change = mass @ (info.result.state.v - info.old.v)
        drag = load_scene.force(info.result.balanced_at).sum(axis=0)
        pushed = drag + mass.sum() * np.array([0, 0, -G])
        assert np.linalg.norm(drag) > 0.01 * mass.sum() * G
        left = 1e-13 * 500.0 * np.sqrt(len(mass))
        assert left < 1e-9 * mass.sum() * G
        np.testing.assert_allclose(change, dt * pushed, rtol=1e-13, atol=dt * left)


@pytest.mark.stories
@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("method", ["backward_euler", "implicit_midpoint"])
def test_ledger_of_a_falling_plate_closes_to_round_off(method, law, sheet, isotropic, rng):
    """A tilted plate has no strain, so that the method adds no numerical dissipation."""
    terms = [fc.StVK(), fc.Wind((2.0, -1.0, "t"), 0.7, 0.1, law), fc.Gravity()]
    system = fc.System(sheet, isotropic, terms)
    turn, _ = np.linalg.qr(rng.standard_normal((3, 3)))
    start = system.state(flat(sheet) @ turn)
    result = fc.run(system, METHODS[method](), start, 0.01, 0.3, solver="direct", newton=TIGHT)
    flow = result.energies["work:Wind"][-1], result.energies["dissipated:Wind"][-1]
    assert min(flow) > 0.05
    assert abs(result.energies["remainder"]).max() < 1e-10 * max(flow)
