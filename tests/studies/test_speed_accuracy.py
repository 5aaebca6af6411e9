"""studies/work_precision/: its references, its clockwork, its verdicts."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from studies.references.continuum import _pull, swinging_chain
from studies.work_precision.__main__ import distance
from studies.work_precision.runs import run

pytestmark = pytest.mark.stories


def chain_energy(x, l, Y, B, mass):
    """Of links, hinges and weight, written apart from the forces."""
    d = np.diff(x, axis=0)
    strain = ((d**2).sum(axis=1) / l**2 - 1) / 2
    angle = np.unwrap(np.arctan2(d[:, 1], d[:, 0]))
    return (
        (Y * l * strain**2 / 2).sum()
        + (B * np.diff(angle) ** 2 / (2 * l)).sum()
        + (9.81 * mass @ x[:, 1])
    )


def test_the_chains_forces_are_its_energys_slopes():
    rng = np.random.default_rng(1)
    l, Y, B = 0.1, 30.0, 0.2
    x = np.column_stack([l * np.arange(7), np.zeros(7)]) + 0.02 * rng.standard_normal((7, 2))
    mass, f = rng.uniform(0.1, 1.0, 7), np.zeros((7, 2))
    _pull(x, f, l, Y, B, mass)
    slopes = np.zeros_like(f)
    for i in np.ndindex(7, 2):
        push = np.zeros_like(x)
        push[i] = 1e-6
        ends = [chain_energy(x + s * push, l, Y, B, mass) for s in (1, -1)]
        slopes[i] = -(ends[0] - ends[1]) / 2e-6
    np.testing.assert_allclose(f, slopes, atol=1e-7)


def test_a_stiff_chain_falls_as_a_rod(monkeypatch):
    import fecloth as fc
    from studies.references import continuum
    from studies.work_precision.scenes import PAPER, SWING

    stiff = fc.Fabric(PAPER.areal_density, 2e4, bending_rigidity=1.0)
    monkeypatch.setattr(continuum, "PAPER", stiff)
    times = np.linspace(0, 0.25, 11)[1:]
    deep = swinging_chain(times, 20)["point"]
    fall = solve_ivp(
        lambda t, y: (y[1], 1.5 * 9.81 / SWING * math.cos(y[0])),
        (0, 0.25),
        (0.0, 0.0),
        t_eval=times,
        rtol=1e-9,
        atol=1e-12,
    )
    np.testing.assert_allclose(deep, SWING * np.sin(fall.y[0]), atol=2e-3 * SWING)


def test_a_run_of_every_kind_ends_at_the_same_path():
    """On one mesh compiled calls, the loop, an implicit method and Auto tell one story."""
    base = {"scene": "wave", "model": "StVK", "element": "P1", "h": 0.25, "repeats": 1}
    span = 8 / math.sqrt(5000)  # two periods of 4 L/c
    rows = {
        method: run(**base, method=method, step=step)
        for method, step in (
            ("many_steps", span / 1160),
            ("CentralDifference", span / 1160),
            ("ImplicitMidpoint", 2e-4),
            ("Auto", 1e-4),
        )
    }
    exact = rows["many_steps"]["mean"]
    assert distance(rows["CentralDifference"]["mean"], exact) < 1e-9
    assert distance(rows["ImplicitMidpoint"]["mean"], exact) < 1e-3
    allowed = 1e-4 * math.sqrt(1 / 12 + 0.25**2 / 12) * span  # rtol R t [m]
    assert distance(rows["Auto"]["mean"], exact) < allowed / np.abs(exact).max()
    assert rows["ImplicitMidpoint"]["steps"] == math.ceil(span / 2e-4)
    counts = rows["ImplicitMidpoint"]
    # one residual for the guess of a step, and one for each iteration at least
    assert counts["force_evaluations"] >= counts["steps"] + counts["newton"]
