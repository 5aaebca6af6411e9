"""Motions and loads that chosen steps may jump over are named, with a remedy that works."""

import re
import warnings

import numpy as np
import pytest
from support.planned import STRIP, along_z, strip, warnings_before
from support.tiers import in_turn, stories_except

import fecloth as fc
from fecloth.simulation.doubts.unseen import find_missed, find_short_pulses

CORNER = STRIP.nodes(lambda X: X.sum(axis=1) > 1.59)


def ball(formula):
    return fc.shapes.Sphere((0, 0, -2), 0.5, motion=along_z(f"1e-2*({formula})"))


KINDS = {  # of a formula f of time
    "pressure": lambda f: {"load": fc.Pressure(f)},
    "wind": lambda f: {"load": fc.Wind(along_z(f), normal=0.7)},
    "wind and place": lambda f: {"load": fc.Wind(("0.01*x", "0", f), normal=0.7)},
    "point": lambda f: {"load": fc.PointForce((0.5, 0.3), along_z(f))},
    "force": lambda f: {"load": fc.UserForce(along_z(f))},
    "force by place": lambda f: {"load": fc.UserForce(along_z(f"(1 + X)*({f})"))},
    "tether": lambda f: {"load": fc.Tether(CORNER, ("1", "0.6", f), stiffness=5.0)},
    "soft tether": lambda f: {"load": fc.Tether("right", ("1", "0.6", f), stiffness=1e-3)},
    "obstacle": lambda f: {"load": fc.Obstacle(ball(f))},
    "pin": lambda f: {"motion": along_z(f"1e-2*({f})")},
    "moving pin": lambda f: {"motion": ("0.1*t", "0", f"1e-2*({f})")},
}


def chosen(case, steps=None, ends=(2.0,)):
    options = {"method": steps, "ends": ends, "doubts": [find_short_pulses]}
    return warnings_before(strip(**case), **options)


def pulse(begin, length):
    return f"where((t > {begin}) and (t < {begin + length}), 20, 0)"


@pytest.mark.parametrize("kind", stories_except(KINDS, "pressure"))
def test_a_pulse_is_named_with_its_time_and_a_remedy_that_works(kind):
    for begin, length in ((0.037, 0.01), (0.61, 0.03), (1.713, 0.06)):
        case = KINDS[kind](pulse(begin, length))
        (words,) = chosen(case)
        result = re.search(r"acts for (\S+) s at t = (\S+) s.*longest = (\S+) ", words)
        duration, start, longest = map(float, result.groups())
        assert duration == pytest.approx(length, abs=0.02 * length + 1e-3)
        assert start == pytest.approx(begin, abs=1e-3)
        assert not chosen(case, fc.Auto(longest=longest))
        assert not chosen(case, fc.Adaptive(fc.BDF2(), longest=longest))


@pytest.mark.parametrize(
    ("kind", "formula"),
    in_turn(
        list(KINDS),
        [
            "3",
            "20*t",
            "t**2",
            "sin(2*pi*t/2)",
            "sin(2*pi*t*25)",
            "sin(pi*t)**2",
            "where(t < 1.2, 0, 5)",
            "smoothstep(0.9, 1.0, t)",
            "where(t < 0.01, 20, 0)",
            "where((t > 0.6) and (t < 0.81), 20, 0)",
            "20*exp(-((t - 0.7)/0.3)**2)",
        ],
    ),
)
def test_what_acts_for_long_causes_no_warning(kind, formula):
    assert not chosen(KINDS[kind](formula))


def test_pulses_of_functions_are_named():
    def p(t):
        return 20.0 if 0.61 < t < 0.63 else 0.0

    assert chosen({"load": fc.Pressure(p)})
    assert chosen({"load": fc.UserForce(lambda x, v, t: 0 * x + p(t))})
    assert chosen({"motion": lambda t: (0.0, 0.0, 1e-3 * p(t))})
    assert not chosen({"load": fc.Pressure(lambda t: 1 / 0)})


def test_stops_and_stability_bound_the_steps():
    case = KINDS["pressure"](pulse(0.61, 0.02))
    assert chosen(case)
    assert chosen(case, ends=(0.6, 0.64, 2.0))
    assert not chosen(case, ends=(0.615, 0.625, 2.0))
    assert not chosen(case, ends=np.linspace(0.05, 2.0, 40))
    assert chosen(case, fc.Adaptive(fc.BDF2()))
    assert not chosen(case, fc.Adaptive(fc.CentralDifference()))


def test_a_train_of_pulses_is_named():
    (words,) = chosen(KINDS["pressure"]("where(mod(t, 0.2) < 0.01, 20, 0)"))
    assert "acts for 0.01 s" in words


@pytest.mark.parametrize(("kind", "dt"), in_turn(list(KINDS), [0.01, 0.03]))
def test_pulses_between_fixed_steps_are_named_with_a_step_that_sees_them(kind, dt):
    for place in (0.12, 0.21, 0.55):
        for length in (0.12, 0.4):
            begin = (np.floor(place / dt) + 0.1) * dt  # within one step
            system = strip(**KINDS[kind](pulse(begin, length * dt)))
            (words,) = warnings_before(system, dt, 0.7, doubts=[find_missed])
            proposed = float(words.split("dt <= ")[1].split()[0])
            assert proposed < 0.5 * length * dt
            assert not warnings_before(system, proposed, 0.7, doubts=[find_missed])


@pytest.mark.stories
@pytest.mark.parametrize("method", [fc.BDF2(), fc.ImplicitMidpoint()], ids=repr)
def test_longest_bounds_the_steps_and_sees_the_pulse(method):
    cloth = fc.Cloth.rectangle(1.0, 0.6, h=0.2, pattern="right")
    load = fc.Pressure("where((t > 0.03) and (t < 0.032), 20, 0)")
    system = fc.System(cloth, fc.Fabric(0.2, 500.0), [fc.StVK(), load], ["boundary"])
    steps = fc.Adaptive(method, 1e-2)
    with pytest.warns(fc.FeclothWarning, match="longest = 0.0005"):
        blind = fc.run(system, steps, system.rest(), t_end=0.1)
    assert np.abs(blind.state.x[:, 2]).max() == 0.0
    steps = fc.Adaptive(method, 1e-2, longest=0.0005)
    with warnings.catch_warnings(record=True) as others:
        warnings.simplefilter("always")
        seen = fc.run(system, steps, system.rest(), t_end=0.04)
    assert not any("jump over" in str(other.message) for other in others)
    assert np.diff(seen.times).max() < 0.0005 * (1 + 1e-9)
    assert seen.state.v[:, 2].max() > 0.05
