"""A term that a user writes: studies/examples/term.py, and what is refused."""

import re

import numpy as np
import pytest
from conftest import rough
from support.examples import example

import fecloth as fc
from fecloth.stability.critical_step import rate_bounds


@pytest.fixture(scope="module")
def own():
    return example("term")


@pytest.fixture(scope="module")
def cloth():
    return fc.Cloth.rectangle(0.4, 0.3, h=0.1, pattern="right")


def test_cloth_on_a_winkler_bed_agrees_with_the_formula(own):
    """S z'' = k z + ρ g with z = 0 at both ends, solved by the test in 2,000 differences."""
    S, k, n = 1000 * 0.5 * (1.1**2 - 1), 1000.0, 2000
    h = 1 / n
    second = (np.eye(n - 1, k=1) + np.eye(n - 1, k=-1) - 2 * np.eye(n - 1)) / h**2
    z = np.linalg.solve(S * second - k * np.eye(n - 1), np.ones(n - 1))[n // 2 - 1]
    coarse, fine = (own.sag(k, h) / (k * z) - 1 for h in (0.1, 0.05))
    assert abs(fine) < 2e-3
    assert np.log2(coarse / fine) == pytest.approx(2, abs=0.2)
    lines = re.findall(r"by (\S+) .* formula (\S+)", own.printed)
    assert len(lines) == 4
    for computed, formula in lines:
        assert float(computed) == pytest.approx(float(formula), rel=3e-4)


def test_all_ways_to_write_an_elastic_bed_give_the_same_force(own, cloth, isotropic, rng):
    k, nodes = 300.0, np.arange(len(cloth.X))[:, None]
    ways = [
        own.Winkler(k),
        fc.Condition(lambda y: y[:, 0, 2], nodes, k * cloth.load()),
        fc.UserForce((0, 0, f"{-k} * z")),
    ]
    systems = [fc.System(cloth, isotropic, [way]) for way in ways]
    state = systems[0].state(rough(cloth, rng))
    for other in systems[1:]:
        assert abs(other.force(state) - systems[0].force(state)).max() < 1e-12
        assert abs(other.stiffness(state) - systems[0].stiffness(state)).max() < 1e-6  # differences
        assert rate_bounds(other) == pytest.approx(rate_bounds(systems[0]), rel=1e-6)
    energy = 0.5 * k * float(cloth.load() @ state.x[:, 2] ** 2)
    assert systems[0].energies(state)["Winkler"] == pytest.approx(energy, rel=1e-13)
    assert systems[1].energies(state)["Condition"] == pytest.approx(energy, rel=1e-12)


@pytest.mark.stories
def test_a_bed_bounces_at_its_frequency_and_keeps_its_energy(own, cloth, isotropic):
    """√(k/ρ) for a cloth that moves as one piece; the ledger has a column for the term."""
    k = 300.0
    system = fc.System(cloth, isotropic, [fc.StVK(), own.Winkler(k)])
    start = system.state(system.rest().x + [0, 0, 0.01])
    period = 2 * np.pi * np.sqrt(0.2 / k)
    for method in (fc.EnergyMomentum(), fc.CentralDifference()):
        result = fc.run(system, method, start, period / 400, period)
        assert result.state.x[:, 2] == pytest.approx(np.full(len(cloth.X), 0.01), rel=1e-3)
        opening = 0.5 * k * cloth.area * 0.01**2
        assert result.energies["Winkler"][0] == pytest.approx(opening, rel=1e-12)
        assert np.ptp(result.energies["total"] + result.energies["numerical"]) < 1e-6 * opening
