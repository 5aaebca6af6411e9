"""Measured points: their uncertainty, their start along the curve, and repeats."""

import numpy as np
import pytest

from fecloth.errors import InputError
from fecloth.study.fitting.experiment import Experiment
from fecloth.study.fitting.measured import ASSUMED_SIGMA, read_measured

QUANTITY = {"force": "reaction.grip.x"}
ALONG = {"extension": "grip.x"}


def read(data, reach=(0.0, 0.1), along=ALONG, **more):
    experiment = Experiment("scene", data, quantity=QUANTITY, along=along, **more)
    (points,) = read_measured(experiment, ["N"], "m", reach)
    return points


FORCES = {"extension [m]": [0.02, 0.04, 0.06], "force [N]": [1.0, 2.0, -4.0]}


@pytest.mark.parametrize(
    ("sigma", "values"),
    [
        (None, 3 * [ASSUMED_SIGMA * 4.0]),
        ("5 %", 3 * [0.2]),
        ("0.1 N", 3 * [0.1]),
        ("20 mN", 3 * [0.02]),
        (0.3, 3 * [0.3]),
        ("error", [0.1, 0.2, 0.3]),
        ({"force": "5 %"}, 3 * [0.2]),
    ],
)
def test_sigma(sigma, values):
    points = read(FORCES | {"error [N]": [0.1, 0.2, 0.3]}, sigma=sigma)
    assert points.sigma == pytest.approx(values)
    assert points.is_assumed == (sigma is None)


@pytest.mark.parametrize("sigma", ["5 m", "errors", "0 %", -0.1, "repeats"])
def test_refused_sigma(sigma):
    with pytest.raises(InputError):
        read(FORCES, sigma=sigma)


def test_a_column_of_changes_starts_at_0():
    assert read(FORCES).along.tolist() == [0.02, 0.04, 0.06]


def test_a_column_beyond_the_reach_starts_at_its_first_value_in_each_repeat():
    data = {
        "extension [mm]": [91.0, 92.0, 94.0, 90.0, 91.0, 92.0],
        "force [N]": 6 * [1.0],
        "repeat": [1, 1, 1, 2, 2, 2],
    }
    moved = read(data, reach=(0.0, 0.01)).along
    assert moved == pytest.approx([0.0, 1e-3, 3e-3, 0.0, 1e-3, 2e-3])


@pytest.mark.parametrize(
    ("reach", "fits"), [(0.06 * (1 - 0.8e-6), True), (0.06 * (1 - 1.25e-6), False)]
)
def test_points_beyond_the_reach_are_refused(reach, fits):
    if fits:
        assert len(read(FORCES, reach=(0.0, reach)).values) == 3
    else:
        with pytest.raises(InputError, match=r"line 3: extension = 0.06 m: is beyond what the run"):
            read(FORCES, reach=(0.0, reach))


def test_with_an_offset_the_length_of_the_curve_must_fit():
    for reach in ((0.0, 0.041), (0.01, 0.051)):
        assert len(read(FORCES, reach=reach, offset=True).values) == 3
    with pytest.raises(InputError, match="is beyond"):
        read(FORCES, reach=(0.0, 0.039), offset=True)


def test_mean_of_repeats_and_its_uncertainty():
    """Two lines that are 0.2 N apart: their scatter is 0.2/√2, of the mean 0.1 N."""
    places = np.array([0.0, 0.02, 0.04])
    data = {
        "extension [m]": [*places, *places],
        "force [N]": [*(10 * places), *(10 * places + 0.2)],
        "repeat": [1, 1, 1, 2, 2, 2],
    }
    points = read(data, sigma="repeats")
    assert points.along == pytest.approx(places)
    assert points.values == pytest.approx(10 * places + 0.1)
    assert points.sigma == pytest.approx(3 * [0.1])
    assert points.scatter == pytest.approx(np.array([3 * [-0.1], 3 * [0.1]]))


def test_repeats_that_are_equal_are_uncertain_by_round_off():
    places, forces = [0.0, 0.02, 0.04], [1.0, 2.0, -4.0]
    data = {"extension [m]": 2 * places, "force [N]": 2 * forces, "repeat": [1, 1, 1, 2, 2, 2]}
    expected = np.full(3, 4 * np.finfo(float).eps)
    assert read(data, sigma="repeats").sigma == pytest.approx(expected, abs=0.0)


def test_repeats_without_a_common_part():
    data = {"extension [m]": [0.0, 0.01, 0.02, 0.03], "force [N]": 4 * [1.0]}
    with pytest.raises(InputError, match="no part of the curve in common"):
        read(data | {"repeat": [1, 1, 2, 2]}, sigma="repeats")
