"""What a run says of its motion as a whole: one doubt, its cause, at the thresholds."""

import math
from dataclasses import replace

import pytest
from support.planned import warnings_before

import fecloth as fc
from fecloth.simulation import verdict
from fecloth.simulation.account import End, Run
from fecloth.simulation.contact import Contact
from fecloth.simulation.deformation import Deformation
from fecloth.simulation.doubts.before_run import OF_SCENES
from fecloth.simulation.doubts.doubt import Doubt, DoubtKind
from fecloth.simulation.doubts.jumps import find_jumping_motions
from fecloth.simulation.energy_balance import DISTRUST, Balance
from fecloth.simulation.energy_ledger import Ledger
from fecloth.simulation.time_error import BOUNCES, HITS, TimeError
from fecloth.simulation.verdict import Verdict

CLOTH = fc.Cloth.rectangle(0.6, 0.3, h=0.15, pattern="right")
MOVED = 0.2  # m
IMBALANCE = Doubt(DoubtKind.MOTION, f"the energy balance is off: {DISTRUST}")
OFF = Balance(0.0, imbalance=IMBALANCE)
MUCH = Doubt(DoubtKind.DAMPING, "much")


def doubt(monkeypatch, error, balance=OFF, method=None, eaten=None, jump=0.0, terms=()):
    """The verdict of a run with this error in time, balance, dissipation and jump of a pin [m]."""
    motion = ("0", "0", f"where(t < 0.1, 0, {jump})") if jump else None
    system = fc.System(CLOTH, fc.Fabric(0.2, 200.0), [fc.StVK(), *terms], [fc.Pin("left", motion)])
    start = system.rest()
    estimate = TimeError(start.x, None, (), relative=error, moved=MOVED, sentence="error in time")
    estimate = replace(estimate, jumps=find_jumping_motions(system, start, 0.3))
    monkeypatch.setattr(verdict, "doubt_dissipation", lambda *given: eaten)
    others = {TimeError: estimate, Balance: balance, Ledger: None}
    run = Run(system, method or fc.BDF2(), start, 0, 4.0, math.inf)
    return Verdict().finish(run, End(replace(start, t=0.3), 10), others).doubt


@pytest.mark.parametrize(("error", "doubted"), [(0.024, False), (0.0375, True)])
def test_a_balance_and_dissipation_matter_from_an_error_of_three_per_cent(
    error, doubted, monkeypatch
):
    assert (doubt(monkeypatch, error) == OFF.imbalance) == doubted
    assert (doubt(monkeypatch, error, Balance(0.0), eaten=MUCH) == MUCH) == doubted


def test_a_balance_counts_where_it_is_far_off_or_the_error_is_not_known(monkeypatch):
    far = replace(OFF, is_far=True)
    assert doubt(monkeypatch, 0.001, far) == OFF.imbalance
    assert doubt(monkeypatch, float("nan")) == OFF.imbalance
    assert doubt(monkeypatch, 0.001, method=fc.LinearlyImplicitEuler()) == OFF.imbalance
    touching = [fc.Obstacle(fc.shapes.Sphere((0, 0, -2), 0.5))]
    assert doubt(monkeypatch, 0.001, terms=touching) == OFF.imbalance
    assert doubt(monkeypatch, 0.001) is None


@pytest.mark.parametrize(("part", "is_far"), [(0.8, False), (1.25, True)])
def test_a_balance_is_far_off_from_half_of_the_energy(part, is_far):
    system = fc.System(CLOTH, fc.Fabric(0.2, 200.0), [fc.StVK()], ["left"])
    ledger = replace(fc.Ledger.open(system, system.rest()), t=1.0, kinetic=0.5 * part)
    for balance in (Balance(0.0, largest=1.0), Balance(0.0, largest=0.1, kinetic=1.0)):
        after = balance.after(system, ledger, Deformation(0.0, 0.0, in_place={}))
        assert after.finish(None, None, None).is_far == is_far


def test_a_large_error_in_time_is_one_warning_with_its_balance(monkeypatch):
    in_time = doubt(monkeypatch, 0.2, Balance(0.0), eaten=MUCH)
    assert in_time == Doubt(DoubtKind.TIME, "error in time")
    both = doubt(monkeypatch, 0.2, OFF, eaten=MUCH)
    assert both.kind is DoubtKind.MOTION
    assert both.words.startswith("error in time; the energy balance is off")


@pytest.mark.parametrize(("jump", "is_cause"), [(0.8, False), (1.25, True)])
def test_a_jump_is_the_cause_from_a_twentieth_of_the_motion(jump, is_cause, monkeypatch):
    cause = doubt(monkeypatch, 0.2, jump=jump * 0.05 * MOVED)
    assert cause.kind is (DoubtKind.JUMP if is_cause else DoubtKind.MOTION)


@pytest.mark.parametrize(("part", "is_cause"), [(0.8, False), (1.25, True)])
def test_with_contact_a_jump_is_the_cause_however_far_the_cloth_went(part, is_cause, monkeypatch):
    """An obstacle that jumps throws the cloth, in short steps far."""
    ball = [fc.Obstacle(fc.shapes.Sphere((0, 0, -2), 0.5))]
    jump = part * verdict.LEAST_JUMP * CLOTH.extent
    assert jump < 0.05 * MOVED
    cause = doubt(monkeypatch, 0.001, jump=jump, terms=ball)
    assert (cause is not None and cause.kind is DoubtKind.JUMP) == is_cause


@pytest.mark.parametrize(("error", "doubted"), [(0.08, False), (0.125, True)])
def test_a_jump_matters_where_the_error_does(error, doubted, monkeypatch):
    cause = doubt(monkeypatch, error, jump=0.1)
    assert (cause is not None and cause.kind is DoubtKind.JUMP) == doubted


@pytest.mark.parametrize("method", [fc.BDF2(), fc.ImplicitMidpoint()], ids=str)
def test_steps_that_do_not_resolve_a_taut_sheet_are_one_warning(method):
    """Before the first step and at the end; what follows from the long steps is not said too."""
    system = fc.System(CLOTH, fc.Fabric(0.2, 2000.0, 0.3), [fc.StVK(), fc.Gravity()], ["boundary"])
    start = system.state(1.02 * system.rest().x)
    before = warnings_before(system, 0.02, 0.6, method, start, doubts=OF_SCENES)
    with pytest.warns(fc.FeclothWarning):
        result = fc.run(system, method, start, 0.02, 0.6)
    (words,) = (*before, *result.warnings)
    assert words.startswith("error in time: not resolved")


def test_an_energy_that_is_no_number_is_told_in_words():
    system = fc.System(CLOTH, fc.Fabric(0.2, 200.0), [fc.StVK()], ["left"])
    ledger = replace(fc.Ledger.open(system, system.rest()), t=1.0, numerical=float("nan"))
    after = Balance(0.0, largest=1.0).after(system, ledger, Deformation(0.0, 0.0, in_place={}))
    words = after.finish(None, None, None).imbalance.words
    assert "an energy is not finite" in words
    assert "nan" not in words


@pytest.mark.parametrize(("part", "warns"), [(0.8, False), (1.25, True)])
def test_energy_that_the_method_makes_at_impacts_is_a_warning(part, warns, monkeypatch):
    balance = Balance(0.0, kinetic=2.0, largest=1.0, gained=part * 0.05 * 2.0)
    touching = [fc.Obstacle(fc.shapes.Sphere((0, 0, -2), 0.5))]
    words = str(doubt(monkeypatch, 0.02, balance, terms=touching))
    assert ("the method has made 0.125 J, where 2 J moved" in words) == warns
    assert doubt(monkeypatch, 0.02, balance) is None  # without contact it says nothing of impacts


@pytest.mark.parametrize(("part", "is_off"), [(0.8, False), (1.25, True)])
def test_a_thousandth_of_the_work_of_obstacles_does_not_matter_in_a_balance(part, is_off):
    """Also after the work was taken back."""
    floor = fc.Obstacle(fc.shapes.Plane((0, 0, -1), (0, 0, 1), motion=(0, 0, "t")))
    system = fc.System(CLOTH, fc.Fabric(0.2, 200.0), [fc.StVK(), floor])
    ledger = replace(fc.Ledger.open(system, system.rest()), t=1.0, work={"Obstacle": -2.0})
    deformation = Deformation(0.0, 0.0, in_place={})
    balance = Balance(0.0, largest=1e-3).after(system, ledger, deformation)
    ledger = replace(ledger, work={"Obstacle": 0.0}, kinetic=part * 1e-3 * 2.0)
    after = balance.after(system, ledger, deformation)
    assert bool(after.finish(None, None, None).imbalance) == is_off


@pytest.mark.parametrize(
    ("method", "touches", "remedy"),
    [
        (fc.BackwardEuler(), False, "dt, or a method that dissipates less"),
        (fc.BackwardEuler(), True, "dt, or BDF2; impacts"),
        (fc.BDF2(), True, "dt; impacts"),
    ],
)
def test_dissipation_of_the_method_names_methods_that_contact_allows(method, touches, remedy):
    obstacle = [fc.Obstacle(fc.shapes.Sphere((0, 0, -2), 0.5))] if touches else []
    system = fc.System(CLOTH, fc.Fabric(0.2, 200.0), [fc.StVK(), *obstacle])
    start = system.rest()
    ledger = replace(fc.Ledger.open(system, start), t=1.0, numerical=0.5)
    run = Run(system, method, start, 0, 4.0, math.inf)
    doubt = verdict.doubt_dissipation(run, Balance(0.0, largest=1.0), ledger)
    assert doubt.words.endswith("50 % of the energy of the motion")
    assert doubt.remedy.startswith(f"take a smaller {remedy}")


@pytest.mark.parametrize(
    ("method", "part", "ratio", "why"),
    [
        (fc.BDF2(), 0.8, 0.0, ""),
        (fc.BDF2(), 1.25, 0.0, HITS),
        (fc.BackwardEuler(), 1.25, 0.0, ""),
        (fc.BackwardEuler(), 0.8, 0.8, ""),
        (fc.BackwardEuler(), 0.8, 1.25, BOUNCES),
    ],
)
def test_after_impacts_that_count_there_is_no_error_in_time(method, part, ratio, why):
    """They take a twentieth of the kinetic energy, or steps do not resolve a bounce."""
    obstacle = fc.Obstacle(fc.shapes.Sphere((0, 0, -2), 0.5))
    system = fc.System(CLOTH, fc.Fabric(0.2, 200.0), [fc.StVK(), obstacle])
    start, lost = system.rest(), part * 0.05 * 3.0
    ledger = replace(
        Ledger.open(system, start), numerical=0.5 * lost, dissipated={"Obstacle": 0.5 * lost}
    )
    others = {Ledger: ledger, Contact: Contact(ratio=ratio)}
    estimate = TimeError(start.x, None, (), fastest=3.0)
    assert estimate.find_hits(Run(system, method, start, 0, 4.0, math.inf), others) == why
