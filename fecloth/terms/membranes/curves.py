"""Measured curves of a fabric as stress over strain: read, checked, splined, packed for the law.

A curve is S(E): E11 or E22 and S = P/λ; or the engineering shear 2 E12 = sin γ and S = τ/cos γ.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
import scipy

from fecloth.compiled.jit import Array
from fecloth.errors import InputError, brief
from fecloth.fabric import instruments
from fecloth.quantities.columns import read_table

Rows = tuple[tuple[float, float], ...]
"""Stretch [-] and force [N/m], or angle [rad] and force [N/m]."""
CurveData = str | Path | Mapping[str, Any] | Sequence[Sequence[float]] | np.ndarray
"""A file, columns by name or a KES sheet, or rows."""

WHERE = "MembraneTable"
LEAST_END = 0.1  # of the secant beside it: the least slope at an end, where PCHIP may have 0
LONGEST = 4.0  # stretch; more is taken for a strain in percent
CELLS = 8  # for each point
ROUND_OFF = 1e-12  # relative, of where a cell begins
PIECE = 8  # numbers of a piece: begin, energy there, four coefficients, next begin and its place


def read_rows(name: str, data: Any) -> Rows:
    """The points of `warp`, `weft` or `shear`, with the one at rest, from what a user may give."""
    if name == "shear":
        along, unit, rest = ("angle", "rad", 0.0)
    else:
        along, unit, rest = ("stretch", "", 1.0)
    if isinstance(data, str | Path):
        label = f"{name} of {data}, line"
    else:
        label = f"{name}, row"
    if isinstance(data, Mapping) and data.keys() & instruments.KES_UNITS.keys():
        data = instruments.kes_curve(data, name)
    elif not isinstance(data, str | Path | Mapping):
        data = _columns(name, along, data)
    table = read_table(data, f"{WHERE}: {name}")
    x = table.numbers(along, unit, True)
    labels = [f"{label} {line}" for line in table.lines]
    force = table.numbers("stiffness" if "stiffness" in table else "force", "N/m", True)
    if len(x) and x[0] > rest:
        x = np.append(rest, x)
        force = np.append(0.0, force)
        labels = [name, *labels]
    if "stiffness" in table:
        E, over = _strain(name, x)
        force = over * np.cumsum(force * np.diff(E, prepend=0.0))
    _check(name, along, x, force, labels)
    return tuple(zip(x.tolist(), force.tolist(), strict=True))


def _columns(name: str, along: str, rows: Any) -> dict[str, Any]:
    try:
        x, force = zip(*np.array(rows, dtype=float).tolist(), strict=True)
    except (TypeError, ValueError):
        allowed = f"must be a file, a KES sheet, or rows of {along} and force, (k, 2)"
        raise InputError(f"{name} = {brief(rows)}", allowed, WHERE) from None
    return {along: x, "force": force}


def _strain(name: str, x: Array) -> tuple[Array, Array]:
    """E of the stretches or angles x, and force/S there."""
    if name == "shear":
        return (np.sin(x), np.cos(x))
    return (0.5 * (x * x - 1.0), x)


def _check(name: str, along: str, x: Array, force: Array, labels: Sequence[str]) -> None:
    """Refuse a curve that does not begin at rest, that does not rise, or that ends beyond π/2."""
    rest, ratio = (0.0, "cos(angle)") if name == "shear" else (1.0, "stretch")
    if x[0] != rest or force[0] != 0.0 or len(x) < 2:
        what = f"{labels[0]}: {along} = {x[0]:g}, force = {force[0]:g} N/m"
        allowed = f"must begin at {along} = {rest:g} with force 0, and have a second row"
        remedy = "A strain e is the stretch 1 + e. Leave out compression, and what the start has."
        raise InputError(what, allowed, WHERE, remedy)
    most = LONGEST
    allowed = f"must be below {LONGEST:g}: at rest it is 1, with 5 % strain 1.05"
    if name == "shear":
        most = np.pi / 2
        allowed = "must be below π/2 [rad]; degrees have the column angle [deg]"
    if x[-1] >= most:
        raise InputError(f"{labels[-1]}: {along} = {x[-1]:g}", allowed, WHERE)
    for what, values in ((along, x), (f"S = force/{ratio}", force / _strain(name, x)[1])):
        if (falls := np.flatnonzero(np.diff(values) <= 0)).size:
            row = 1 + int(falls[0])
            said = f"{labels[row]}: {what} = {values[row]:g} after {values[row - 1]:g}"
            remedy = "Leave out rows, or smooth the curve."
            raise InputError(said, "must rise from row to row", WHERE, remedy)


@dataclass(frozen=True, eq=False)
class Curve:
    """S(E) from E = 0 to the last point, and straight on beyond both."""

    E: Array  # (k,)
    S: Array  # (k,) [N/m]
    slopes: Array  # (k,) dS/dE [N/m]
    end: float  # E up to which it was measured

    @classmethod
    def through(cls, name: str, rows: Rows) -> Self:
        """The curve through points by PCHIP, whose slope at an end may not be 0."""
        x, force = np.array(rows).T
        E, over = _strain(name, x)
        S = force / over
        slopes = scipy.interpolate.PchipInterpolator(E, S)(E, 1)
        secants = np.diff(S) / np.diff(E)
        slopes[[0, -1]] = np.maximum(slopes[[0, -1]], LEAST_END * secants[[0, -1]])
        return cls(E, S, slopes, float(E[-1]))

    @classmethod
    def straight(cls, stiffness: float) -> Self:
        return cls(np.array([0.0, 1.0]), np.array([0.0, stiffness]), np.full(2, stiffness), np.inf)

    @property
    def rest(self) -> float:
        """dS/dE at rest [N/m]."""
        return float(self.slopes[0])

    def pieces(self) -> Array:
        """(k, 6) between the points and beyond the last one: E₀, w₀, and S by powers of E − E₀."""
        spline = scipy.interpolate.CubicHermiteSpline(self.E, self.S, self.slopes)
        beyond = [[self.S[-1]], [self.slopes[-1]], [0.0], [0.0]]
        powers = np.hstack([spline.c[::-1], beyond])
        return np.vstack([self.E, spline.antiderivative()(self.E), powers]).T

    def least_slope(self) -> float:
        """min dS/dE [N/m]: of the parabola a₁ + 2 a₂ t + 3 a₃ t² in each piece, and of its ends."""
        a1, a2, a3 = self.pieces()[:-1, 3:].T
        t = np.clip(-a2 / np.where(a3 > 0, 3 * a3, np.inf), 0.0, np.diff(self.E))
        return float(min(self.slopes.min(), (a1 + t * (2 * a2 + 3 * a3 * t)).min()))


def pack(coupling: float, curves: Sequence[Curve]) -> Array:
    """(p,) what the compiled law reads: c, cells per E of each curve, their number, and pieces.

    Each curve is cut into equal cells up to its last point. A cell has the piece in which it
    begins; so the law needs no search, whose branches a processor guesses wrong where strains
    jump. Points inside of a cell lead on to the pieces of `Curve.pieces`, which follow the
    cells. First come the cells 0 of all curves, then the cells 1, …
    """
    most = max(len(curve.E) for curve in curves)
    cells = CELLS * most
    first = 2 + len(curves)
    rows = np.full((cells + 1 + most, len(curves), PIECE), np.nan)  # E is never beyond NaN
    for k, curve in enumerate(curves):
        n = len(curve.E)
        places = first + PIECE * (k + len(curves) * (cells + 2 + np.arange(n)))  # of the next piece
        pieces = np.column_stack([curve.pieces(), np.append(curve.E[1:], np.nan), places])
        begins = np.linspace(0.0, (1 - ROUND_OFF) * curve.E[-1], cells + 1)[:-1]
        rows[:cells, k] = pieces[np.searchsorted(curve.E, begins, "right") - 1]
        rows[cells, k] = pieces[-1]
        rows[cells + 1 :][:n, k] = pieces
    return np.concatenate([[coupling], *([cells / c.E[-1]] for c in curves), [cells], rows.ravel()])
