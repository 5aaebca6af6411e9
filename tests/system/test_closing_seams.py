"""Seams that are open at the start, and are closed in time or by load steps."""

from dataclasses import replace

import numpy as np
import pytest
from support.sewn_strips import SEAM, halves
from support.tiers import stories_except
from support.wrong_calls import ISOTROPIC as FABRIC

import fecloth as fc
from fecloth.simulation.load_steps import LoadSteps

GAP = 0.05


def opened(element: str = "P1", close: float = 0.1, terms=()) -> fc.System:
    """Two halves of a strip with 5 cm between them, held at both ends, and a seam."""
    cloth = halves(apart=GAP, element=element)
    seam = replace(SEAM, close=close)
    pins = [fc.Pin("a/left"), fc.Pin("b/right")]
    return fc.System(cloth, FABRIC, [fc.StVK(), *terms], pins=pins, seams=[seam])


def share(s: float) -> float:
    """1 − s³ (10 − 15 s + 6 s²)."""
    return 1 - s**3 * (10 - 15 * s + 6 * s**2)


@pytest.mark.filterwarnings("ignore::fecloth.FeclothWarning")
@pytest.mark.parametrize(
    "method",
    stories_except(
        [fc.BackwardEuler(), fc.BDF2(), fc.ImplicitMidpoint(), fc.CentralDifference()],
        fc.ImplicitMidpoint(),
    ),
    ids=str,
)
def test_a_gap_closes_in_time_and_its_work_is_in_the_ledger(method):
    dt = 1e-5 if method.traits.explicit else 2e-3
    system = opened(terms=[fc.StrainRateDamping(time=0.01)])
    gap = "gap:a.right"
    result = fc.run(system, method, system.rest(), dt=dt, t_end=0.12)
    t = result.times
    expected = [GAP * share(min(time / 0.1, 1.0)) for time in t]
    np.testing.assert_allclose(result.observed[gap], expected, atol=1e-12)
    assert not system.constraints.followers.gap(result.state.x).any()
    work = result.energies["work:seams"][-1]
    stored = result.energies["StVK"][-1]
    assert work > stored > 0.5 * 1000.0 * 0.25 * GAP**2
    largest = np.abs(result.energies["remainder"]).max()
    assert largest < 1e-4 * work


@pytest.mark.filterwarnings("ignore::fecloth.FeclothWarning")
def test_the_remainder_of_closing_falls_with_the_step():
    """By the trapezoidal rule the work has an error of order 2."""
    remainders = []
    for dt in (2e-3, 1e-3):
        system = opened()
        result = fc.run(system, fc.ImplicitMidpoint(), system.rest(), dt=dt, t_end=0.1)
        remainders.append(abs(result.energies["remainder"][-1]))
    assert np.log2(remainders[0] / remainders[1]) > 1.5


@pytest.mark.parametrize("element", ["P1", "P2"])
def test_load_steps_close_a_seam(element):
    """The halves are then one strip that is stretched by 5 cm: with ν = 0 its stress is known."""
    system = opened(element, close=1.0).replace(fabric=replace(FABRIC, poisson_ratio=0.0))
    equilibrium = fc.equilibrium(system, system.rest(), load_steps=4, tolerance=1e-11)
    x = equilibrium.x
    assert np.abs(system.constraints.followers.gap(x)).max() < 1e-15
    X = system.cloth.X
    stretch = (1 + GAP) / 1.0
    along = np.where(X[:, 0] > 0.51, X[:, 0] - GAP, X[:, 0]) * stretch
    np.testing.assert_allclose(x, np.column_stack([along, X[:, 1], 0 * along]), atol=1e-9)


def test_the_work_of_load_steps_that_close_a_seam_is_stored():
    system = opened(close=1.0)
    result = fc.run(system, LoadSteps(8), system.rest(), t_end=1.0)
    stored = result.energies["StVK"][-1]
    assert result.energies["work:seams"][-1] == pytest.approx(stored, rel=2e-3)
    assert np.abs(result.energies["remainder"]).max() < 1e-9 * stored


def test_a_continued_run_closes_as_one_run():
    """The state alone says how far a seam is open: a run that goes on has the same bits."""
    system = opened()
    method = fc.SymplecticEuler()
    whole = fc.run(system, method, system.rest(), dt=1e-4, t_end=0.02).state
    half = fc.run(system, method, system.rest(), dt=1e-4, t_end=0.01).state
    rest = fc.run(system, method, half, dt=1e-4, t_end=0.02).state
    np.testing.assert_allclose(rest.x, whole.x, rtol=0, atol=1e-15)
