"""Steps whose sizes are given: they repeat a run whose steps were chosen."""

import numpy as np
import pytest

import fecloth as fc

# steps are coarse and meshes small by intent
pytestmark = pytest.mark.filterwarnings("ignore::fecloth.errors.FeclothWarning")

EXACT = fc.Newton(tolerance=1e-9, reuse=False)


@pytest.fixture(scope="module")
def system():
    cloth = fc.Cloth.rectangle(1.0, 0.5, h=0.25, pattern="right")
    terms = [fc.StVK(), fc.StrainRateDamping(2e-3), fc.Gravity()]
    return fc.System(cloth, fc.Fabric(0.2, 1000.0), terms, pins=["left"])


def taken(system, method, dt=None, t_end=0.2, **known):
    solver = {} if method.traits.explicit else {"solver": "direct", "newton": EXACT}
    return list(fc.march(system, method, system.rest(), dt, t_end, **solver, **known))


def same(first, second):
    return (
        first.t == second.t
        and np.array_equal(first.x, second.x)
        and np.array_equal(first.v, second.v)
    )


@pytest.mark.parametrize(
    "method",
    [
        fc.Adaptive(fc.BDF2(), rtol=1e-2),
        fc.Adaptive(fc.ImplicitMidpoint(), rtol=3e-2),
        fc.Adaptive(fc.GeneralizedAlpha(), rtol=1e-2),
        fc.Adaptive(fc.CentralDifference(), rtol=1e-2),
        fc.CentralDifference(),
    ],
    ids=str,
)
def test_a_run_with_chosen_steps_is_repeated_bit_for_bit(method, system):
    stops = [0.03, 0.11]
    chosen = taken(system, method, stops=stops)
    sizes = [info.size for _, info in chosen]
    assert np.ptp(sizes) > 0
    inner = getattr(method, "method", method)
    again = taken(system, inner, sizes, stops=stops)
    assert len(again) == len(chosen)
    for (first, _), (second, info) in zip(chosen, again, strict=True):
        assert same(first, second)
        assert info.size in sizes
    without_end = taken(system, inner, np.array(sizes), None, stops=stops)
    assert np.array_equal(without_end[-1][0].x, chosen[-1][0].x)


def test_a_list_with_one_step_beyond_the_stability_limit_is_refused(system):
    limit = fc.critical_dt(system, system.rest(), fc.CentralDifference())
    with pytest.raises(fc.InputError, match="beyond it CentralDifference is unstable"):
        taken(system, fc.CentralDifference(), [0.1 * limit, 1.25 * limit], None)
    assert len(taken(system, fc.CentralDifference(), [0.1 * limit, 0.8 * limit], None)) == 2


def test_it_goes_on_from_its_memory(system):
    sizes = 1e-3 * (1 + np.arange(12) % 3)
    steps = taken(system, fc.BDF2(), sizes, None)
    state, info = steps[4]
    on = list(
        fc.march(system, fc.BDF2(), state, sizes, solver="direct", newton=EXACT, memory=info.memory)
    )
    assert len(on) == 7
    assert same(on[-1][0], steps[-1][0])


def test_a_run_ends_at_the_sum_of_its_steps(system):
    sizes = [1e-3, 2e-3, 3e-3]
    result = fc.run(system, fc.BackwardEuler(), system.rest(), sizes, solver="direct")
    assert result.times == pytest.approx([0.0, 1e-3, 3e-3, 6e-3])
    assert repr(result.method) == "GivenSteps(BackwardEuler(), 3 of 0.001 to 0.003 s)"
    equal = fc.run(system, fc.BackwardEuler(), system.rest(), [2e-3] * 5, 0.01, solver="direct")
    fixed = fc.run(system, fc.BackwardEuler(), system.rest(), 2e-3, 0.01, solver="direct")
    np.testing.assert_allclose(equal.state.x, fixed.state.x, rtol=0, atol=1e-14)
