"""The levels of a refinement in h, in dt, or in both."""

from __future__ import annotations

from dataclasses import dataclass

from fecloth import validation
from fecloth.errors import InputError
from fecloth.suggest import did_you_mean

REFINED = ("h", "dt", "both")


@dataclass(frozen=True)
class Level:
    """One level: h, dt and two tolerances are divided by these; the first has 1, 1, 1, 1.

    `sharper` is for the tolerance of the solver, a fixed one; None leaves the solver as the problem
    has it. `rtol` is for the tolerance of chosen steps.
    """

    h: float = 1.0
    dt: float = 1.0
    sharper: float | None = 1.0
    rtol: float = 1.0

    def __str__(self) -> str:
        sizes = (("h", self.h), ("dt", self.dt), ("rtol", self.rtol))
        parts = [f"{name} / {by:.3g}" for name, by in sizes if by != 1]
        parts += ["a sharper tolerance"] if self.sharper not in (None, 1.0) else []
        return " and ".join(parts) or "the first level"


FIRST = Level()
AS_IS = Level(sharper=None)  # with the solver of the problem


def make_levels(
    refine: str, levels: int, ratio: float, space_order: float = 1.0, time_order: float = 1.0
) -> list[Level]:
    """Return the levels, coarse to fine.

    With "both", dt ∝ h^(p/q) for the orders p in space and q in time: then the errors of both
    keep their share.

    Examples
    --------
    >>> make_levels("both", 3, 2.0, space_order=2, time_order=1)[1:]
    [Level(h=2.0, dt=4.0, sharper=1.0, rtol=1.0), Level(h=4.0, dt=16.0, sharper=1.0, rtol=1.0)]
    """
    if refine not in REFINED:
        remedy = did_you_mean(refine, REFINED)
        raise InputError(f"refine = {refine!r}", 'must be "h", "dt" or "both"', "converge", remedy)
    if not (isinstance(levels, int) and 3 <= levels <= 10):
        raise InputError(f"levels = {levels!r}", "must be an integer from 3 to 10", "converge")
    validation.number("ratio", ratio, 0.0, "converge")
    if not 1.1 <= ratio <= 10:
        raise InputError(f"ratio = {ratio:g}", "must lie between 1.1 and 10", "converge")
    in_h = ratio if refine != "dt" else 1.0
    in_dt = ratio if refine == "dt" else 1.0
    if refine == "both":
        in_dt = ratio ** (space_order / time_order)
    return [Level(in_h**k, in_dt**k) for k in range(levels)]
