"""The companion of a run: the error in time by the same run with other steps."""

import numpy as np
import pytest

import fecloth as fc
from fecloth.linalg.reductions import rms
from fecloth.simulation.time_error import TimeError

# steps are coarse and meshes small by intent
pytestmark = pytest.mark.filterwarnings("ignore::fecloth.errors.FeclothWarning")


def swing(pin="left"):
    """A sheet that falls from its held edge, and its start."""
    cloth = fc.Cloth.rectangle(0.4, 0.2, h=0.1, pattern="right")
    system = fc.System(cloth, fc.Fabric(0.2, 100.0), [fc.StVK(), fc.Gravity()], [pin])
    return system, system.rest()


def places(system, method, start, dt, t_end):
    """The positions after each step, by their times to nine digits."""
    seen = {}
    fc.run(
        system, method, start, dt, t_end,
        report=lambda info: seen.update({round(info.t, 9): info.result.state.x}),
    )  # fmt: skip
    return seen


@pytest.mark.parametrize(
    ("method", "dt", "other"),
    [
        (fc.BackwardEuler(), 0.01, 0.02),
        (fc.BDF2(), 0.01, 0.02),
        (fc.ImplicitMidpoint(), 0.01, 0.02),
        pytest.param(fc.CentralDifference(), 0.001, 0.0005, marks=pytest.mark.stories),
    ],
    ids=str,
)
def test_it_is_the_run_with_double_steps_or_half_steps_of_explicit_methods(method, dt, other):
    system, start = swing()
    result = fc.run(system, method, start, dt, 0.2, time_error="companion")
    own, others = (places(system, method, start, size, 0.2) for size in (dt, other))
    apart = [rms(system.diagonal_mass, own[t] - others[t]) for t in own.keys() & others.keys()]
    error = result.accounts[TimeError]
    tolerance = 0.1 if method.traits.explicit else 1e-3  # it looks at some of the steps
    assert error.estimate.whole == pytest.approx(max(apart), rel=tolerance)
    assert result.time_error == pytest.approx(error.estimate.whole / error.moved)
    assert 0 < result.deformation_error < 1


def test_it_goes_on_where_a_pin_lets_go():
    system, start = swing(fc.Pin("left", until=0.05))
    result = fc.run(system, fc.BDF2(), start, 0.01, 0.2, time_error="companion")
    companion = result.accounts[TimeError].estimate
    assert companion.state.t == result.state.t
    assert companion.state.x[:, 2].max() < -1e-3
    assert 0 < result.time_error < 0.5


def test_the_same_run_with_and_without_a_companion():
    system, start = swing()
    ends = [
        fc.run(system, fc.BDF2(), start, 0.01, 0.1, time_error=name).state.x
        for name in ("sampled", "companion", "none")
    ]
    assert np.array_equal(ends[0], ends[1])
    assert np.array_equal(ends[0], ends[2])
