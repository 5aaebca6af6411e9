"""What the package's methods, linear solvers and terms offer is what the protocols say."""

import numpy as np
import pytest

import fecloth as fc
from fecloth.integrators import EXPLICIT, METHODS, MethodTraits
from fecloth.integrators.protocol import ExplicitIntegrator, Integrator, StepChoice
from fecloth.linalg import select
from fecloth.linalg.block_matrix import BlockPattern
from fecloth.linalg.protocol import LinearSolver
from fecloth.simulation.fixed_step import FixedStep
from fecloth.simulation.stability_limited import StabilityLimited


def members(one):
    """The names that a protocol asks for."""
    bases = [base for base in one.__mro__ if getattr(base, "_is_protocol", False)]
    names = {name for base in bases for name in [*vars(base), *base.__annotations__]}
    return {name for name in names if not name.startswith("_")}


def lacks(made, one):
    return [name for name in members(one) if not hasattr(made, name)]


@pytest.mark.parametrize("cls", METHODS.values())
def test_implicit_methods_are_integrators(cls):
    assert members(Integrator) == {"traits", "step", "numerical"}
    assert not lacks(cls(), Integrator)
    assert isinstance(cls().traits, MethodTraits)


@pytest.mark.parametrize("cls", EXPLICIT.values())
def test_explicit_methods_are_explicit_integrators(cls):
    assert not lacks(cls(), ExplicitIntegrator)
    assert cls().traits.explicit
    assert not cls().traits.beyond_limit
    assert cls(beyond_limit=True).traits.beyond_limit


@pytest.mark.parametrize("method", [fc.CentralDifference(), fc.SymplecticEuler()])
def test_wrappers_hand_on_the_traits(method):
    for wrapper in StabilityLimited(method), fc.Adaptive(method), FixedStep(method, 0.1):
        assert not lacks(wrapper, StepChoice)
        assert wrapper.traits.chooses_dt
        for name in ("order", "theta", "explicit", "symmetric", "error_constant", "stability"):
            assert getattr(wrapper.traits, name) == getattr(method.traits, name)


def test_linear_solvers_are_linear_solvers():
    pattern = BlockPattern.union(2, [np.array([[0, 1]], dtype=np.int32)])
    kinds = select.PCG, select.SuperLU, select.Rslab, select.direct, select.Multigrid
    solvers = [*(kind() for kind in kinds), select.choose(pattern, True)[0]]
    for solver in solvers:
        assert not lacks(solver, LinearSolver)
    assert [solver.keeps_state for solver in solvers] == [False, False, False, False, True, True]
