"""Units against their definitions, written out here, and what is refused."""

import math

import pytest

from fecloth.errors import InputError
from fecloth.units import AREAL, HYSTERESIS, MOMENT, OF_FABRIC, PER_ANGLE, PER_WIDTH, quantity

KILOPOND, INCH, POUND = 9.80665, 0.0254, 0.45359237


@pytest.mark.parametrize(
    ("text", "units", "expected"),
    [
        ("150 g/m^2", AREAL, 0.15),
        ("150g/m²", AREAL, 0.15),
        ("20 mg/cm^2", AREAL, 20e-6 / 1e-4),
        ("11 oz/yd^2", AREAL, 11 * POUND / 16 / (36 * INCH) ** 2),
        ("2.5 kN/m", PER_WIDTH, 2500.0),
        (".5 N/mm", PER_WIDTH, 500.0),
        ("500 gf/cm", PER_WIDTH, 0.5 * KILOPOND / 0.01),
        ("1.2e3 N/m", PER_WIDTH, 1200.0),
        ("0.8 gf/(cm·deg)", PER_ANGLE, 0.8e-3 * KILOPOND / 0.01 / math.radians(1)),
        ("9.6 uN*m", MOMENT, 9.6e-6),
        ("9.6 µN·m", MOMENT, 9.6e-6),
        ("9.6 μN m", MOMENT, 9.6e-6),
        ("1 gf*cm^2/cm", MOMENT, 1e-3 * KILOPOND * 0.01**2 / 0.01),
        ("0.03 gf cm/cm", HYSTERESIS, 0.03e-3 * KILOPOND),
    ],
)
def test_units_are_their_definitions(text, units, expected):
    assert quantity("x", text, units) == pytest.approx(expected, rel=1e-12)


def test_the_unit_of_bending_is_98_07_micronewton_metres():
    assert quantity("x", "1 gf*cm^2/cm", MOMENT) == pytest.approx(98.07e-6, rel=1e-4)


def test_decimal_factors_leave_no_trace():
    assert quantity("x", "150 g/m^2", AREAL) == 0.15


@pytest.mark.parametrize(
    ("text", "units", "remedy"),
    [
        ("150", AREAL, "without a unit is in SI"),
        ("g/m^2", AREAL, "without a unit"),
        ("150 g/m", AREAL, "Did you mean 'g/m^2'?"),
        ("150 gsm", AREAL, ""),
        ("150 G/m^2", AREAL, "Did you mean"),
        ("9.6 uN/m", MOMENT, "Did you mean 'uN*m'?"),
        ("nan N/m", PER_WIDTH, "without a unit"),
        ("inf N/m", PER_WIDTH, "without a unit"),
        ("1e999 N/m", PER_WIDTH, ""),
        ("1 2 N/m", PER_WIDTH, "without a unit"),
        ("1,5 N/m", PER_WIDTH, ""),
        ("1.2.3 N/m", PER_WIDTH, "without a unit"),
        ("5 N/m + 2 N/m", PER_WIDTH, ""),
        ("", AREAL, "without a unit"),
    ],
)
def test_other_text_is_refused(text, units, remedy):
    with pytest.raises(InputError) as refused:
        quantity("areal_density", text, units)
    assert refused.value.what == f"areal_density = {text!r}"
    assert remedy in refused.value.remedy


def test_a_unit_of_another_quantity_is_refused():
    """N/m is stiffness, N*m a moment: the slip that costs most."""
    for name, units in OF_FABRIC.items():
        for other in set().union(*OF_FABRIC.values()) - set(units):
            with pytest.raises(InputError, match="one of the units"):
                quantity(name, f"1 {other}", units)
