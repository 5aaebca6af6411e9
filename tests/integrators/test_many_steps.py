"""Many steps in one compiled call are the steps of `CentralDifference`, to round-off."""

import numba
import numpy as np
import pytest
from conftest import affine
from support.tiers import stories_except

import fecloth as fc
from fecloth.compiled.team import SMALLEST_SHARED_LOOP
from fecloth.integrators.many_steps import AT_ONCE

CLOTH = {"width": 0.4, "height": 0.3, "h": 0.1}


@pytest.mark.parametrize("pins", [[], ["left", fc.Slide("right", normal=(1.0, 0.5, 0.2))]])
def test_equals_single_steps(pins, orthotropic, rng):
    """Also where the start moves what is held; the time is that of the last step."""
    cloth = fc.Cloth.rectangle(**CLOTH)
    system = fc.System(cloth, orthotropic, [fc.Gravity((1, 2, 3)), fc.StVK()], pins, grain=0.3)
    x = affine(cloth, [[1.1, 0.0], [0.0, 1.1], [0.0, 0.1]])
    start = system.state(x, rng.standard_normal(x.shape), t=0.5)
    kept = start.x.copy(), start.v.copy()
    end = fc.many_steps(system, start, 1e-4, 200)
    assert np.array_equal(kept, (start.x, start.v))
    started = fc.State(start.t, start.x, system.constraints.hold(start.v, 0 * start.v))
    *_, (slow, _) = fc.march(system, fc.CentralDifference(), started, 1e-4, 0.52)
    assert end.t == pytest.approx(0.52, abs=1e-15)
    assert abs(slow.x - start.x).max() > 0.01
    np.testing.assert_allclose(end.x, slow.x, rtol=0, atol=1e-12)
    np.testing.assert_allclose(end.v, slow.v, rtol=0, atol=1e-9)
    if pins:
        left, right = cloth.nodes("left"), cloth.nodes("right")
        assert np.array_equal(end.x[left], start.x[left])
        assert abs((end.x - start.x)[right] @ [1.0, 0.5, 0.2]).max() < 1e-14


@pytest.mark.parametrize("steps", stories_except([1, 50, 51], 51))
@pytest.mark.parametrize("renumber", [True, False])
def test_two_threads_give_the_same_bits_as_one(renumber, steps, orthotropic, rng):
    """Also on a mesh numbered at random, where one thread does all triangles."""
    sheet = fc.Cloth.rectangle(1.0, 0.6, h=0.025)
    order = rng.permutation(len(sheet.X))
    triangles = np.argsort(order)[rng.permutation(sheet.triangles)]
    cloth = fc.Cloth.from_arrays(sheet.X[order], triangles, renumber=renumber)
    pins = [fc.Pin(lambda X: X[:, 0] < 0.01), fc.Slide(lambda X: X[:, 0] > 0.99, normal=(1, 2, 3))]
    system = fc.System(cloth, orthotropic, [fc.StVK(), fc.Gravity()], pins)
    x = affine(cloth, [[1.1, 0.0], [0.0, 1.1], [0.0, 0.1]])
    assert len(x) > SMALLEST_SHARED_LOOP
    start = system.state(x, rng.standard_normal(x.shape))
    numba.set_num_threads(1)  # what the caller has chosen for its own loops
    alone, shared, again = (fc.many_steps(system, start, 1e-4, steps, threads=t) for t in (1, 2, 2))
    assert numba.get_num_threads() == 1
    assert abs(alone.x - start.x).max() > 1e-5
    assert np.array_equal(alone.x, shared.x)
    assert np.array_equal(alone.v, shared.v)
    assert np.array_equal(shared.x, again.x)
    assert np.array_equal(shared.v, again.v)


@pytest.mark.stories
@pytest.mark.parametrize(
    "terms",
    [
        [fc.NeoHookean(), fc.HingeBending(), fc.MassDamping(3.0)],
        [fc.Springs(), fc.StrainRateDamping(1e-5)],
    ],
)
def test_any_compiled_terms_and_moved_pins_are_served(terms, rng):
    """More steps than are kept at once, with forces that see the velocity."""
    fabric = fc.Fabric(0.2, 1000.0, 0.3, bending_rigidity=1e-4)
    pins = [fc.Pin("left", ["0", "0.1*sin(50*t)", "0"])]
    system = fc.System(fc.Cloth.rectangle(**CLOTH), fabric, terms, pins)
    start, method = system.state(1.05 * system.rest().x), fc.CentralDifference()
    steps = AT_ONCE + 100
    *_, (slow, _) = fc.march(system, method, start, 1e-6, steps * 1e-6)
    end = fc.many_steps(system, start, 1e-6, steps)
    assert end.t == pytest.approx(slow.t, abs=1e-12)
    assert abs(end.x - start.x).max() > 1e-3
    np.testing.assert_allclose(end.x, slow.x, rtol=0, atol=1e-11)
    np.testing.assert_allclose(end.v, slow.v, rtol=0, atol=1e-7)


def test_a_step_beyond_the_limit_is_a_failure_and_no_state():
    cloth = fc.Cloth.rectangle(1.0, 0.5, h=0.1)
    fabric = fc.Fabric(areal_density=0.2, tensile_stiffness=1000.0)
    system = fc.System(cloth, fabric, [fc.StVK(), fc.Gravity()], pins=["left"])
    start = system.state(1.05 * system.rest().x)
    dt = 3 * fc.critical_dt(system, start)
    with pytest.raises(fc.StepFailed, match="not finite.*critical_dt") as failure:
        fc.many_steps(system, start, dt, 2000)
    assert failure.value.state is start
