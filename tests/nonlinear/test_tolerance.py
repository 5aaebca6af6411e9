"""What the tolerance of Newton's iteration means: pinned nodes, one term, round-off."""

import numpy as np
import pytest
from conftest import affine, flat

import fecloth as fc
from fecloth.linalg.reductions import NodeSums
from fecloth.nonlinear.line_search import Point, find_step
from fecloth.nonlinear.newton import NewtonFailed
from fecloth.simulation.resolve import solver_for

# steps are coarse and meshes small by intent
pytestmark = pytest.mark.filterwarnings("ignore::fecloth.errors.FeclothWarning")

SOFT = fc.Fabric(0.15, 2000.0, bending_rigidity=0.0118)
TERMS = [fc.StVK(), fc.HingeBending(), fc.Gravity()]


def cantilever(grip=SOFT):
    """A strip whose first two columns of nodes are pinned: the cells between them are of `grip`."""
    plain = fc.Cloth.rectangle(0.2, 0.05, 0.01, "right")
    is_grip = plain.X[plain.triangles, 0].max(axis=1) < 0.01 + 1e-9
    regions = {"grip": np.flatnonzero(is_grip), "body": np.flatnonzero(~is_grip)}
    cloth = fc.Cloth.from_arrays(plain.X, plain.triangles, regions=regions)
    pin = fc.Pin(lambda X: X[:, 0] < 0.02 + 1e-9)
    return fc.System(cloth, {"grip": grip, "body": SOFT}, TERMS, pins=[pin])


def tip(system, state):
    return state.x[system.cloth.X[:, 0] > 0.2 - 1e-9, 2].mean()


# --- pinned nodes (what they do to each other is no measure of anything) --------------------------


@pytest.mark.parametrize("stiffness", [2e8, 1e12])
@pytest.mark.parametrize("strain", [0.0, 0.01, -0.1])
def test_a_steel_grip_does_not_loosen_the_tolerance(stiffness, strain):
    """Also where the grip is strained as it is held: its forces on itself do not count."""
    soft, stiff = cantilever(), cantilever(grip=fc.Fabric(0.15, stiffness, bending_rigidity=0.0118))
    x = flat(stiff.cloth)
    x[x[:, 0] < 1e-9, 0] -= strain * 0.01
    result = fc.equilibrium(stiff, stiff.state(x))
    expected = tip(soft, fc.equilibrium(soft, soft.rest()))
    assert tip(stiff, result) == pytest.approx(expected, rel=1e-5)


# --- one term alone -------------------------------------------------------------------------------


@pytest.mark.parametrize("stretch", [1.01, 1.1, 1.5])
@pytest.mark.parametrize("term", [fc.StVK(), fc.NeoHookean(), fc.Springs("van_gelder")])
def test_the_tolerance_means_something_with_one_term(term, stretch):
    """The free forces over the reactions, computed here, are as told and below the tolerance."""
    cloth = fc.Cloth.rectangle(1.0, 0.5, 0.1)
    system = fc.System(cloth, fc.Fabric(0.2, 1000.0, 0.3), [term], pins=["left", "right"])
    iterations = []
    for tolerance in (1e-1, 1e-4, 1e-9):
        result = fc.equilibrium(
            system, system.state(flat(cloth) * [stretch, 1, 1]), tolerance=tolerance
        )
        f = system.force(result)
        free = np.linalg.norm(system.constraints.project(f.copy()))
        assert free / np.linalg.norm(f) == pytest.approx(result.residual, rel=1e-6)
        assert result.residual <= tolerance
        iterations.append(result.iterations)
    assert iterations[0] < iterations[1] < iterations[2]


# --- what is returned -----------------------------------------------------------------------------


def test_an_equilibrium_serves_as_a_state(sheet, isotropic):
    system = fc.System(sheet, isotropic, [fc.StVK(), fc.Gravity()], pins=["boundary"])
    told = []
    result = fc.equilibrium(system, system.state(flat(sheet), t=2.0), report=told.append)
    assert isinstance(result, fc.State)
    assert isinstance(result, fc.Equilibrium)
    assert result.t == 2.0
    assert not result.v.any()
    assert result.iterations == len(told) <= result.factorisations
    assert result.residual == told[-1].residual
    assert result.reason.startswith("the error left in its positions is about")
    assert result.solver_error < 1e-6 * abs(result.x - flat(sheet)).max()
    run = fc.run(system, fc.BackwardEuler(), result, dt=0.01, t_end=2.02)
    assert abs(run.state.x - result.x).max() < 1e-9
    assert fc.equilibrium(system, result).iterations == 0
    assert system.energies(result)["kinetic"] == 0


# --- round-off ------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def far_away():
    """A taut sheet so far from the origin that its positions round to a tenth of a nanometre."""
    cloth = fc.Cloth.rectangle(1.0, 0.5, 0.1)
    terms = [fc.StVK(), fc.Gravity()]
    system = fc.System(cloth, fc.Fabric(0.2, 1000.0, 0.3), terms, pins=["boundary"])
    return system, system.state(1.1 * flat(cloth) + [1e6, 0.0, 0.0])


def test_equilibrium_raises_where_round_off_is_above_the_tolerance(far_away):
    system, start = far_away
    with pytest.raises(fc.EquilibriumFailed, match="round-off of the forces") as failure:
        fc.equilibrium(system, start, tolerance=1e-9)
    assert failure.value.residual > 1e-9
    possible = float(failure.value.remedy.split("tolerance of ")[1].split()[0])
    result = fc.equilibrium(system, failure.value.state, tolerance=possible)
    assert result.residual <= possible


def test_the_default_says_what_round_off_leaves(far_away):
    """It asks for no tolerance: at 1e6 m numbers are 1e-10 m apart, the error is of that size."""
    system, start = far_away
    result = fc.equilibrium(system, start)
    assert 1e-11 < result.solver_error < 1e-8
    assert "error" in result.reason
    near = fc.equilibrium(system, system.state(start.x - [1e6, 0.0, 0.0]))
    apart = abs(result.x - [1e6, 0.0, 0.0] - near.x).max()
    assert apart < 10 * result.solver_error


def test_a_cloth_without_forces_is_in_equilibrium(sheet, isotropic, rng):
    """No residual of 1: all its forces are round-off."""
    turn, _ = np.linalg.qr(rng.standard_normal((3, 3)))
    system = fc.System(sheet, isotropic, [fc.StVK()])
    result = fc.equilibrium(system, system.state(flat(sheet) @ turn + 10.0))
    assert (result.iterations, result.residual) == (0, 0.0)
    assert result.reason == "no force exceeds its round-off"


def test_steps_limited_by_round_off_are_counted_and_told(far_away):
    system, start = far_away
    run = fc.run(system, fc.BackwardEuler(), start, 0.01, 0.03, newton=fc.Newton(tolerance=1e-11))
    assert fc.DoubtKind.ROUND_OFF in {doubt.kind for doubt in run.doubts}
    quiet = fc.run(system, fc.BackwardEuler(), start, 0.01, 0.03)
    assert fc.DoubtKind.ROUND_OFF not in {doubt.kind for doubt in quiet.doubts}


# --- the line search ------------------------------------------------------------------------------


def test_where_round_off_hides_the_potential_the_slopes_tell():
    """Of a potential near 1e8 J the last digit is 1.5e-8 J, more than the whole fall."""

    def at(y):
        return Point(y, y.copy(), float(np.linalg.norm(y)), 1.0)

    start, step = at(np.array([[-1e-6, 0.0, 0.0]])), np.array([[1.7e-6, 0.0, 0.0]])

    def rounded(y):
        return 1e8 + (0.0 if y is start.y else 2e-8)

    arguments = NodeSums(), at, start, step, 0.1 * start.norm, rounded
    assert find_step(*arguments) is None
    assert find_step(*arguments, tiny=1.0)[1] == 1.0
    longer = NodeSums(), at, start, 2 * step, 0.1 * start.norm, rounded
    assert find_step(*longer, tiny=1.0)[1] == 0.5  # the whole step pushes back


def test_forces_that_are_not_finite_are_told(sheet, isotropic):
    system = fc.System(sheet, isotropic, [fc.StVK()])
    solver, _ = solver_for(system, fc.BackwardEuler(), 0.1, "direct")
    x = affine(sheet, [[1.0, 0.0], [0.0, 1.0], [0.0, 0.0]])
    x[0, 0] = np.nan
    with pytest.raises(NewtonFailed, match="the forces are not finite"):
        fc.BackwardEuler().step(system, fc.State(0.0, x, 0 * x), 0.1, solver)
