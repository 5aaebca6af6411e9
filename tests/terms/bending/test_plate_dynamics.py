"""`PlateBending` over steps, and its damping."""

import numpy as np
import pytest
from support.plates import flying, square

import fecloth as fc

# steps are coarse and meshes small by intent
pytestmark = pytest.mark.filterwarnings("ignore::fecloth.errors.FeclothWarning")

FABRIC = fc.Fabric(0.2, 500.0, 0.2, bending_rigidity=(1e-3, 5e-4), bending_poisson_ratio=0.2)


@pytest.mark.parametrize("element", ["P1", "P2"])
@pytest.mark.parametrize(
    "term",
    [
        fc.PlateBending(),
        fc.PlateBending(rest=0.4),
        fc.BendingDamping(0.1, "exact", fc.PlateBending()),
    ],
)
def test_terms_pass_the_slope_test(term, element):
    cloth = fc.Cloth.rectangle(1.0, 1.0, 0.5, "right", element)
    fc.verify.check_term(term, cloth=cloth, fabric=FABRIC)


@pytest.mark.parametrize(
    ("pattern", "tangent"), [("jittered", "exact"), ("jittered", "symmetric"), ("cross", "exact")]
)
def test_energy_momentum_keeps_energy_and_both_momenta(pattern, tangent):
    system, start = flying(square(pattern, 4), FABRIC, fc.StVK())
    method, newton = fc.EnergyMomentum(tangent), fc.Newton(tolerance=1e-12)
    result = fc.run(system, method, start, dt=0.01, t_end=0.2, newton=newton)
    total = result.energies["total"]
    assert np.ptp(result.energies["PlateBending"]) > 1e-3 * total[0]
    assert np.ptp(total) < 1e-9 * total[0]
    m = system.nodal_mass[:, None]
    for momentum in (lambda s: (m * s.v).sum(axis=0), lambda s: np.cross(s.x, m * s.v).sum(axis=0)):
        assert momentum(result.state) == pytest.approx(momentum(start), abs=1e-9)


@pytest.mark.parametrize("pattern", ["right", "unstructured"])
def test_tangent_over_a_step_is_the_derivative_of_the_force(pattern):
    from fecloth.linalg.block_matrix import BlockMatrix
    from fecloth.terms.step_difference import StepDifference

    system, start = flying(square(pattern, 4), FABRIC, fc.StVK())
    step = StepDifference(start.x, 0.01, 0.005, ((1.0, start.x),), True, False)
    over = system.over_step(step)
    term = over.bound[1]
    x = start.x + 0.02 * start.v
    d = np.random.default_rng(0).normal(size=x.shape)
    J = BlockMatrix.zeros(system.pattern)
    term.add_tangent(x, start.v, 0.0, 1.0, 0.0, J, False)
    errors = []
    for size in (4e-4, 1e-4):
        forces = [np.zeros_like(x), np.zeros_like(x)]
        for f, sign in zip(forces, (1, -1), strict=True):
            term.add_force(x + sign * size * d, start.v, 0.0, f)
        errors.append(np.abs((forces[0] - forces[1]) / (2 * size) + J @ d).max())
    assert errors[0] / errors[1] == pytest.approx(16, rel=0.25)


def test_damping_dissipates_and_does_not_see_rigid_motion():
    cloth = square("unstructured", 5)
    law = fc.PlateBending()
    system = fc.System(cloth, FABRIC, [fc.BendingDamping(0.1, law=law)])
    x = system.rest().x
    x[:, 2] = 0.2 * np.sin(3 * x[:, 0])
    turning = system.state(x, np.cross([1.0, 2.0, 3.0], x) + [1.0, 0.0, 2.0])
    assert np.abs(system.force(turning)).max() < 1e-15
    v = np.random.default_rng(0).normal(size=x.shape)
    swinging = system.state(x, v)
    power = system.bound[0].power(x, v, 0.0)
    assert power > 0
    assert power == pytest.approx(-np.sum(system.force(swinging) * v))


@pytest.mark.stories
def test_explicit_run_gains_no_energy():
    """The energy of a leapfrog run oscillates; its mean over a tenth of the run stays."""
    system, start = flying(square("unstructured", 4), FABRIC, fc.StVK())
    dt = 0.5 * fc.critical_dt(system, start)
    result = fc.run(system, fc.CentralDifference(), start, dt=dt, t_end=4000 * dt)
    total = np.asarray(result.energies["total"])
    tenth = len(total) // 10
    assert abs(total[-tenth:].mean() - total[:tenth].mean()) < 1e-3 * total[0]
