"""Jumps of pins are found before the run, and nothing else is called one."""

import warnings

import numpy as np
import pytest
from support.planned import warnings_before
from support.tiers import stories_except

import fecloth as fc
from fecloth.simulation.doubts.before_run import NOTES, OF_MARCH, OF_SCENES

CLOTH = fc.Cloth.rectangle(1.0, 0.6, h=0.3, pattern="right")
TIME = 0.3
JUMPS = {
    "where(t < 0.1, 0, 0.1)": (0.1, 0.1),
    "where(t > 0, 0.1, 0)": (0.0, 0.1),
    "where(t < 0.3, 0, 0.1)": (0.3, 0.1),
    "0.1 * floor(t / 0.1)": (0.1, 0.1),
    "0.02 * sign(t - 0.2)": (0.2, 0.04),
    "0.02 * sign(t - 0.1234567)": (0.1234567, 0.04),
    "3 * t + sin(40 * t) + where(t < 0.1717, 0, 0.001)": (0.1717, 0.001),
    "where(t < 0.1, 0, 0.1 * X)": (0.1, 0.1),
    "X * 0.5 * cos(where(t < 0.2, 0, 1)) - X": (0.2, 0.23),
}
SMOOTH = (
    "0.1 * smoothstep(0.1, 0.11, t)",
    "0.05 * sin(2 * pi * 100 * t)",
    "max(0, t - 0.1)",
    "abs(sin(30 * t))",
    "0.1 * tanh((t - 0.1) / 1e-5)",
    "0.1 * exp(-((t - 0.1) / 1e-4)**2)",
    "sqrt(t)",
    "where(t < 0.1, 0, 1e-9)",
    "1e3 * t",
)


def system(motion, **options):
    pin = fc.Pin("right", motion=motion, **options)
    return fc.System(CLOTH, fc.Fabric(0.2, 500.0), [fc.StVK()], [pin])


def formula(text):
    return system(("0", "0", text))


def function(text):
    """The same as a function of Python, where the formula has no place in it."""
    parts = formula(text).constraints.groups["right"][0].motion
    return system(lambda t: np.array(parts(t)))


def jumps_of(system):
    return warnings_before(system, 0.01, TIME, doubts=OF_MARCH)


@pytest.mark.parametrize("make", stories_except([formula, function], formula))
@pytest.mark.parametrize("text", JUMPS)
def test_jumps_are_named_with_time_and_size(text, make):
    (words,) = jumps_of(make(text))
    t, size = JUMPS[text]
    assert f"'right' jumps by {size:.2g}" in words
    assert f"at t = {t:.6g} s" in words
    if "floor" in text:
        assert "largest of 2 jumps" in words or "largest of 3 jumps" in words


@pytest.mark.parametrize("make", stories_except([formula, function], formula))
@pytest.mark.parametrize("text", SMOOTH)
def test_smooth_and_kinked_motions_are_no_jumps(text, make):
    assert jumps_of(make(text)) == []


@pytest.mark.parametrize(("t", "size"), [(0.1, 0.02), (0.2717, 0.3)])
def test_jumps_of_obstacles_are_named(t, size):
    def tell(motion):
        ball = fc.shapes.Sphere((0, 0, -2), 0.5, motion=("0", "0", motion))
        return jumps_of(fc.System(CLOTH, fc.Fabric(0.2, 500.0), [fc.StVK(), fc.Obstacle(ball)]))

    (words,) = tell(f"0.2*t + where(t < {t}, 0, {size})")
    assert words.startswith(f"the motion of Obstacle jumps by {size:g} m at t = {t:g} s")
    assert "let the obstacle move in a finite time" in words
    assert tell("0.2*t") == []


def test_the_remedy_removes_the_warning():
    (words,) = jumps_of(formula("where(t < 0.1, 0, 0.05)"))
    remedy = words[words.index(", as ") + 5 : -len(" does")]
    assert remedy == "0.05 * smoothstep(0.1, 0.15, t)"
    assert jumps_of(formula(remedy)) == []


def test_a_jump_is_no_warning_before_a_run():
    assert warnings_before(formula("where(t < 0.1, 0, 0.1)"), 0.01, TIME, doubts=OF_SCENES) == []
    assert len(warnings_before(formula("where(t < 0.1, 0, 0.1)"), 0.01, TIME, doubts=NOTES)) == 1


def test_a_march_warns_of_a_jump_at_its_start_and_a_continued_one_does_not():
    jumping = function("where(t < 0.1, 0, 0.01)")
    arguments = jumping, fc.BDF2(), jumping.rest(), 5e-3, 0.11
    with pytest.warns(fc.FeclothWarning, match="jumps by"):
        state, info = next(iter(fc.march(*arguments)))
    with warnings.catch_warnings(action="error"):
        next(fc.march(jumping, fc.BDF2(), state, 5e-3, 0.11, memory=info.memory))
