"""Joined calls of a stage: the bits of the calls one by one, in steps of all implicit methods."""

import numpy as np
import pytest
from support.tiers import in_turn

import fecloth as fc
from fecloth.linalg.block_matrix import BlockMatrix
from fecloth.nonlinear.joined_stage import JoinedStage
from fecloth.nonlinear.last_stage import LastStage
from fecloth.nonlinear.newton import StageEquation
from fecloth.nonlinear.remedies import Remedy
from fecloth.nonlinear.stage import Stage

CLOTH = fc.Cloth.rectangle(0.4, 0.3, h=0.08, pattern="unstructured")
FABRIC = fc.Fabric(0.2, 500.0, 0.3, bending_rigidity=1e-4)
TERMS = {
    "plate": [fc.StVK(), fc.PlateBending(rest=0.1), fc.Gravity((0.2, 0.0, -9.81))],
    "hinges": [fc.NeoHookean(), fc.HingeBending(), fc.BendingDamping(0.01), fc.Gravity()],
    "damped": [fc.TensorCondition(200.0), fc.StrainRateDamping(0.02), fc.MassDamping(0.5)],
    "wind": [fc.StVK(), fc.Wind(("3 + sin(9 * t)", "x * z", "0.5"), normal=0.7, tangential=0.1)],
    "pressure": [fc.StVK(), fc.Pressure("20 + 300 * t"), fc.PointForce([4], ("t", 0.1, "-t"))],
    "springs": [fc.Springs(kind="structural", stiffness=100.0), fc.Drag(0.7), fc.Gravity()],
}
METHODS = [fc.BDF2(), fc.BackwardEuler(), fc.ImplicitMidpoint(), fc.GeneralizedAlpha(0.8)]

PAIRS = [*in_turn([*TERMS], METHODS), *in_turn([*TERMS], [*METHODS[2:], *METHODS[:2]])]


def make_system(terms, cloth=CLOTH, **options):
    pins = [fc.Pin("left"), fc.Slide("right", direction=(1.0, 0.5, 0.2))]
    return fc.System(cloth, FABRIC, terms, pins=pins, threads=1, **options)


def bent(system, amplitude=0.02):
    X = system.cloth.X
    x = np.column_stack([X, amplitude * np.sin(9 * X[:, 0]) * np.cos(7 * X[:, 1])])
    x[system.constraints.nodes] = system.rest().x[system.constraints.nodes]
    return x


def march(system, method, steps=6, dt=4e-3):
    start = system.state(bent(system))
    states = fc.march(system, method, start, dt=dt, t_end=steps * dt, solver="pcg")
    return [(state.x, state.v, info.counts.newton) for state, info in states]


@pytest.mark.parametrize(("name", "method"), PAIRS, ids=repr)
def test_steps_have_the_bits_of_single_calls(name, method, monkeypatch):
    made = []
    original = JoinedStage.of.__func__

    def record(cls, *arguments):
        made.append(original(cls, *arguments))
        return made[-1]

    monkeypatch.setattr(JoinedStage, "of", classmethod(record))
    system = make_system(TERMS[name])
    joined = march(system, method)
    assert made
    assert made[-1] is not None
    assert len(made) <= 2  # the calls of a step serve the next ones
    monkeypatch.setattr(LastStage, "_join", lambda *arguments: None)
    single = march(system, method)
    for (x, v, newton), (x1, v1, newton1) in zip(joined, single, strict=True):
        assert newton == newton1
        np.testing.assert_array_equal(x, x1)
        np.testing.assert_array_equal(v, v1)


@pytest.mark.parametrize("method", [fc.BDF2(), fc.BackwardEuler()], ids=repr)
def test_the_ledger_takes_the_last_forces_of_the_solution(method, monkeypatch):
    """Its columns have the bits of forces that are evaluated again."""
    system = make_system([*TERMS["damped"], *TERMS["wind"]])
    start = system.state(bent(system))
    evaluated = []
    force = fc.System.force

    def count(system, state):
        evaluated.append(state)
        return force(system, state)

    monkeypatch.setattr(fc.System, "force", count)
    joined = fc.run(system, method, start, dt=4e-3, t_end=0.02, solver="pcg").energies
    count_joined = len(evaluated)
    monkeypatch.setattr(LastStage, "_join", lambda *arguments: None)
    evaluated.clear()
    single = fc.run(system, method, start, dt=4e-3, t_end=0.02, solver="pcg").energies
    for name, values in joined.items():
        np.testing.assert_array_equal(values, single[name], err_msg=name)
    if isinstance(method, fc.BDF2):
        assert count_joined < len(evaluated)


def stage_of(system, weights=(1e-5, 3e-3, 0.9)):
    wx, wv, wa = weights
    x = bent(system)
    v = np.random.default_rng(1).normal(size=x.shape)
    a = np.random.default_rng(2).normal(size=x.shape)
    return Stage(0.3, x, v, a, wx, wv, wa, x, wx)


def begun(system):
    """The last stage of a system at the begin of a step, and its matrix."""
    J, last = BlockMatrix.zeros(system.pattern), LastStage()
    last.begin(system, stage_of(system), J)
    return last, J


@pytest.mark.parametrize("definite", [False, True])
@pytest.mark.parametrize("name", TERMS)
@pytest.mark.parametrize("mass", ["lumped", "consistent"])
def test_residual_tangent_and_potential_have_the_bits_of_single_calls(name, mass, definite):
    system = make_system(TERMS[name], mass=mass)
    stage = stage_of(system)
    (last, J), (one_by_one, _) = begun(system), begun(system)
    assert last.joined is not None
    fast = StageEquation(system, stage, "on_failure", last)
    one_by_one.joined = None
    plain = StageEquation(system, stage, "on_failure", one_by_one)
    q = 0.1 * np.random.default_rng(3).normal(size=stage.x.shape)
    R, scale = fast.residual(q, 0.0)
    expected, expected_scale = plain.residual(q, 0.0)
    np.testing.assert_array_equal(R, expected)
    assert scale == expected_scale
    np.testing.assert_array_equal(fast.residual(q, 1.0)[0], plain.residual(q, 1.0)[0])
    expected_J = BlockMatrix.zeros(system.pattern)
    remedy = Remedy(0.25, definite)
    fast.assemble(q, remedy, J)
    plain.assemble(q, remedy, expected_J)
    np.testing.assert_array_equal(J.values, expected_J.values)
    if plain.potential:
        assert fast.potential(q) == plain.potential(q)


def test_calls_serve_other_weights_times_and_unknowns():
    system = make_system(TERMS["pressure"])
    last, J = begun(system)
    first = last.joined
    assert first is not None
    stage = stage_of(system, weights=(2e-5, 1e-3, 0.4))
    last.begin(system, stage, J)
    assert last.joined is first
    q = np.ones_like(stage.x)
    fast = StageEquation(system, stage, "none", last)
    plain = StageEquation(system, stage, "none")
    np.testing.assert_array_equal(fast.residual(q, 1.0)[0], plain.residual(q, 1.0)[0])


def test_a_kept_tangent_serves_three_iterations():
    """The tangent of the plate is evaluated anew in the first and the fourth iteration only."""
    system = make_system(TERMS["plate"])
    last, J = begun(system)
    exact = Remedy(0.0, False)
    assert last.kept is not None
    plates = []
    for shift in range(4):
        equation = StageEquation(system, stage_of(system), "none", last)
        q = 20.0 * shift * np.random.default_rng(3).normal(size=J.pattern.diagonal.shape + (3,))
        equation.assemble(q, exact, J)
        plates.append(last.kept.matrix.values.copy())
    np.testing.assert_array_equal(plates[1], plates[0])
    np.testing.assert_array_equal(plates[2], plates[0])
    assert abs(plates[3] - plates[0]).max() > 1e-3 * abs(plates[0]).max()


def test_a_kept_tangent_is_evaluated_anew_for_a_definite_matrix_and_in_each_step():
    system = make_system(TERMS["plate"])
    last, J = begun(system)
    assert last.kept is not None
    needed = [last.kept.must_renew(definite) for definite in (False, False, True, True, False)]
    assert needed == [True, False, True, False, True]
    last.begin(system, stage_of(system), J)
    assert last.kept.must_renew(False)


def test_a_term_of_python_is_called_one_by_one():
    force = fc.UserForce(lambda x, v, t: -0.01 * v)
    system = make_system([fc.StVK(), force])
    last, _ = begun(system)
    assert last.joined is None


def test_mass_is_added_to_a_matrix_that_holds_the_tangents():
    """The matrix with σ M added is the matrix assembled with σ M, also of held nodes."""
    system = make_system(TERMS["plate"])
    stage = stage_of(system)
    equation = StageEquation(system, stage, "on_failure")
    q = np.zeros_like(stage.x)
    J, expected = (BlockMatrix.zeros(system.pattern) for _ in range(2))
    weak, strong = Remedy(0.25, False), Remedy(4.0, False)
    equation.assemble(q, weak, J)
    system.add_mass(J, equation.mass_weight(strong) - equation.mass_weight(weak))
    equation.assemble(q, strong, expected)
    np.testing.assert_allclose(J.values, expected.values, rtol=0, atol=1e-13)
    assert abs(expected.values).max() > 0.01
