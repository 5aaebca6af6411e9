"""What a run says of its motion as a whole: one doubt, its cause, at the thresholds."""

import math
from dataclasses import replace

import numpy as np
import pytest
from support.planned import warnings_before

import fecloth as fc
from fecloth.simulation import verdict
from fecloth.simulation.account import End, Run
from fecloth.simulation.doubts.before_run import OF_SCENES
from fecloth.simulation.doubts.doubt import DoubtKind
from fecloth.simulation.energy_balance import Balance, doubt_dissipation
from fecloth.simulation.energy_ledger import Ledger
from fecloth.simulation.stability_limited import StabilityLimited
from fecloth.simulation.time_error import TimeError
from fecloth.simulation.verdict import Verdict

CLOTH = fc.Cloth.rectangle(0.6, 0.3, h=0.15, pattern="right")
MOVED = 0.2  # m
OFF = Balance(0.0, 0.0, moved=1.0, remainder=0.4)
CLOSED = Balance(0.0, 0.0, moved=1.0)
FAR = replace(OFF, remainder=2.0)
BALL = fc.Obstacle(fc.shapes.Sphere((0, 0, -2), 0.5))


def doubt(error, balance=OFF, method=None, eaten=0.0, jump=0.0, terms=()):
    """The verdict of a run with this error in time, balance, dissipation and jump of a pin [m]."""
    motion = ("0", "0", f"where(t < 0.1, 0, {jump})") if jump else None
    system = fc.System(CLOTH, fc.Fabric(0.2, 200.0), [fc.StVK(), *terms], [fc.Pin("left", motion)])
    start = system.rest()
    estimate = TimeError(start.x, (0.0, 0), None, MOVED, relative=error, sentence="error in time")
    ledger = replace(Ledger.open(system, start), t=0.3, numerical=eaten)
    others = {TimeError: estimate, Balance: balance, Ledger: ledger}
    run = Run(system, method or fc.BDF2(), start, 0, 4.0, math.inf)
    return Verdict().finish(run, End(replace(start, t=0.3), 10), others).doubt


def kind_of(*given, **values):
    """The kind of that doubt, None without one."""
    cause = doubt(*given, **values)
    return cause and cause.kind


@pytest.mark.parametrize(("error", "kind"), [(0.08, None), (0.125, DoubtKind.TIME)])
def test_an_error_in_time_is_a_doubt_from_a_tenth_of_the_motion(error, kind):
    assert kind_of(error, CLOSED) is kind


@pytest.mark.parametrize(("error", "kind"), [(0.02, None), (0.0313, DoubtKind.TIME)])
def test_of_steps_that_do_not_solve_their_equations_a_quarter_is_accepted(error, kind):
    assert kind_of(error, CLOSED, fc.LinearlyImplicitEuler()) is kind
    assert kind_of(error, OFF, fc.LinearlyImplicitEuler()) is (kind and DoubtKind.MOTION)


def test_a_balance_and_dissipation_matter_where_no_error_is_known_to_be_small():
    for balance, eaten, kind in ((OFF, 0.0, DoubtKind.MOTION), (CLOSED, 0.5, DoubtKind.DAMPING)):
        assert kind_of(0.04, balance, eaten=eaten) is None
        assert kind_of(math.nan, balance, eaten=eaten) is kind
    assert kind_of(0.001, terms=[BALL]) is DoubtKind.MOTION
    assert kind_of(0.001, CLOSED, eaten=0.5, terms=[BALL]) is None
    assert kind_of(0.001, FAR) is DoubtKind.MOTION


@pytest.mark.parametrize(("part", "kind"), [(0.8, None), (1.25, DoubtKind.MOTION)])
def test_a_balance_is_far_off_from_half_of_the_energy_that_moved(part, kind):
    assert kind_of(0.001, replace(CLOSED, remainder=-0.5 * part)) is kind


@pytest.mark.parametrize(("part", "kind"), [(0.8, None), (1.25, DoubtKind.DAMPING)])
def test_dissipation_is_a_doubt_from_a_fifth_of_the_energy_that_moved(part, kind):
    assert kind_of(math.nan, CLOSED, eaten=0.2 * part) is kind


@pytest.mark.parametrize(("jump", "kind"), [(0.8, DoubtKind.TIME), (1.25, DoubtKind.JUMP)])
def test_a_jump_is_the_cause_from_a_twentieth_of_the_motion(jump, kind):
    assert kind_of(0.2, CLOSED, jump=jump * 0.05 * MOVED) is kind


@pytest.mark.parametrize(("part", "kind"), [(0.8, None), (1.25, DoubtKind.JUMP)])
def test_with_contact_a_jump_is_the_cause_however_far_the_cloth_went(part, kind):
    """An obstacle that jumps throws the cloth, in short steps far."""
    jump = part * verdict.LEAST_JUMP * CLOTH.extent
    assert jump < 0.05 * MOVED
    assert kind_of(0.001, CLOSED, jump=jump, terms=[BALL]) is kind


def test_a_jump_matters_only_where_something_is_doubted():
    assert kind_of(0.04, CLOSED, jump=0.1) is None
    assert kind_of(0.125, CLOSED, jump=0.1) is DoubtKind.JUMP
    assert kind_of(0.04, FAR, jump=0.1) is DoubtKind.JUMP


@pytest.mark.parametrize("method", [fc.BDF2(), fc.ImplicitMidpoint()], ids=str)
def test_steps_that_do_not_resolve_a_taut_sheet_are_one_warning(method):
    """Before the first step and at the end; what follows from the long steps is not said too."""
    system = fc.System(CLOTH, fc.Fabric(0.2, 2000.0, 0.3), [fc.StVK(), fc.Gravity()], ["boundary"])
    start = system.state(1.02 * system.rest().x)
    before = warnings_before(system, 0.02, 0.6, method, start, doubts=OF_SCENES)
    with pytest.warns(fc.FeclothWarning):
        result = fc.run(system, method, start, 0.02, 0.6)
    (words,) = (*before, *result.warnings)
    assert words.startswith("error in time: not resolved, or small errors have grown")


def test_an_energy_that_is_no_number_is_told_in_words():
    words = doubt(math.nan, replace(OFF, remainder=math.nan)).words
    assert "an energy is not finite" in words
    assert "nan" not in words


@pytest.mark.parametrize(("part", "kind"), [(0.8, None), (1.25, DoubtKind.GAIN)])
def test_energy_that_the_method_makes_at_impacts_is_a_warning(part, kind):
    balance = replace(CLOSED, kinetic=2.0, gained=part * 0.05 * 2.0)
    assert kind_of(0.02, balance, terms=[BALL]) is kind
    assert kind_of(0.02, balance) is None  # without contact it says nothing of impacts


@pytest.mark.parametrize(
    ("method", "touches", "remedy"),
    [
        (fc.BackwardEuler(), False, "dt, or a method that dissipates less"),
        (fc.BackwardEuler(), True, "dt, or BDF2; impacts"),
        (fc.BDF2(), True, "dt; impacts"),
    ],
)
def test_dissipation_of_the_method_names_methods_that_contact_allows(method, touches, remedy):
    obstacle = [BALL] if touches else []
    system = fc.System(CLOTH, fc.Fabric(0.2, 200.0), [fc.StVK(), *obstacle])
    start = system.rest()
    ledger = replace(fc.Ledger.open(system, start), t=1.0, numerical=0.5)
    run = Run(system, method, start, 0, 4.0, math.inf)
    doubt = doubt_dissipation(run, CLOSED, ledger)
    assert doubt.words.endswith("50 % of the energy of the motion")
    assert doubt.remedy.startswith(f"take a smaller {remedy}")


@pytest.mark.parametrize(
    ("steps", "shorter"),
    [
        (fc.BDF2(), "a smaller dt"),
        (fc.Adaptive(fc.BDF2()), "a smaller rtol"),
        (fc.Adaptive(fc.BDF2(), rtol=0.0, atol=1e-3), "a smaller atol"),
        (StabilityLimited(fc.CentralDifference()), "a dt below the largest stable one"),
    ],
    ids=str,
)
def test_a_remedy_is_what_the_user_of_these_steps_can_set(steps, shorter):
    assert doubt(math.nan, OFF, steps).remedy == f"take {shorter}"
    assert doubt(math.nan, CLOSED, steps, eaten=0.5).remedy.startswith(f"take {shorter}, or")
    gain = doubt(0.02, replace(CLOSED, gained=1.0), steps, terms=[BALL])
    assert gain.remedy == f"take BackwardEuler, or {shorter}"


@pytest.mark.parametrize(
    ("method", "dt", "remedy"),
    [
        (fc.BDF2(), 0.01, "Take a smaller dt."),
        (fc.Adaptive(fc.BDF2(), rtol=0.1), None, "Take a smaller rtol."),
        (fc.Auto(rtol=0.1), None, "Take a smaller rtol."),
    ],
    ids=str,
)
def test_the_remedy_of_a_failed_step_is_what_the_user_can_set(method, dt, remedy):
    """A fast cloth is stretched beyond what is allowed."""
    system = fc.System(CLOTH, fc.Fabric(0.2, 20.0), [fc.StVK()], ["left"])
    fast = system.state(system.rest().x, np.outer(CLOTH.X[:, 0], [10.0, 0.0, 0.0]))
    with pytest.raises(fc.StepFailed) as failed:
        fc.run(system, method, fast, dt, 1.0, most_stretch=1.2)
    assert failed.value.remedy == remedy
