"""studies/work_precision/: its references, its clockwork, its verdicts."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from studies.references.continuum import _pull, swinging_chain
from studies.work_precision.__main__ import add_errors, distance
from studies.work_precision.figures import front
from studies.work_precision.runs import run
from studies.work_precision.scenes import SCENES
from studies.work_precision.tables import cheapest

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


def test_the_error_is_split_and_the_cheapest_found():
    scene = SCENES["wave"]("StVK", "P1", 0.5)
    times = scene.times
    exact = 2e-4 / np.pi * np.cos(math.pi / 2 * math.sqrt(5000) * times)
    base = {"scene": "wave", "model": "StVK", "element": "P1", "status": "ok"}

    def row(h, factor, seconds):
        path = (factor * exact).tolist()
        return base | {"h": h, "mean": path, "point": path, "seconds": seconds, "method": "x"}

    fine = [row(0.2, 1.04, 1.0), row(0.1, 1.01, 1.0)]
    rows = [row(0.2, 1.06, 0.5), row(0.1, 1.012, 3.0), row(0.1, 1.5, 0.1)]
    add_errors(rows, fine, coarse=True)
    first = rows[0]
    assert first["total_error"] == pytest.approx(0.06)
    assert first["time_error"] == pytest.approx(0.02 / 1.04)
    assert first["space_error"] == pytest.approx(0.03 / 1.01)
    assert first["model_error"] == pytest.approx(0.01)
    assert cheapest(rows, "wave", 0.1) is rows[0]
    assert cheapest(rows, "wave", 0.02) is rows[1]
    assert cheapest(rows, "wave", 0.001) is None
    assert front(rows) == [rows[2], rows[0], rows[1]]
