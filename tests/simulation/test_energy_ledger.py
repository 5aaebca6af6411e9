"""What the energy ledger leaves; reactions, probes, sag and area are what they say."""

import numpy as np
import pytest
import skfem
from conftest import affine, flat, taut_start

import fecloth as fc
from fecloth.simulation.probes import Observer, area
from studies.references.time_problems import CASES

# steps are coarse and meshes small by intent
pytestmark = pytest.mark.filterwarnings("ignore::fecloth.errors.FeclothWarning")

TIGHT = fc.Newton(tolerance=1e-12)


@pytest.mark.stories
@pytest.mark.parametrize("name", CASES)
def test_ledger_remainder_on_a_nonlinear_problem(name, isotropic, record_property):
    """Of second order in dt, as is the quadrature of the forces' work over a step.

    Nothing for energy–momentum; of first order for the linearised step, whose force is none that
    the cloth has.
    """
    cloth, method = fc.Cloth.rectangle(0.4, 0.3, h=0.1), CASES[name]
    terms = [fc.StVK(), fc.StrainRateDamping(2e-4), fc.Gravity()]
    system = fc.System(cloth, isotropic, terms, pins=["left", "right"])
    taut = taut_start(system)
    start, left = system.state(taut.x, system.constraints.project(taut.v)), []
    for dt in (1e-4, 5e-5):
        run = fc.run(system, method, start, dt, 0.004, solver="direct", newton=TIGHT)
        remainder, kinetic = run.energies["remainder"], run.energies["kinetic"]
        left.append(float(abs(remainder).max() / kinetic.max()))
    record_property("remainder", left)
    print(f"{name}: remainder over kinetic energy {left[0]:.1e}, {left[1]:.1e} at half the step")
    if name == "energy_momentum":
        assert max(left) < 1e-9
    else:
        assert left[1] < 5e-3
        order = 1 if name == "linearly_implicit_euler" else 2
        assert left[1] < left[0] / 2 ** (order - 0.15)


def test_reactions_of_an_equilibrium_need_no_step(isotropic):
    cloth = fc.Cloth.rectangle(0.3, 0.5, h=0.1)
    system = fc.System(cloth, isotropic, [fc.StVK(), fc.Gravity((0, -9.81, 0))], pins=["top"])
    start = system.rest()
    row = Observer.bind(system, start).row_at_rest(fc.equilibrium(system, start))
    weight = 9.81 * 0.2 * cloth.area
    assert row["reaction:top.y"] == pytest.approx(weight, rel=1e-6)
    assert row["reaction:top.x"] == pytest.approx(0.0, abs=1e-6 * weight)
    assert row["sag"] == 0.0
    assert row.keys() == Observer.bind(system, start).row(None, None).keys()


def test_reaction_drives_a_rigidly_moved_cloth(isotropic):
    """A cloth all of whose nodes are moved alike: the reaction is m a of the motion."""
    cloth = fc.Cloth.rectangle(0.3, 0.3, h=0.1)
    pin = fc.Pin(lambda X: X[:, 0] > -1, motion=lambda t: [0.0, 0.0, 0.5 * 3.0 * t**2], name="all")
    system = fc.System(cloth, isotropic, [fc.StVK()], pins=[pin])
    result = fc.run(system, fc.ImplicitMidpoint(), system.rest(), 0.01, 0.1, solver="direct")
    mass = system.nodal_mass.sum()
    np.testing.assert_allclose(result.observed["reaction:all.z"][1:], 3.0 * mass, rtol=1e-6)
    np.testing.assert_allclose(result.state.v[:, 2], 0.3, rtol=1e-8)
    np.testing.assert_allclose(result.energies["pins"][-1], 0.5 * mass * 0.3**2, rtol=1e-6)


def test_probes_follow_material_points(isotropic):
    cloth = fc.Cloth.rectangle(1.0, 0.5, h=0.1)
    system = fc.System(cloth, isotropic, [fc.Gravity()], pins=[])
    probes = [fc.Probe("point", point=(0.33, 0.21)), fc.Probe("edge", where="right")]
    start = system.state(flat(cloth) + [0.0, 0.0, 2.0], np.tile([1.0, 0.0, 0.0], (len(cloth.X), 1)))
    result = fc.run(system, fc.ImplicitMidpoint(), start, 0.01, 0.1, probes=probes)
    t = result.times
    np.testing.assert_allclose(result.observed["point.x"], 0.33 + t, atol=1e-12)
    np.testing.assert_allclose(result.observed["point.y"], 0.21, atol=1e-12)
    np.testing.assert_allclose(result.observed["point.z"], 2 - 4.905 * t**2, atol=1e-9)
    np.testing.assert_allclose(result.observed["edge.x"], 1 + t, atol=1e-12)
    np.testing.assert_allclose(result.observed["sag"], 4.905 * t**2, atol=1e-9)
    np.testing.assert_allclose(result.observed["mean_displacement.x"], t, atol=1e-12)
    np.testing.assert_allclose(result.observed["area"], 0.5, rtol=1e-12)


def test_area_of_an_affine_map():
    cloth = fc.Cloth.rectangle(1.0, 0.5, h=0.2)
    F = np.array([[1.1, 0.3], [0.0, 0.9], [0.2, 0.0]])
    expected = 0.5 * np.sqrt(np.linalg.det(F.T @ F))
    assert area(cloth, affine(cloth, F)) == pytest.approx(expected, rel=1e-13)


@pytest.mark.parametrize("method", [fc.ImplicitMidpoint(), fc.BackwardEuler()])
def test_initial_velocity_of_pinned_nodes_is_removed(method, isotropic):
    """The pinned nodes' kinetic energy is taken by the pins (midpoint), or half by the method."""
    cloth = fc.Cloth.rectangle(1.0, 1.0, h=0.25)
    system = fc.System(cloth, isotropic, [fc.StVK()], pins=["left"])
    start = system.state(system.rest().x, np.tile([0.0, 0.0, 1.0], (len(cloth.X), 1)))
    lost = 0.5 * system.nodal_mass[cloth.nodes("left")].sum()
    newton = fc.Newton(tolerance=1e-12)
    result = fc.run(system, method, start, 1e-5, 1e-5, solver="direct", newton=newton)
    taken = -result.energies["pins"][-1] + result.energies["numerical"][-1]
    assert taken == pytest.approx(lost, rel=1e-2)
    assert abs(result.energies["remainder"][-1]) < 1e-3 * lost


@pytest.mark.stories
def test_a_probe_between_nodes_is_on_the_quadratic_surface(quadratic, isotropic):
    cloth, terms = quadratic, [fc.StVK(), fc.Gravity()]
    system = fc.System(cloth, isotropic, terms, pins=["left"])
    start = system.state(system.rest().x * [1.02, 1.0, 1.0])
    method = fc.Adaptive(fc.GeneralizedAlpha(), rtol=1e-2)
    probe = fc.Probe("at", point=(0.21, 0.13))
    result = fc.run(system, method, start, t_end=0.01, probes=[probe])
    basis = skfem.Basis(cloth.mesh, skfem.ElementTriP2())
    z = basis.interpolator(result.state.x[:, 2])(np.array([[0.21], [0.13]]))
    assert result.observed["at.z"][-1] == pytest.approx(z[0], rel=1e-10)
    mean = cloth.load() @ (result.state.x - start.x) / 0.06
    answer = [result.observed[f"mean_displacement.{c}"][-1] for c in "xyz"]
    np.testing.assert_allclose(answer, mean, rtol=1e-9, atol=1e-14)
