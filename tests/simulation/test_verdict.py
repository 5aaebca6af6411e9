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


def kind_of(*given, **values) -> DoubtKind | None:
    """The kind of that doubt, None without one."""
    cause = doubt(*given, **values)
    return cause and cause.kind


LIE = fc.LinearlyImplicitEuler()  # its steps do not solve their equations
THRESHOLDS = {  # the kind below and above, and the arguments at a part of the threshold
    "an error of a tenth of the motion": (None, "TIME", lambda f: (f * 0.1, CLOSED)),
    "a quarter of it": (None, "TIME", lambda f: (f * 0.025, CLOSED, LIE)),
    "and an open balance": (None, "MOTION", lambda f: (f * 0.025, OFF, LIE)),
    "half of the energy that moved": (
        *(None, "MOTION"),
        lambda f: (0.001, replace(CLOSED, remainder=-f * 0.5)),
    ),
    "dissipation of a fifth": (None, "DAMPING", lambda f: (math.nan, CLOSED, None, f * 0.2)),
    "a jump by a twentieth of the motion": (
        *("TIME", "JUMP"),
        lambda f: (0.2, CLOSED, None, 0.0, f * 0.05 * MOVED),
    ),
    "a jump with contact, however far the cloth went": (
        *(None, "JUMP"),  # an obstacle that jumps throws the cloth, in short steps far
        lambda f: (0.001, CLOSED, None, 0.0, f * verdict.LEAST_JUMP * CLOTH.extent, [BALL]),
    ),
    "energy that the method makes at impacts": (
        *(None, "GAIN"),
        lambda f: (0.02, replace(CLOSED, kinetic=2.0, gained=f * 0.1), None, 0.0, 0.0, [BALL]),
    ),
    "the same without contact": (None, None, lambda f: (0.02, replace(CLOSED, gained=f), None)),
}


@pytest.mark.parametrize(("below", "above", "values"), THRESHOLDS.values(), ids=THRESHOLDS)
def test_a_doubt_of_the_motion_begins_at_its_threshold(below, above, values):
    assert kind_of(*values(0.8)) is (below and DoubtKind[below])
    assert kind_of(*values(1.25)) is (above and DoubtKind[above])


def test_a_balance_and_dissipation_matter_where_no_error_is_known_to_be_small():
    for balance, eaten, kind in ((OFF, 0.0, DoubtKind.MOTION), (CLOSED, 0.5, DoubtKind.DAMPING)):
        assert kind_of(0.04, balance, eaten=eaten) is None
        assert kind_of(math.nan, balance, eaten=eaten) is kind
    assert kind_of(0.001, terms=[BALL]) is DoubtKind.MOTION
    assert kind_of(0.001, CLOSED, eaten=0.5, terms=[BALL]) is None
    assert kind_of(0.001, FAR) is DoubtKind.MOTION


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
