"""Many steps in one compiled call are the steps of `CentralDifference`, to round-off."""

import numpy as np
import pytest
from conftest import affine

import fecloth as fc

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


@pytest.mark.parametrize(
    ("terms", "options", "what"),
    [
        ([fc.Gravity()], {}, "0 StVK terms"),
        ([fc.StVK(), fc.StVK()], {}, "2 StVK terms"),
        ([fc.StVK(), fc.StrainRateDamping(0.1)], {}, "term StrainRateDamping"),
        ([fc.NeoHookean()], {}, "term NeoHookean"),
        ([fc.StVK()], {"mass": "consistent"}, "mass = 'consistent'"),
        ([fc.StVK()], {"pins": [fc.Pin("left", lambda t: [t, 0, 0])]}, "pin 'left' is moved"),
    ],
)
def test_refuses_what_it_cannot_do(terms, options, what, isotropic):
    system = fc.System(fc.Cloth.rectangle(**CLOTH), isotropic, terms, **options)
    with pytest.raises(fc.InputError, match=f"many_steps: {what}"):
        fc.many_steps(system, system.rest(), 1e-4, 10)


@pytest.mark.parametrize(("dt", "steps"), [(0.0, 1), (np.nan, 1), (1e-4, 0), (1e-4, 1.5)])
def test_refuses_what_is_no_number_of_steps(dt, steps, isotropic):
    system = fc.System(fc.Cloth.rectangle(**CLOTH), isotropic, [fc.StVK()])
    with pytest.raises(fc.InputError, match="many_steps: (dt|steps) = "):
        fc.many_steps(system, system.rest(), dt, steps)


def test_a_step_beyond_the_limit_is_a_failure_and_no_state():
    cloth = fc.Cloth.rectangle(1.0, 0.5, h=0.1)
    fabric = fc.Fabric(areal_density=0.2, tensile_stiffness=1000.0)
    system = fc.System(cloth, fabric, [fc.StVK(), fc.Gravity()], pins=["left"])
    start = system.state(1.05 * system.rest().x)
    dt = 3 * fc.critical_dt(system, start)
    with pytest.raises(fc.StepFailed, match="not finite.*critical_dt") as failure:
        fc.many_steps(system, start, dt, 2000)
    assert failure.value.state is start
