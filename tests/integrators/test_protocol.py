"""What wraps a method offers what the method does."""

import pytest

import fecloth as fc
from fecloth.integrators.protocol import StepChoice
from fecloth.simulation.fixed_step import FixedStep
from fecloth.simulation.stability_limited import StabilityLimited


def members(kind):
    """The names that a protocol asks for."""
    bases = [base for base in kind.__mro__ if getattr(base, "_is_protocol", False)]
    names = {name for base in bases for name in [*vars(base), *base.__annotations__]}
    return {name for name in names if not name.startswith("_")}


def lacks(made, kind):
    return [name for name in members(kind) if not hasattr(made, name)]


@pytest.mark.parametrize("method", [fc.CentralDifference(), fc.SymplecticEuler()])
def test_wrappers_hand_on_the_traits(method):
    for wrapper in StabilityLimited(method), fc.Adaptive(method), FixedStep(method, 0.1):
        assert not lacks(wrapper, StepChoice)
        assert wrapper.traits.chooses_dt
        for name in ("order", "theta", "explicit", "symmetric", "error_constant", "stability"):
            assert getattr(wrapper.traits, name) == getattr(method.traits, name)
