"""What a run has come to against what its scene expects."""

import dataclasses
import math

import numpy as np
import pytest

from fecloth.scene.probe_tables import Expectation, check, read_measured


def columns(**given):
    return {name: np.array(values) for name, values in given.items()}


def test_check_compares_at_the_end_and_between_steps():
    def total(at):
        return Expectation(value=5.0, absolute=0.01, at=at)

    expect = {"sag": (Expectation(value=2.0, relative=0.1),)}
    expect["total"] = tuple(total(at) for at in (0.05, 0.1, 0.01, 0.02))
    times = np.array([0.02, 0.04, 0.08])
    energies = columns(total=[5.0, 4.0, 8.0])
    at_end, between, *outside, first = check(expect, times, columns(sag=[0, 1, 2.19]), energies)
    assert dataclasses.astuple(at_end) == ("sag", 0.08, 2.19, 2.0, 0.2, True, " s")
    assert (between.name, between.at, between.passed) == ("total", 0.05, True)
    assert between.value == pytest.approx(5.0)
    assert first.passed
    for verdict in outside:  # after the end, and before the start
        assert math.isnan(verdict.value)
        assert not verdict.passed
    missed, *_ = check(expect, times, columns(sag=[0, 1, 2.21]), energies)
    assert not missed.passed


def test_measured_values_have_units():
    table = {"tip.z": ["36 mm", "0.5 mm"], "reaction.left.z": ["2 gf", "5 %"], "sag": [0.1, 0.01]}
    table |= {"total": ["3 J", "0.1 J"], "StVK": ["5 mJ", "2 %"], "energy.StVK": ["5 mJ", 1e-4]}
    measured = read_measured(table, ["StVK", "total"])
    assert measured["tip.z"] == (0.036, 0.0005)
    assert measured["reaction.left.z"] == pytest.approx((2 * 0.00980665, 0.05 * 2 * 0.00980665))
    assert measured["sag"] == (0.1, 0.01)
    assert measured["total"] == (3.0, 0.1)
    assert measured["StVK"] == pytest.approx((5e-3, 1e-4))
    assert measured["energy.StVK"] == pytest.approx((5e-3, 1e-4))
