"""Whether a scene itself is resolved: its errors, from half of h, half of dt or less rtol."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from fecloth.study.simplification.outcome import Trial
from fecloth.study.simplification.variants import Variant
from fecloth.study.tolerance import in_percent

WORDS = {"mesh": "mesh", "dt": "time step", "rtol": "tolerance of the steps"}


@dataclass(frozen=True)
class Resolution:
    """The error of a scene by one of its sizes."""

    kind: str  # "mesh", "dt" or "rtol"
    # Estimated relative error, and the quantity whose error needs the smallest size.
    error: float
    quantity: str
    # h [m], dt [s] or rtol of the scene, and the value at which the error would be within the
    # tolerance.
    size: float
    needed: float
    failure: str = ""  # why the error is unknown, or ""

    @property
    def is_resolved(self) -> bool:
        """Whether the error is within the tolerance."""
        return self.needed >= self.size

    def __str__(self) -> str:
        """Return the error in words, and which size would do."""
        what = WORDS[self.kind]
        if self.failure:
            return f"whether the {what} is resolved is not known: {self.failure}"
        text = f"the error of the {what} is about {in_percent(self.error)} ({self.quantity})"
        if self.is_resolved:
            return text
        name, unit = {"mesh": ("h", " m"), "dt": ("dt", " s"), "rtol": ("rtol", " 1/s")}[self.kind]
        needed = f"{name} of about {round_down(self.needed):g}{unit}"
        return f"{text}; {needed} in place of {self.size:g}{unit} would do"


def find_resolutions(
    checks: Sequence[Trial],
    sizes: Mapping[str, float],
    orders: Mapping[str, Mapping[str, float]],
    tolerance: float,
) -> list[Resolution]:
    """Return the error by each size that was refined.

    A refinement by r that changes a quantity by c shows the error c/(1 − r^−p) for the order p
    (Richardson 1911); the size for the tolerance t is that times (t/error)^(1/p).

    Parameters
    ----------
    sizes
        Of the scene, by kind.
    orders
        Of each quantity, by kind and text.
    """
    return [_resolution(*check, sizes, orders, tolerance) for check in checks]


def _resolution(variant: Variant, outcome, sizes, orders, tolerance: float) -> Resolution:
    kind = variant.kind
    size = sizes[kind]
    if not outcome.is_ok:
        cause = (outcome.cause.splitlines() or [outcome.status])[0]
        return Resolution(kind, math.nan, "", size, 0.0, f"{variant.name}: {cause}")
    found = []
    for text, change in outcome.changes.items():
        order = orders[kind][text]
        error = change / (1 - variant.by**order)
        needed = size * (tolerance / error) ** (1 / order) if error else math.inf
        found.append(Resolution(kind, error, text, size, needed))
    return min(found, key=lambda one: one.needed)


def round_down(value: float) -> float:
    """Return a number with two digits that is not larger.

    Examples
    --------
    >>> round_down(0.02379), round_down(0.05)
    (0.023, 0.05)
    """
    if not 0 < value < math.inf:
        return value
    unit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return float(f"{math.floor(value / unit + 1e-9) * unit:.2g}")
