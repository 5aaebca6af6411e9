"""Motions of pins and loads that fixed steps do not see are named before the run."""

import numpy as np
import pytest
from support.planned import STRIP, along_z, strip, warnings_before

import fecloth as fc
from fecloth.simulation.doubts.planned_run import PlannedRun
from fecloth.simulation.doubts.unseen import (
    _missed_impulse,
    _without_uniform_motion,
    find_missed,
    find_missed_by_load_steps,
)
from fecloth.simulation.load_steps import LoadSteps

PULSE = "where(t > 0.1013 and t < 0.1018, 300, 0)"


def missed(dt, t_end=0.5, load=None, motion=None):
    return warnings_before(strip(load, motion), dt, t_end, doubts=[find_missed])


def ball(**motion):
    return fc.Obstacle(fc.shapes.Sphere((0, 0, -2), 0.5, **motion))


FAST = {  # each is zero at all ends of steps of 10 ms, or nearly
    "formula": {"motion": along_z("0.05*sin(2*pi*100*t)")},
    "formula by place": {"motion": along_z("(0.05 + Y)*sin(2*pi*100*t)")},
    "function": {"motion": lambda t: (0.0, 0.0, 0.05 * np.sin(200 * np.pi * t))},
    "on a moving support": {"motion": ("20*t", "0", "0.05*sin(2*pi*100*t)")},
    "pressure": {"load": fc.Pressure("20*sin(2*pi*50*t)**2")},
    "pulse": {"load": fc.Pressure(PULSE)},
    "function of pressure": {"load": fc.Pressure(lambda t: 5 * np.sin(200 * np.pi * t))},
    "wind": {"load": fc.Wind(("5*sin(200*pi*t)", "0", "0"), normal=0.7)},
    "field of wind": {"load": fc.Wind(("0", "5*sin(200*pi*t)", "z"), normal=0.7)},
    "point": {"load": fc.PointForce((0.5, 0.3), along_z("sin(200*pi*t)"))},
    "force": {"load": fc.UserForce(along_z("sin(200*pi*t) - z"))},
    "obstacle": {"load": ball(motion=along_z("0.05*sin(2*pi*100*t)"))},
    "turning obstacle": {"load": ball(rotate=fc.Rotation((0, 0, 0), (0, 1, 0), "sin(200*pi*t)"))},
    "function of force": {"load": fc.UserForce(lambda x, v, t: 0 * x + np.sin(200 * np.pi * t))},
}


@pytest.mark.parametrize("name", FAST)
def test_motions_and_loads_between_the_steps_are_named_with_a_step_that_sees_them(name):
    (words,) = missed(0.01, 0.2, **FAST[name])
    assert "100 % of it is not seen by steps of 0.01 s" in words
    assert ("pin 'left'" if "motion" in FAST[name] else type(FAST[name]["load"]).__name__) in words
    dt = float(words.split("dt <= ")[1].split()[0])
    assert 1e-5 < dt < 0.01
    assert not missed(0.95 * dt, 0.2, **FAST[name])


@pytest.mark.parametrize("steps", [5.0, 6.3, 10.0, 33.3])
@pytest.mark.parametrize("phase", [0.0, 0.7, 1.6])
@pytest.mark.parametrize("frequency", [0.7, 13.0])
def test_a_resolved_oscillation_is_not(steps, phase, frequency):
    """At five steps a period and more."""
    wave, dt = f"sin(2*pi*{frequency}*t + {phase})", 1 / (steps * frequency)
    for case in ({"motion": along_z(wave)}, {"load": fc.Pressure(wave)}):
        assert not missed(dt, 8.2 / frequency, **case)


@pytest.mark.parametrize("steps", [3.1, 2.0, 1.0, 0.3])
@pytest.mark.parametrize("phase", [0.0, 0.7, 1.6])
def test_three_or_fewer_steps_a_period_cause_a_warning(steps, phase):
    wave = f"sin(2*pi*13*t + {phase})"
    assert missed(1 / (13 * steps), 1.0, motion=along_z(wave))


@pytest.mark.parametrize("at", [0.1, 0.1013])
def test_a_smooth_pulse_between_steps_causes_a_warning(at):
    assert missed(0.005, 0.3, load=fc.Pressure(f"300*exp(-((t - {at})/1e-4)**2)"))


STORIES = {
    "a jump of a load": {"load": fc.Pressure("where(t < 0.1, 0, 5)")},
    "a uniform motion of an obstacle": {"load": ball(motion=along_z("20*t"))},
    "a jump of a pin": {"motion": along_z("where(t < 0.1013, 0, 0.1)")},
    "a uniform motion": {"motion": ("20*t", "0", "0")},
    "a resolved pulse": {"load": fc.Pressure("300*exp(-((t - 0.1)/0.01)**2)")},
    "a small part": {"load": fc.Pressure("10 + 0.1*sin(200*pi*t)")},
    "a steady force": {"load": fc.UserForce(along_z("-z"))},
    "gravity": {"load": fc.Gravity()},
    "nothing": {"load": fc.Pressure(lambda t: 0.0)},
}


@pytest.mark.parametrize("name", STORIES)
def test_resolved_motions_and_loads_cause_no_warning(name):
    assert not missed(0.005, 0.3, **STORIES[name])


@pytest.mark.parametrize(("dt", "most"), [(1e-3, 2**13 + 2**10), (None, 2**13)])
def test_all_warnings_together_evaluate_a_motion_a_bounded_number_of_times(dt, most):
    """In even samples and steps, and in the search for a jump in eight intervals."""
    counted = []

    def moved(t):
        counted.append(t)
        return (0.0, 0.0, 0.1 * np.sin(9 * t))

    for pin in (fc.Pin("left", moved), fc.Slide("left", moved, normal=(0, 0, 1))):
        held = fc.System(STRIP, fc.Fabric(0.2, 500.0), [fc.StVK()], [pin])
        counted.clear()
        assert warnings_before(held, dt) == []
        assert len(counted) <= most + 8 * 30 + 5


def test_the_uniform_motion_is_the_line_of_least_squares(rng):
    times, g = 7.0 + np.sort(rng.random(20)).reshape(4, 5), rng.normal(size=(4, 5, 3))
    slope, level = np.polyfit(times.ravel(), g.reshape(20, 3), 1)
    expected = g - (slope * times[..., None] + level)
    np.testing.assert_allclose(_without_uniform_motion(times, g), expected, atol=1e-12)


def test_a_load_that_no_shifted_step_sees_is_missed_wholly(recwarn):
    """It acts in the second half of the last step alone: no sample of the other grid meets it."""
    load = fc.PointForce((0.5, 0.3), along_z("where(t < 0.395, 0, 20)"))
    (sentence,) = missed(0.01, 0.4, load)
    assert "100 % of it is not seen" in sentence
    assert not recwarn.list


@pytest.mark.parametrize(("share", "warned"), [(0.25, 0), (0.5, 0), (1.5, 0), (3.0, 1), (4.5, 1)])
def test_a_smooth_pulse_is_seen_if_its_impulse_is(share, warned):
    """Steps of 1.5 widths err by up to a third in a pulse of a wind or a load, not in its sum."""
    dt = 0.01 * share
    pulse = "exp(-((t - 0.2 - 0.3*0.01)/0.01)**2)"
    for load in (fc.Pressure(f"300*{pulse}"), fc.Wind((0, 0, f"9*{pulse}"), normal=0.7)):
        assert len(missed(dt, 20 * dt * round(0.02 / dt + 0.5), load)) == warned


def test_the_share_of_a_missed_impulse_is_exact():
    """Twelve steps of 0.5 s, and a load of 1 from 2 s to 4 s whose line is 1.3 in one step."""
    size, g = np.full((12, 1), 0.5), np.ones((12, 4, 1))
    g[:4], g[8:] = 0.0, 0.0
    lines = g.copy()
    lines[5] = 1.3
    expected = 0.15 / (2.0 * (1 - 2.0 / 6))
    assert _missed_impulse(g, lines, size) == pytest.approx(expected)


@pytest.mark.parametrize(("number", "warned"), [(1, True), (3, True), (12, False)])
def test_load_steps_that_cut_a_turn_short(number, warned):
    # one load step ends where it begins; 12 chords are near the circle
    cloth = fc.Cloth.rectangle(0.3, 0.05, h=0.05, pattern="right")
    fabric = fc.Fabric(0.2, 1000.0, 0.3, bending_rigidity=1e-5)
    turn = fc.Rotation((0.3, 0.025, 0), (1, 0, 0), "2*pi*t")
    pins = [fc.Pin("left"), fc.Pin("right", rotate=turn)]
    system = fc.System(cloth, fabric, [fc.StVK()], pins)
    planned = PlannedRun(system, system.rest(), LoadSteps(number), np.ones(1))
    doubts = list(find_missed_by_load_steps(planned))
    assert [doubt.kind for doubt in doubts] == [fc.DoubtKind.MISSED] * warned
    for doubt in doubts:  # the remedy can be followed
        enough = LoadSteps(int(doubt.remedy.removeprefix("take load_steps >= ")))
        followed = PlannedRun(system, system.rest(), enough, np.ones(1))
        assert not list(find_missed_by_load_steps(followed))
    if number == 1:
        with pytest.warns(fc.FeclothWarning, match="load_steps >="):
            end = fc.equilibrium(system, system.rest(), load_steps=1)
        assert np.allclose(end.x, system.rest().x)  # the flat start: nothing has turned
