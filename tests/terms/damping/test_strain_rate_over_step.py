"""Strain-rate damping over a step: its stress, rigid motion, energy balance, methods."""

from itertools import pairwise

import numpy as np
import pytest
from conftest import affine, flat, rough
from scipy.spatial.transform import Rotation
from support.linear_term import LinearMembrane
from support.tiers import MASSES, in_turn

import fecloth as fc
from fecloth.integrators import EXPLICIT, METHODS
from fecloth.integrators.bdf2 import Change
from fecloth.integrators.protocol import has_symmetric_matrix
from fecloth.terms.kinematics import deformation_gradient
from fecloth.verify import observed_order


def smooth(cloth, t):
    """Positions and velocities (n, 3) of a motion that turns and strains."""
    x = flat(cloth)
    c, s = np.cos(3 * t), np.sin(3 * t)
    turn, rate = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]), np.array([[-s, c, 0], [-c, -s, 0]])
    rate = 3 * np.vstack([rate, [0, 0, 0]])
    bulge = x + np.outer(np.sin(4 * t + 5 * cloth.X[:, 0]), [0.02, 0.01, 0.05])
    speed = np.outer(4 * np.cos(4 * t + 5 * cloth.X[:, 0]), [0.02, 0.01, 0.05])
    return bulge @ turn, speed @ turn + bulge @ rate


# steps are coarse and meshes small by intent
pytestmark = pytest.mark.filterwarnings("ignore::fecloth.errors.FeclothWarning")

TIGHT = fc.Newton(tolerance=1e-12)
DAMPED = [fc.BackwardEuler(), fc.BDF2()]
OTHERS = [method() for method in METHODS.values() if method() not in DAMPED]
OTHERS += [method(beyond_limit=True) for method in EXPLICIT.values()]


def strain(cloth, x):
    F = deformation_gradient(cloth, x)
    return 0.5 * (np.swapaxes(F, -1, -2) @ F - np.eye(2))


def over_step(kind, system, state, dt, older, last=0.01):
    """The system over a step, after one of the size `last` from the positions `older`."""
    if kind == "backward Euler":
        return fc.BackwardEuler().over_step(system, state, dt)
    before = Change(last, state.x - older, state.v) if kind == "BDF2" else None
    return system.over_step(fc.BDF2().difference(state, dt, before))


@pytest.mark.parametrize("kind", ["backward Euler", "BDF2", "first of BDF2"])
def test_stress_is_the_methods_difference(kind, orthotropic, rng, sheet):
    """Ψ and S_v : E against their formulas, with E from the deformation gradients."""
    system = fc.System(sheet, orthotropic, [fc.StrainRateDamping(0.02)])
    x0, x1, older = (rough(sheet, rng) for _ in range(3))
    state, dt = system.state(x0, rng.standard_normal(x0.shape)), 0.01
    half = 0.5 * dt * state.v
    start = strain(sheet, x0)
    past, h = {
        "backward Euler": (start, dt),
        "BDF2": (4 / 3 * start - 1 / 3 * strain(sheet, older), 2 / 3 * dt),
        "first of BDF2": (
            start + (strain(sheet, x0 + half) - strain(sheet, x0 - half)) / 2,
            dt / 2,
        ),
    }[kind]
    rate = (strain(sheet, x1) - past)[:, 0] / h
    C11, C22, C66, C12, _, _ = 0.02 * orthotropic.moduli()
    e1, e2, shear = rate[:, 0, 0], rate[:, 1, 1], 2 * rate[:, 0, 1]
    power = C11 * e1**2 + C22 * e2**2 + 2 * C12 * e1 * e2 + C66 * shear**2
    expected = 0.5 * h * (sheet.weights[:, 0] @ power)
    over = over_step(kind, system, state, dt, older)
    assert over.bound[0].energy(x1, 0.0) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("angle", [0.1, 1.0, 3.0])
def test_a_step_that_turns_the_cloth_meets_no_force(angle, sheet, orthotropic, rng):
    """The velocity at its end is not that of a rigid motion, so the other form has a force.

    After an impact that makes a cloth turn it has turned on straight ways, which strain it.
    """
    axis = np.array([0.6, 0.0, 0.8])
    turn = Rotation.from_rotvec(angle * axis).as_matrix()
    older = rough(sheet, rng)
    x0, x1 = older @ turn + [0.1, 0.2, 0.3], older @ turn @ turn
    system, dt = fc.System(sheet, orthotropic, [fc.StrainRateDamping(0.02)]), 0.01
    state, end = system.state(x0), system.state(x1)
    elsewhere = abs(system.force(system.state(x1, x1 / dt))).max()
    assert abs(system.force(system.state(x1, (x1 - x0) / dt))).max() > 1e-4 * elsewhere
    jump = np.cross(x0, axis)
    struck = Change(2 * dt, [0.1, 0.2, 0.3] + jump, x0, jump)
    overs = [
        over_step(kind, system, state, dt, older, 2 * dt) for kind in ("backward Euler", "BDF2")
    ]
    for over in [*overs, system.over_step(fc.BDF2().difference(state, dt, struck))]:
        assert abs(over.force(end)).max() < 1e-12 * elsewhere
        assert over.bound[0].dissipation(x1) < 1e-24 * system.bound[0].power(x1, x1 / dt, 0.0)


def moved(isotropic, mass, terms):
    cloth = fc.Cloth.rectangle(0.4, 0.3, h=0.1)
    pins = [fc.Pin("left", motion=lambda t: [0.02 * np.sin(30 * t), 0, 0.05 * t**2]), "right"]
    system = fc.System(cloth, isotropic, terms, pins, mass=mass)
    return system, system.state(affine(cloth, [[1.2, 0.0], [0.0, 1.2], [0.0, 0.1]]))


@pytest.mark.stories
@pytest.mark.parametrize(
    ("method", "mass"), in_turn([*DAMPED, fc.Adaptive(fc.BDF2(), 0.1)], MASSES), ids=repr
)
def test_ledger_closes(method, mass, isotropic):
    """Elastic energies quadratic in x; the damping is not linear, and pins move."""
    terms = [LinearMembrane(), fc.StrainRateDamping(0.01), fc.Gravity()]
    system, start = moved(isotropic, mass, terms)
    dt, t_end = (None, 0.05) if isinstance(method, fc.Adaptive) else (5e-3, 0.2)
    run = fc.run(system, method, start, dt, t_end, solver="direct", newton=TIGHT)
    energies = run.energies
    dissipated = energies["dissipated:StrainRateDamping"]
    assert abs(energies["remainder"]).max() < 1e-10 * abs(energies["total"]).max()
    assert dissipated[-1] > 1e-3 * abs(energies["total"]).max()
    assert (np.diff(dissipated) >= 0).all()
    assert len(np.unique(np.diff(run.times))) > 1 or dt


@pytest.mark.parametrize("method", [fc.BackwardEuler(), fc.BDF2(), *OTHERS], ids=repr)
def test_the_default_is_that_of_the_method(method, small, isotropic):
    ends = {}
    for rate in (None, "velocity", *(["step"] if method in DAMPED else [])):
        terms = [fc.StVK(), fc.StrainRateDamping(1e-3, rate=rate)]
        system = fc.System(small, isotropic, terms, ["left"])
        start = system.state(1.1 * flat(small), np.outer(small.X[:, 0], [0, 1, 3]))
        dt = 1e-5 if method.traits.explicit else 0.01
        ends[rate] = [state.x for state, _ in fc.march(system, method, start, dt, 3 * dt)][-1]
    if method in DAMPED:
        np.testing.assert_array_equal(ends[None], ends["step"])
        assert abs(ends["velocity"] - ends["step"]).max() > 1e-6
    else:
        np.testing.assert_array_equal(ends[None], ends["velocity"])


def test_the_matrix_is_symmetric_also_for_the_exact_tangent(small, isotropic):
    """Conjugate gradients need that; the other form is refused."""
    damping = {rate: fc.StrainRateDamping(0.01, None, "exact", rate) for rate in (None, "velocity")}
    for method, rate, symmetric in (
        (fc.BDF2(), None, True),
        (fc.Adaptive(fc.BackwardEuler()), None, True),
        (fc.BackwardEuler(), "velocity", False),
        (fc.ImplicitMidpoint(), None, False),
    ):
        system = fc.System(small, isotropic, [fc.StVK(), damping[rate]])
        assert has_symmetric_matrix(system, method) is symmetric


@pytest.mark.parametrize(
    ("kind", "order"), [("backward Euler", 1), ("BDF2", 2), ("first of BDF2", 2)]
)
def test_both_forms_agree_as_dt_falls(kind, order, sheet, orthotropic):
    system, errors = fc.System(sheet, orthotropic, [fc.StrainRateDamping(0.02)]), []
    x1, v1 = smooth(sheet, 0.3)
    exact = system.force(system.state(x1, v1))
    sizes = 0.01 / 2 ** np.arange(4)
    for dt in sizes:
        (x0, v0), older = smooth(sheet, 0.3 - dt), smooth(sheet, 0.3 - 1.5 * dt)[0]
        over = over_step(kind, system, system.state(x0, v0), dt, older, last=dt / 2)
        errors.append(np.linalg.norm(over.force(system.state(x1)) - exact))
    assert errors[0] < 0.5 * np.linalg.norm(exact)
    assert observed_order(sizes, errors)[-1] == pytest.approx(order, abs=0.15)


def test_dissipation_of_backward_euler_is_twice_the_potential(isotropic):
    system, start = moved(isotropic, "lumped", [fc.StVK(), fc.StrainRateDamping(0.01)])
    for state, info in fc.march(system, fc.BackwardEuler(), start, 5e-3, 0.05):
        damping = info.result.over.bound[1]
        potential = damping.energy(state.x, state.t)
        assert damping.dissipation(state.x) == pytest.approx(2 * potential, rel=1e-12)
        assert potential > 0


@pytest.mark.stories
def test_order_two_with_steps_of_changing_size(small, isotropic):
    """BDF2 with the ratios 2 and ½ of one step to the last, over a turn of a radian."""
    terms = [fc.StVK(), fc.StrainRateDamping(1e-3), fc.Gravity()]
    system = fc.System(small, isotropic, terms)
    start = system.state(1.05 * flat(small), np.cross([0.0, 10.0, 20.0], flat(small)))

    def end(number):
        times = np.cumsum(np.tile([1.0, 2.0], number // 2)) * 0.05 / (1.5 * number)
        (*stops, t_end), options = times, {"solver": "direct", "newton": TIGHT}
        steps = fc.march(system, fc.BDF2(), start, 1.0, t_end, stops=stops, **options)
        return [state.x for state, _ in steps][-1]

    changes = [np.linalg.norm(a - b) for a, b in pairwise(end(n) for n in (80, 160, 320))]
    assert observed_order([2, 1], changes)[-1] == pytest.approx(2, abs=0.15)
