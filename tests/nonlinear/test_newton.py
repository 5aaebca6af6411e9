"""Newton's iteration: convergence, indefinite tangents, its stopping rule."""

import contextlib

import numpy as np
import pytest
from conftest import affine, flat, rough

import fecloth as fc
from fecloth.nonlinear.iteration import iterate
from fecloth.nonlinear.newton import NewtonFailed, StageEquation
from fecloth.nonlinear.steps import Steps
from fecloth.simulation.resolve import solver_for

# steps are coarse and meshes small by intent
pytestmark = pytest.mark.filterwarnings("ignore::fecloth.errors.FeclothWarning")


@pytest.fixture(scope="module")
def arc():
    """A sheet bent into an arc without strain, about to fall: compressed within one step."""
    cloth = fc.Cloth.rectangle(1.0, 0.5, h=0.05)
    X = cloth.X
    x = np.column_stack([np.sin(X[:, 0]), 1 - np.cos(X[:, 0]), X[:, 1]])
    return cloth, x


def steps(arc, terms, definiteness, method=None, dt=0.02, count=15, **options):
    cloth, x = arc
    system = fc.System(cloth, fc.Fabric(0.15, 500.0, 0.3), terms, pins=["left"])
    options = fc.Newton(definiteness=definiteness, **options)
    marching = fc.march(
        system,
        method or fc.BackwardEuler(),
        system.state(x),
        dt,
        count * dt,
        solver="direct",
        newton=options,
    )
    return [(state, info.counts) for state, info in marching]


def residuals(system, method, state, dt, guess, count=6):
    """Residual after 1, 2, 3, … iterations of the first step."""
    options = fc.Newton(tolerance=1e-13, reuse=False, max_iterations=count)
    solver, _ = solver_for(system, method, dt, "direct", options)
    equation = StageEquation(system, method.stage(state, dt), "on_failure")
    points = [Steps(equation, solver).at(guess, 0.0)]
    with contextlib.suppress(NewtonFailed):
        iterate(equation, solver, guess, report=lambda progress: points.append(progress.point))
    return np.array([point.norm / point.scale for point in points])


@pytest.mark.parametrize(("tangent", "fast"), [("exact", True), ("symmetric", False)])
def test_the_symmetric_damping_tangent_costs_quadratic_convergence(
    tangent, fast, sheet, isotropic, rng
):
    terms = [fc.StVK(), fc.StrainRateDamping(0.02, tangent=tangent, rate="velocity")]
    system = fc.System(sheet, isotropic, terms, pins=["boundary"])
    x = affine(sheet, [[1.2, 0.0], [0.0, 1.2], [0.0, 0.0]])
    start = system.state(x, system.constraints.project(0.2 * rng.standard_normal(x.shape)))
    norms = residuals(system, fc.BackwardEuler(), start, 0.01, np.zeros_like(x))
    quadratic = norms[4] < 20 * norms[3] ** 2
    assert quadratic == fast
    assert norms[5] < 1e-13


def test_definiteness_none_fails_in_compression_with_a_remedy(arc):
    with pytest.raises(fc.StepFailed, match=r"not positive definite.*on_failure.*smaller dt"):
        steps(arc, [fc.StVK(), fc.Gravity()], "none")


@pytest.mark.parametrize("dt", [1e-7, 1e-5, 1e-3])
def test_small_steps_move_the_cloth(sheet, isotropic, dt):
    """The tolerance is relative to the forces; an absolute one freezes a cloth at small dt."""
    system = fc.System(sheet, isotropic, [fc.StVK(), fc.Gravity()])
    newton = fc.Newton(tolerance=1e-12)
    end = fc.run(system, fc.BackwardEuler(), system.rest(), dt, 5 * dt, newton=newton).state
    assert end.v == pytest.approx(np.broadcast_to([0, 0, -9.81 * 5 * dt], end.v.shape), rel=1e-9)


def test_forces_of_any_size(sheet, rng):
    """Stiffness, mass and gravity times 1e6: the same motion in the same iterations."""
    runs = []
    for factor in (1.0, 1e6):
        fabric = fc.Fabric(0.2 * factor, 1000.0 * factor, 0.3)
        system = fc.System(sheet, fabric, [fc.StVK(), fc.Gravity()], pins=["left"])
        start = system.state(1.02 * flat(sheet))
        runs.append(fc.run(system, fc.ImplicitMidpoint(), start, 2e-3, 0.04, solver="direct"))
    assert runs[0].newton == runs[1].newton
    assert runs[0].state.x == pytest.approx(runs[1].state.x, abs=1e-9)


def test_a_cloth_at_rest_without_load_is_solved(sheet, isotropic, rng):
    """Its only force is round-off: asking for less than that would never end."""
    system = fc.System(sheet, isotropic, [fc.StVK()])
    turn, _ = np.linalg.qr(rng.standard_normal((3, 3)))
    start = system.state(flat(sheet) @ turn + 100.0)
    for state, info in fc.march(system, fc.BackwardEuler(), start, 0.01, 0.05):
        assert np.abs(state.x - start.x).max() < 1e-10
        assert info.counts.newton <= 3


def test_the_last_residual_is_that_of_the_equation(sheet, isotropic, rng):
    """M a − f, written out for backward Euler."""
    system = fc.System(
        sheet, isotropic, [fc.StVK(), fc.StrainRateDamping(0.01, rate="velocity")], pins=["left"]
    )
    start = system.state(rough(sheet, rng, 0.003))
    dt = 1e-3
    new, info = next(fc.march(system, fc.BackwardEuler(), start, dt, dt))
    inertia = system.scalar_mass @ (new.v - start.v) / dt
    R = system.constraints.project(inertia - system.force(new))
    scale = np.linalg.norm(system.force(start))  # of the first iterate, without damping yet
    assert np.linalg.norm(R) == pytest.approx(info.counts.residual * scale, rel=1e-3)
    assert info.counts.residual <= 1e-6


def test_a_step_so_long_that_the_mass_hardly_counts_is_solved():
    """A cantilever in one step of 100 s: no multiple of the mass makes up for its bending."""
    strip = fc.Cloth.rectangle(0.5, 0.1, h=0.05, pattern="equilateral")
    fabric = fc.Fabric(0.2, 1000.0, 0.3, bending_rigidity=1e-3)
    system = fc.System(strip, fabric, [fc.StVK(), fc.HingeBending(), fc.Gravity()], ["left"])
    newton = fc.Newton(tolerance=1e-9)
    run = fc.run(system, fc.BackwardEuler(), system.rest(), 100.0, 100.0, newton=newton)
    assert run.newton < 100
    end = fc.equilibrium(system, run.state).x
    np.testing.assert_allclose(run.state.x, end, atol=1e-5)
    assert end[:, 2].min() < -0.02


@pytest.mark.parametrize(
    ("touches", "length", "ends"), [(True, 1 / 33, 10), (True, 1 / 31, 15), (False, 1 / 33, 15)]
)
def test_an_iteration_that_creeps_in_contact_ends_early(touches, length, ends, monkeypatch):
    """Ten steps in a row shorter than 1/32 are a failure, so that a shorter dt is tried."""
    cloth = fc.Cloth.rectangle(0.1, 0.1, 0.1, "right")
    floor = [fc.Obstacle(fc.shapes.Plane((0, 0, -1), (0, 0, 1)))] if touches else []
    system = fc.System(cloth, fc.Fabric(0.2, 100.0, 0.3), [fc.StVK(), fc.Gravity(), *floor])
    lengths = []

    def shorten(sums, at, start, step, **others):
        lengths.append(length)
        return at(start.y + length * step), length

    monkeypatch.setattr("fecloth.nonlinear.steps.find_step", shorten)
    options = fc.Newton(tolerance=1e-12, max_iterations=15, reuse=False)
    solver, _ = solver_for(system, fc.BackwardEuler(), 0.01, "direct", options)
    with pytest.raises(NewtonFailed, match="creeps: 10 steps" if ends == 10 else "in 15 iter"):
        fc.BackwardEuler().step(system, system.rest(), 0.01, solver)
    assert len(lengths) == ends


def test_quadratic_convergence_on_a_taut_cloth(sheet, isotropic, rng):
    system = fc.System(sheet, isotropic, [fc.StVK()], pins=["boundary"])
    x = affine(sheet, [[1.2, 0.0], [0.0, 1.2], [0.0, 0.0]])
    start = system.state(x, system.constraints.project(rng.standard_normal(x.shape)))
    norms = residuals(system, fc.BackwardEuler(), start, 0.01, np.zeros_like(x))
    tail = norms[(norms < 1e-1) & (norms > 1e-11)]
    assert len(tail) >= 2
    assert (tail[1:] < 20 * tail[:-1] ** 2).all()
