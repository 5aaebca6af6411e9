"""Steps by their error: the tolerance is what comes out, and what is too long is tried shorter."""

from dataclasses import dataclass, replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import fecloth as fc
from fecloth.integrators import EXPLICIT, METHODS
from fecloth.nonlinear.newton import NewtonFailed
from fecloth.simulation.within_step import LOADS, PINS, deviation_within_step

# steps are coarse and meshes small by intent
pytestmark = pytest.mark.filterwarnings("ignore::fecloth.errors.FeclothWarning")

T_END = 0.15
TIGHT = fc.Newton(tolerance=1e-11)
SECOND = 10.0 ** -np.array([1.0, 2.0, 3.0])
FIRST = 10.0 ** -np.array([0.5, 1.25, 2.0])


@pytest.fixture(scope="module")
def swing():
    """A soft damped flag that falls, and where it is at the end by an independent method."""
    cloth = fc.Cloth.rectangle(0.4, 0.3, h=0.15, pattern="cross")
    fabric = fc.Fabric(0.2, tensile_stiffness=20.0, poisson_ratio=0.3, bending_rigidity=1e-4)
    terms = [fc.StVK(), fc.HingeBending(), fc.StrainRateDamping(time=0.01), fc.Gravity()]
    system = fc.System(cloth, fabric, terms, pins=["left"])
    x, y = cloth.X.T
    start = system.state(np.column_stack([1.02 * x, y, 0.02 * x]))
    return system, start, independent(system, start)


def independent(system, start):
    """x at T_END by an explicit Runge-Kutta method of order 8 on the free degrees of freedom."""
    free, mass = system.free, np.repeat(system.nodal_mass, 3)[system.free]

    def full(values, rest):
        whole = rest.ravel().copy()
        whole[free] = values
        return whole.reshape(-1, 3)

    def rate(t, y):
        x, v = np.split(y, 2)
        f = system.force(fc.State(t, full(x, start.x), full(v, start.v)))
        return np.concatenate([v, f.ravel()[free] / mass])

    y0 = np.concatenate([start.x.ravel()[free], start.v.ravel()[free]])
    result = solve_ivp(rate, (0, T_END), y0, method="DOP853", rtol=1e-11, atol=1e-13)
    return full(result.y[: len(free), -1], start.x)


def rms(system, y):
    return np.sqrt(system.nodal_mass @ (y**2).sum(axis=1) / system.nodal_mass.sum())


CASES = {name: method() for name, method in {**METHODS, **EXPLICIT}.items()}
del CASES["forward_euler"]  # no stable step
SHIFT = {"symplectic_euler": 0.1, "central_difference": 1e-3}  # steps are shorter than the limit


@pytest.mark.stories
@pytest.mark.parametrize("name", CASES)
def test_the_error_is_proportional_to_the_tolerance(swing, name, record_property):
    system, start, exact = swing
    method = CASES[name]
    tolerances, errors = SHIFT.get(name, 1.0) * (SECOND if method.traits.order == 2 else FIRST), []
    for rtol in tolerances:
        adaptive = fc.Adaptive(method, rtol)
        *_, (end, _) = fc.march(system, adaptive, start, t_end=T_END, newton=TIGHT)
        errors.append(rms(system, end.x - exact))
    slope, level = np.polyfit(np.log(tolerances), np.log(errors), 1)
    off = np.exp(np.abs(np.log(errors) - level - slope * np.log(tolerances)).max())
    record_property("slope", float(slope))
    print(
        f"{name}: slope {slope:.3f}, off by {off:.2f}, {errors[-1] / tolerances[-1]:.2g} m of rtol"
    )
    assert slope == pytest.approx(1.0, abs=0.15)
    assert off < 1.5


@dataclass(frozen=True)
class Fails(fc.ImplicitMidpoint):
    """A method whose Newton fails for steps beyond 1 ms."""

    def step(self, system, state, dt, solver, memory=None):
        if dt > 1e-3:
            raise NewtonFailed("too long", 1.0, "")
        return super().step(system, state, dt, solver, memory)


def test_a_step_that_newton_cannot_solve_is_tried_shorter(swing):
    system, start, _ = swing
    steps = [info for _, info in fc.march(system, fc.Adaptive(Fails(), 1.0), start, t_end=0.02)]
    assert max(info.dt for info in steps) <= 1e-3
    assert sum(info.counts.rejected for info in steps) > 0
    assert steps[-1].t == 0.02


def test_a_step_with_too_large_an_error_is_rejected(swing):
    """A push out of a smooth swing: the step that meets it was chosen without it."""
    system, start, _ = swing

    def push(x, v, t):
        return np.full_like(x, 1.0 if t > 0.1 else 0.0)

    pushed = system.replace(terms=[*system.terms, fc.UserForce(push)])
    adaptive = fc.Adaptive(fc.ImplicitMidpoint(), 1e-2)
    infos = [info for _, info in fc.march(pushed, adaptive, start, t_end=T_END)]
    rejected = [info for info in infos if info.counts.rejected]
    assert abs(rejected[0].old.t - 0.1) < rejected[0].old.t - infos[rejected[0].step - 3].old.t
    assert rejected[0].dt < 0.7 * infos[rejected[0].step - 2].dt


@pytest.mark.parametrize("moved", [False, True], ids=["falls", "is pulled"])
def test_first_step_accounts_for_moving_pins(moved):
    """At rest nothing pulls yet: the step is found by a short flight, not by trial and error."""
    cloth = fc.Cloth.disk(0.5, h=0.1)
    pin = fc.Pin("boundary", (lambda t: [0.0, 0.0, 0.1 * np.sin(9 * t)]) if moved else None)
    terms = [fc.StVK()] if moved else [fc.StVK(), fc.Gravity()]
    system = fc.System(cloth, fc.Fabric(0.2, 1000.0, 0.3), terms, [pin])
    adaptive = fc.Adaptive(fc.GeneralizedAlpha(), 1e-2)
    _, first = next(iter(fc.march(system, adaptive, system.rest(), t_end=1.0)))
    assert first.counts.rejected == 0
    assert first.dt > 1e-4


def test_unresolvable_step_is_an_error(swing):
    system, start, _ = swing

    @dataclass(frozen=True)
    class Never(fc.ImplicitMidpoint):
        def step(self, *args):
            raise NewtonFailed("never", 1.0, "")

    with pytest.raises(fc.StepFailed, match="short enough: .*never.*jump here.*fixed dt"):
        list(fc.march(system, fc.Adaptive(Never()), start, t_end=T_END))


@pytest.mark.parametrize("method", [fc.BDF2(), fc.CentralDifference()], ids=repr)
def test_it_lands_on_the_stops_exactly(swing, method):
    system, start, _ = swing
    stops = [0.05, 0.0333, 0.1]
    adaptive = fc.Adaptive(method, 1e-2)
    times = [s.t for s, _ in fc.march(system, adaptive, start, t_end=T_END, stops=stops)]
    assert {0.0333, 0.05, 0.1, T_END} <= set(times)
    sizes = np.diff([0.0, *times])
    assert sizes.min() > 0.2 * np.median(sizes)  # no slivers before the stops


def test_fixed_steps_land_on_them_too(swing):
    system, start, _ = swing
    march = fc.march(system, fc.ImplicitMidpoint(), start, 0.04, 0.1, stops=[0.05])
    assert [s.t for s, _ in march] == pytest.approx([0.04, 0.05, 0.09, 0.1], abs=1e-15)


# --- what the ends of a step do not show ----------------------------------------------------------


def test_motions_and_loads_within_a_step_deviate_from_what_its_ends_say(small, isotropic):
    """t⁴ from its Hermite cubic by s² (1 − s)² dt⁴, a force t² m from its line by s (1 − s) dt²."""

    def told(dt=0.3, **given):
        system = fc.System(small, isotropic, **given)
        before, after = (replace(system.rest(), t=t) for t in (0.5, 0.5 + dt))
        return deviation_within_step(system, before, SimpleNamespace(state=after))

    for power, moved in ((3, 0.0), (4, max(s**2 * (1 - s) ** 2 for s in PINS) * 0.3**4)):
        pin = fc.Pin("left", (0, 0, f"t**{power}"))
        assert told(terms=[], pins=[pin])[0] == pytest.approx(moved, abs=1e-15)
    push = fc.UserForce((0, 0, "t**2"), per="mass")
    assert told(terms=[push])[1] == pytest.approx(max(s * (1 - s) for s in LOADS) * 0.3**2)


def quiet_sheet(motion=None, load=None):
    cloth, fabric = fc.Cloth.rectangle(0.6, 0.3, h=0.1, pattern="right"), fc.Fabric(0.2, 200.0, 0.3)
    terms = [fc.StVK(), fc.StrainRateDamping(time=0.005), *([fc.UserForce(load)] if load else [])]
    return fc.System(cloth, fabric, terms, [fc.Pin("left", motion)])


def pulse(t):
    return (0.0, 0.0, 0.05 * np.sin(20 * (t - 0.3)) ** 2 if 0.3 < t < 0.3 + np.pi / 20 else 0.0)


@pytest.mark.stories
@pytest.mark.parametrize("method", [fc.BDF2(), fc.ImplicitMidpoint(), fc.BackwardEuler()], ids=repr)
def test_pin_motion_within_a_quiet_step_is_resolved(method):
    """The cloth is at rest until 0.3 s: its own motion gives no reason for short steps."""
    system = quiet_sheet(motion=pulse)
    rtol = 1e-2 if method.traits.order == 2 else 0.03
    peak = peak_of(system, fc.Adaptive(method, rtol))
    assert peak == pytest.approx(resolved_peak(), rel=0.1)


def peak_of(system, method):
    result = fc.run(system, method, system.rest(), t_end=0.5)
    return abs(result.observed["mean_displacement.z"]).max()


@cache
def resolved_peak():
    """With many short steps."""
    return peak_of(quiet_sheet(motion=pulse), fc.CentralDifference())


def test_a_smooth_motion_is_no_reason_for_short_steps():
    """A slow pull: what is looked for inside the steps leaves their number as it is."""
    system = quiet_sheet(motion=lambda t: (-0.01 * np.sin(t), 0.0, 0.0))
    result = fc.run(system, fc.Adaptive(fc.BDF2(), 1e-2), system.rest(), t_end=2.0)
    assert len(result.times) < 120


def test_steps_below_the_round_off_of_the_time_fail(small, isotropic):
    system = fc.System(small, isotropic, [fc.StVK(), fc.Gravity()], ["left"])
    late = system.state(system.rest().x, t=1e12)  # where the last bit is 1.2e-4 s
    with pytest.raises(NewtonFailed, match="no step is short enough"):
        fc.Adaptive(fc.BDF2()).step(system, late, 1e-6, None)
