"""Numbers with as many digits as their uncertainty allows."""

import math

ROUND_OFF = 1e-13  # over the value: a smaller uncertainty is noise of sums of doubles


def with_uncertainty(value: float, uncertainty: float, unit: str = "") -> str:
    """Return a value and its uncertainty, both to the second digit of the uncertainty.

    Numbers from 0.001 to 100,000 are decimals, as "1.23 ± 0.12"; other ones have a power of
    ten. Without an uncertainty above round-off, or for numbers that are not finite, the value has
    up to eight digits. An uncertainty that is NaN is not known.
    """
    if math.isnan(uncertainty) and math.isfinite(value):
        return f"{value:.8g} {unit}".strip() + ", ± not known"
    size = max(abs(value), uncertainty)
    if not uncertainty > ROUND_OFF * size or not size < float("inf"):
        text = f"{value:.8g} ± {uncertainty:.2g}"
    elif 1e-3 <= size < 1e5 and uncertainty > 1e-9 * size:
        places = max(_places(uncertainty), 0)
        text = f"{value:.{places}f} ± {uncertainty:.{places}f}"
    else:
        digits = max(_places(uncertainty) - _places(size) + 1, 1)
        text = f"{value:.{digits}e} ± {uncertainty:.1e}"
    return f"{text} {unit}".strip()


def _places(number: float) -> int:
    """Return the decimal places of the second digit of a number."""
    return 1 - int(f"{number:.1e}".partition("e")[2])
