"""Each threshold of a decision, from both sides: at about 0.8 and 1.25 times its value."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import fecloth as fc
from fecloth.simulation import error_control, stability_limited
from fecloth.simulation.account import Run
from fecloth.simulation.deformation import negligible_energy
from fecloth.simulation.doubts.signals import Effort, Signal
from fecloth.simulation.doubts.unseen import missed_share
from fecloth.simulation.energy_balance import MOST_GROWTH, Balance, doubt_dissipation
from fecloth.simulation.error_control import Control
from fecloth.simulation.step_times import count_steps, end_times
from fecloth.simulation.within_step import uneven


@pytest.fixture(scope="module")
def system():
    cloth = fc.Cloth.rectangle(0.6, 0.3, h=0.15, pattern="right")
    return fc.System(cloth, fc.Fabric(0.2, 200.0), [fc.StVK()], ["left"])


def ledger(system, **values):
    """A ledger at rest at t = 1 s, with other values where given."""
    rest = fc.Ledger.open(system, system.rest())
    return replace(rest, t=1.0, **values)


def is_off(system, ledger, **values):
    """Whether the balance of a run that ends with this ledger is doubted."""
    return Balance(0.0, 0.0, remainder=ledger.remainder, **values).is_off(system, ledger)


@pytest.mark.parametrize(("share", "doubted"), [(0.04, False), (0.0625, True)])
def test_energy_balance_warning_begins_at_a_twentieth(share, doubted, system):
    unexplained = ledger(system, kinetic=1.0)
    assert unexplained.remainder == 1.0
    assert is_off(system, unexplained, moved=1.0 / share) == doubted


@pytest.mark.parametrize(
    ("times", "first", "fails"),
    [(3.2, None, False), (5.0, None, True), (4.8, 0.5, False), (7.5, 0.5, True)],
)
def test_a_run_fails_from_four_times_the_energy_that_was_supplied(times, first, fails, system):
    """And that was made in the first step: by the ledger, or by the method's own column."""
    for values in ({"kinetic": 1.0 + times}, {"kinetic": 1.0 + times, "numerical": -times}):
        given = ledger(system, opening={"kinetic": 1.0, "StVK": 0.0}, **values)
        assert given.supplied == 1.0
        assert given.remainder - given.numerical == pytest.approx(times)
        balance = Balance(0.0, times, supplied=1.0, first=first)
        assert bool(balance.describe_growth(system, given, MOST_GROWTH)) == fails
        rest = Balance(0.0, 0.0, supplied=1.0)  # damping has taken it since
        assert not rest.describe_growth(system, given, MOST_GROWTH)


def test_what_was_supplied_is_the_start_the_energy_released_and_the_work(system):
    given = ledger(
        system, kinetic=9.0, opening={"kinetic": 1.0, "StVK": 2.0}, pins=-4.0, work={"Wind": 8.0}
    )
    assert given.supplied == 1.0 + 2.0 + 4.0 + 8.0


@pytest.mark.parametrize(("factor", "kept"), [(1.16, True), (1.25, False)])
def test_an_adaptive_step_keeps_its_size_below_a_growth_of_a_fifth(factor, kept):
    """The next step is SAFETY e^(−0.7/p) dt after an error of e, where the error before was 1."""
    method = fc.Adaptive(fc.BDF2())
    error = (error_control.SAFETY / factor) ** (2 / 0.7)
    control = SimpleNamespace(error=1.0)
    assert method._next_dt(0.01, control, error) == pytest.approx(0.01 if kept else 0.01 * factor)


@pytest.mark.parametrize(
    ("error", "part"),
    [(1.01, 0.9 * 1.01**-0.5), (0.5, 0.9), (9.0, 0.3), (1e9, error_control.SHORTEST)]
    + [(math.nan, error_control.SHORTEST)],
)
def test_an_attempt_with_a_large_error_is_shortened_by_it(error, part):
    """By 0.9 e^(−1/p), at least by a tenth."""
    assert fc.Adaptive(fc.BDF2())._shortening(error) == pytest.approx(part)


@pytest.mark.parametrize(("growth", "limited"), [(1.04, False), (1.0625, True)])
def test_an_explicit_step_grows_by_a_twentieth_at_most(growth, limited, system):
    """After many steps the limit is computed again; here it is `growth` times the last step."""
    method = stability_limited.StabilityLimited(fc.CentralDifference())
    state = system.rest()
    start = method._start(system, state)
    old = replace(start, dt=start.dt / growth, steps=stability_limited.UPDATE_STEPS)
    new = method._update(system, state, old)
    assert new.dt == pytest.approx(old.dt * (1.05 if limited else growth), rel=1e-6)


def test_explicit_steps_are_counted_to_the_next_limit(system):
    method, memory = stability_limited.StabilityLimited(fc.CentralDifference()), None
    for number in (1, 2):
        memory = method.step(system, system.rest(), 1.0, None, memory).memory
        assert memory.steps == number


@pytest.mark.parametrize(("share", "doubted"), [(0.8e-3, False), (1.25e-3, True)])
@pytest.mark.parametrize("what", ["kinetic", "pins", "work"])
def test_an_energy_balance_may_be_off_by_a_thousandth_of_what_flew_or_worked(
    share, doubted, what, system
):
    """What Newton's tolerance and the loads leave of it is no deformation."""
    values = {"kinetic": {"kinetic": 1.0}, "pins": {"pins": -1.0}, "work": {"work": {"Wind": 1.0}}}
    given = ledger(system, **values[what])
    start = {"kinetic": given.total - given.pins - sum(given.work.values()) - share, "StVK": 0.0}
    given = replace(given, opening=start)
    assert given.remainder == pytest.approx(share)
    assert is_off(system, given, kinetic=given.kinetic) == doubted


@pytest.mark.parametrize(("error", "before"), [(0.1, 0.5), (0.6, 0.05), (0.04, 0.04)])
def test_the_next_step_follows_from_two_errors(error, before):
    """dt 0.9 e^(−0.7/p) e₋^(0.4/p), by logarithms."""
    dt = 0.01
    for method, p in ((fc.BDF2(), 2), (fc.BackwardEuler(), 1)):
        control = Control(dt, before, np.zeros((1, 3)), 0.0)
        logarithms = 0.4 * math.log(before) - 0.7 * math.log(error)
        by_hand = dt * 0.9 * math.exp(logarithms / p)
        shown = fc.Adaptive(method, rtol=1e-3)._next_dt(dt, control, error)
        assert shown == pytest.approx(min(2 * dt, by_hand))
        if p == 2:
            assert by_hand < 2 * dt


@pytest.mark.parametrize(("part", "doubted"), [(0.8, False), (1.25, True)])
def test_what_a_driven_cloth_loses_to_damping_is_a_part_of_its_motion(part, doubted, system):
    """It loses ten times the energy that it ever has; the method takes 20 % of all that."""
    run = Run(system, fc.BackwardEuler(), system.rest(), 0, 4.0, math.inf)
    numerical = part * 0.2 * 10.0
    ledger = replace(
        fc.Ledger.open(system, system.rest()),
        t=1.0,
        numerical=numerical,
        dissipated={"damping": 10.0 - numerical},
    )
    balance = Balance(0.0, 1.0, moved=1.0)
    assert (doubt_dissipation(run, balance, ledger) is not None) == doubted


@pytest.mark.parametrize(("rest", "steps"), [(0.8e-9, 3), (1.25e-9, 4)])
def test_what_is_left_of_a_span_is_a_step_beyond_the_round_off_of_the_clock(rest, steps):
    assert count_steps(3.0 + rest, 1.0) == steps


def test_times_that_differ_by_the_round_off_of_the_clock_are_one_stop():
    """The stops of a run of 1 s, from both sides of 1e-9 of it."""
    assert end_times(0.0, 1.0, [1.0 - 0.8e-9]).tolist() == [1.0]
    assert len(end_times(0.0, 1.0, [1.0 - 1.25e-9])) == 2


@pytest.mark.parametrize("factor", [0.8, 1.25])
def test_a_change_of_a_signal_by_its_round_off_is_none(factor):
    """A load of 1 that waves within each step, by about 1e-9 beside its line in the mean."""
    effort = Effort(most=64, even=64, inside=uneven(16))
    size = factor * 1e-9 * math.pi / 2

    def values(t):
        return 1.0 + size * np.sin(2 * np.pi * t)[:, None]

    load = Signal("the load", values, effort, span=(0.0, 1.0), is_fixed=True, kind="load")
    share, _ = missed_share(load, 1.0, load.span)
    assert (share > 0) == (factor > 1)


def test_the_energy_of_a_cloth_at_rest_is_that_of_a_millionth_of_its_extent(system):
    """½ m (1e-6 L/T)², with 1 s, the 0.6 m of the sheet and its 0.036 kg."""
    assert negligible_energy(system, 1.0) == pytest.approx(0.5 * 0.036 * 0.6e-6**2)


def test_round_off_causes_no_energy_warning(system):
    """A remainder of 2e-27 J of a sheet at rest is round-off; a remainder of 2e-12 J is not."""
    for off, told in ((2e-27, False), (2e-12, True)):
        assert is_off(system, ledger(system, kinetic=off)) == told
    assert not is_off(system, ledger(system))


def test_a_term_without_energy_or_work_causes_no_warning(system):
    """A user's force without a potential, as the remainder is all that it does."""
    for silent in (False, True):
        moved = ledger(system, kinetic=1.0, silent=silent)
        assert is_off(system, moved) != silent
        assert bool(Balance(0.0, 1.0).describe_growth(system, moved, 4.0)) != silent
