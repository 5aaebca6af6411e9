"""Each threshold of a decision, from both sides: at about 0.8 and 1.25 times its value."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

import fecloth as fc
from fecloth.simulation import error_control, stability_limited
from fecloth.simulation.deformation import Deformation, find_inflow
from fecloth.simulation.energy_balance import Balance
from fecloth.simulation.growth import MOST_GROWTH, describe_growth


@pytest.fixture(scope="module")
def system():
    cloth = fc.Cloth.rectangle(0.6, 0.3, h=0.15, pattern="right")
    return fc.System(cloth, fc.Fabric(0.2, 200.0), [fc.StVK()], ["left"])


def ledger(system, **values):
    """A ledger at rest at t = 1 s, with other values where given."""
    rest = fc.Ledger.open(system, system.rest())
    return replace(rest, t=1.0, **values)


def moved(kinetic, opening=0.0, **values):
    """The deformation with these energies at t = 1 s and at the start."""
    return Deformation(kinetic, opening, in_place={}, first=0.0, **values)


def is_off(balance):
    """Whether the balance of a run that ends here is doubted."""
    return bool(balance.finish(None, None, None).imbalance)


@pytest.mark.parametrize(("share", "doubted"), [(0.04, False), (0.0625, True)])
def test_energy_balance_warning_begins_at_a_twentieth(share, doubted, system):
    unexplained, balance = ledger(system, kinetic=1.0), Balance(0.0, largest=1.0 / share)
    assert unexplained.remainder == 1.0
    assert is_off(balance.after(system, unexplained, moved(1.0))) == doubted


@pytest.mark.parametrize(("times", "fails"), [(3.2, False), (5.0, True)])
def test_a_run_fails_from_four_times_the_available_energy(times, fails, system):
    given = ledger(system, kinetic=times, opening={"kinetic": 1.0, "StVK": 0.0})
    deformation = moved(times, opening=1.0)
    assert find_inflow(given, times, 1.0, {}) == 0.0
    assert deformation.available(given) == pytest.approx(1.0)
    assert bool(describe_growth(deformation, given, MOST_GROWTH)) == fails


@pytest.mark.parametrize(("part", "fails"), [(0.8, False), (1.25, True)])
def test_a_load_that_sets_in_may_have_given_four_times_its_last_work(part, fails, system):
    """The cloth has lost the work of 1 J before the last step, and nothing since."""
    given, deformation = ledger(system, kinetic=4.0 * part), moved(4.0 * part, last_inflow=-1.0)
    assert (find_inflow(given, 4.0 * part, 0.0, {}), deformation.available(given)) == (0.0, 0.0)
    assert bool(describe_growth(deformation, given, 1.0)) == fails


@pytest.mark.parametrize(("factor", "kept"), [(1.16, True), (1.25, False)])
def test_an_adaptive_step_keeps_its_size_below_a_growth_of_a_fifth(factor, kept):
    """The next step is SAFETY e^(−0.7/p) dt after an error of e, where the error before was 1."""
    method = fc.Adaptive(fc.BDF2())
    error = (error_control.SAFETY / factor) ** (2 / 0.7)
    control = SimpleNamespace(error=1.0)
    assert method._next_dt(0.01, control, error) == pytest.approx(0.01 if kept else 0.01 * factor)


@pytest.mark.parametrize(("growth", "limited"), [(1.04, False), (1.0625, True)])
def test_an_explicit_step_grows_by_a_twentieth_at_most(growth, limited, system):
    """After many steps the limit is computed again; here it is `growth` times the last step."""
    method = stability_limited.StabilityLimited(fc.CentralDifference())
    state = system.rest()
    start = method._start(system, state)
    old = replace(start, dt=start.dt / growth, steps=stability_limited.UPDATE_STEPS)
    new = method._update(system, state, old)
    assert new.dt == pytest.approx(old.dt * (1.05 if limited else growth), rel=1e-6)


@pytest.mark.parametrize(("share", "doubted"), [(0.8e-3, False), (1.25e-3, True)])
def test_an_energy_balance_may_be_off_by_a_thousandth_of_the_kinetic_energy(share, doubted, system):
    """A cloth that only flies: what Newton's tolerance and its loads leave is no deformation."""
    flies = ledger(system, kinetic=1.0, opening={"kinetic": 1.0 - share, "StVK": 0.0})
    balance = Balance(0.0, last_kinetic=1.0, kinetic_before=1.0)
    assert is_off(balance.after(system, flies, moved(1e-20))) == doubted


def test_one_step_with_much_kinetic_energy_excuses_no_balance(system):
    spike = ledger(system, kinetic=1e4, opening={"kinetic": 1e4 - 1.0, "StVK": 0.0})
    balance = Balance(0.0, last_kinetic=1.0, kinetic_before=1.0)
    assert is_off(balance.after(system, spike, moved(1e-20)))
