"""Computed values along a curve and their derivatives, by closed forms."""

import numpy as np
import pytest

from fecloth.errors import InputError
from fecloth.study.fitting.computed import SPARE, best_shift, computed_curve, computed_values
from fecloth.study.fitting.measured import Measured

PLACES = np.array([0.1, 0.25, 0.4])


def points(places=PLACES):
    return Measured("force", "force", "N", 0.0 * places, 0.1 + 0.0 * places, places)


def row(p=2.0, c=0.5):
    """a = c s + s³ and q = p a², in s from 0 to 1: ∂q/∂p = a² and at a fixed place ∂q/∂c = 0."""
    s = np.linspace(0.0, 1.0, 41)
    a, q = c * s + s**3, p * (c * s + s**3) ** 2
    slopes_a, slopes_q = [0.0 * s, s], [a**2, 2 * p * a * s]
    values = [(1.0 + a).tolist(), q.tolist()]
    slopes = [[each.tolist() for each in pair] for pair in (slopes_a, slopes_q)]
    return {"values": values, "slopes": slopes, "times": s.tolist()}


def mirrored():
    """The rows of a curve that goes down."""
    down = row()
    down["values"][0] = [-value for value in down["values"][0]]
    down["slopes"][0] = [[-value for value in each] for each in down["slopes"][0]]
    return down


def curve(rows=None, along=0, places=PLACES, shift=None):
    return computed_curve(rows or row(), 1, along, points(places), shift)


def test_value_and_derivatives_at_fixed_places():
    result = curve()
    assert result.values == pytest.approx(2 * PLACES**2, rel=1e-4)
    assert result.slopes[:, 0] == pytest.approx(PLACES**2, rel=1e-4)
    assert result.slopes[:, 1] == pytest.approx(0.0, abs=1e-4)
    assert result.along_slope == pytest.approx(4 * PLACES, rel=1e-3)


def test_along_t_the_places_are_times():
    result = curve(along=None)
    a = 0.5 * PLACES + PLACES**3
    assert result.values == pytest.approx(2 * a**2, rel=1e-4)
    assert result.slopes[:, 1] == pytest.approx(4 * a * PLACES, rel=1e-3)


def test_a_shift_moves_the_places():
    result = curve(shift=0.05)
    assert result.values == pytest.approx(2 * (PLACES - 0.05) ** 2, rel=1e-4)


def test_before_the_shift_the_specimen_is_slack():
    result = curve(shift=0.2)
    assert result.values == pytest.approx([0.0, 2 * 0.05**2, 2 * 0.2**2], abs=1e-5)
    assert result.along_slope == pytest.approx([0.0, 4 * 0.05, 4 * 0.2], rel=1e-2)
    result = curve(mirrored(), places=-PLACES, shift=-0.2)
    assert result.values == pytest.approx([0.0, 2 * 0.05**2, 2 * 0.2**2], abs=1e-5)


def test_beyond_the_rows_the_curve_goes_on_straight():
    result = curve(places=np.array([-0.1, 1.57]))
    assert result.values == pytest.approx([0.0, 2 * 1.5**2 + 4 * 1.5 * 0.07], abs=2e-3)


@pytest.mark.parametrize(("beyond", "fits"), [(0.8, True), (1.25, False)])
def test_points_far_beyond_the_run_are_refused(beyond, fits):
    places = np.array([0.1, 1.5 * (1 + beyond * SPARE)])
    if fits:
        assert len(curve(places=places).values) == 2
    else:
        with pytest.raises(InputError, match=r"is measured up to 1.59375: the run reaches 1.5"):
            curve(places=places)


def test_a_curve_that_goes_down_is_read_backwards():
    result = curve(mirrored(), places=-PLACES)
    assert result.values == pytest.approx(2 * PLACES**2, rel=1e-4)


def test_rows_without_a_value_are_left_out():
    """The curve begins at the place of s = 1/8 then, and its tangent there goes back to 0."""
    first = row()
    first["values"][1][:5] = 5 * [np.nan]
    result = curve(first)
    assert result.values == pytest.approx(2 * PLACES**2, rel=1e-4)
    assert result.start == pytest.approx(-2 * (0.5 / 8 + 1 / 8**3) ** 2, rel=1e-2)


def test_a_curve_needs_two_rows_in_order():
    short = {key: row()[key] for key in ("values", "slopes", "times")}
    short["values"][1][1:] = 40 * [np.nan]
    with pytest.raises(InputError, match="has 1 rows with a value"):
        curve(short)
    back = row()
    back["values"][0][20] = 5.0
    with pytest.raises(InputError, match="goes back"):
        curve(back)


def test_numbers_without_a_curve():
    result = computed_values({"values": [3.0], "slopes": [[1.0, 2.0]]}, 0, 2)
    assert result.values.tolist() == [3.0, 3.0]
    assert result.slopes.tolist() == [[1.0, 2.0], [1.0, 2.0]]


def test_shift_of_a_curve_that_is_compared_only():
    measured = Measured("force", "force", "N", 2 * (PLACES - 0.07) ** 2, 0.1 + 0 * PLACES, PLACES)
    shift = best_shift(lambda at: computed_curve(row(), 1, 0, measured, at), measured, 0.2)
    assert shift == pytest.approx(0.07, abs=1e-4)
