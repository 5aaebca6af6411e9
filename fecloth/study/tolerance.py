"""Tolerances of studies: a fraction, or a text in percent."""

from __future__ import annotations

from fecloth.errors import InputError


def read_tolerance(value: float | str) -> float:
    """Return a relative tolerance, of a number or of a text such as "1%" or "0.01".

    Examples
    --------
    >>> read_tolerance("1%"), read_tolerance("0.5 %"), read_tolerance(0.02)
    (0.01, 0.005, 0.02)
    """
    text = str(value).strip()
    try:
        number = float(text.rstrip("% ")) / (100 if text.endswith("%") else 1)
    except ValueError:
        number = 0.0
    if not 0 < number < 1:
        raise InputError(f"tolerance = {value}", "must lie between 0 and 100 %, as 1% or 0.01")
    return number


def in_percent(value: float) -> str:
    """Return a fraction as text in percent.

    Examples
    --------
    >>> in_percent(0.0123), in_percent(2.5)
    ('1.2 %', '250 %')
    """
    return f"{100 * value:.2g} %" if abs(value) < 1 else f"{100 * value:.0f} %"
