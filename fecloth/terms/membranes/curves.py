"""Measured curves of a fabric: read, checked, interpolated, and packed for the compiled law.

A curve is a stress S over a strain E. For warp and weft E is E11 or E22, and S = P/λ of the
force P at the stretch λ. For shear E is the engineering shear 2 E12 = sin γ, and S = τ/cos γ of the
force τ at the angle γ.
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
LEAST_END_SLOPE = 0.1
"""Least slope at an end of a curve, relative to the secant beside it.

PCHIP may have the slope 0 there, where a curve shaped like a J begins: the cloth would have no
stiffness at rest.
"""
STRETCH_LIMIT = 4.0
"""From this stretch on a column of stretches is taken for strains in percent, and refused.

5 % of strain is the stretch 1.05, so that a column in percent soon has larger numbers.
"""
MOST_ROWS = 10_000
"""Points of a curve; a measured one has some hundreds. Scenes and their copies hold them all."""
CELLS_PER_POINT = 8
"""Equal cells into which `pack` cuts a curve, for each of its points.

Only speed depends on it: where points crowd, the law follows several pieces from one cell.
"""
PIECE_SIZE = 8
"""Numbers of a piece in `pack`: those of `Curve.pieces`, and begin and place of the next."""


def read_rows(name: str, data: Any) -> Rows:
    """Read the points of the curve `name`, "warp", "weft" or "shear", from what a user may give.

    `data` is a file, a KES sheet, columns by name, or rows, see `CurveData`. The point at rest is
    added where it is missing. A column `stiffness`, dS/dE from point to point, may take the place
    of `force`. Raises `InputError` for data that cannot be read, and for a curve that `_check`
    refuses.
    """
    along, rest = _abscissa(name)
    unit = "rad" if name == "shear" else ""
    if isinstance(data, str | Path):
        label = f"{name} of {data}, line"
    else:
        label = f"{name}, row"
    if isinstance(data, Mapping) and data.keys() & instruments.KES_UNITS.keys():
        data = instruments.kes_curve(data, name)
    elif not isinstance(data, str | Path | Mapping):
        data = _columns(name, along, data)
    table = read_table(data, f"{WHERE}: {name}")
    if len(table.lines) > MOST_ROWS:
        what = f"{name} has {len(table.lines)} rows"
        remedy = "Leave out rows: a smooth curve needs some hundreds."
        raise InputError(what, f"must have at most {MOST_ROWS}", WHERE, remedy)
    column = "stiffness" if "stiffness" in table else "force"
    x = table.numbers(along, si=unit, plain=True)
    labels = [f"{label} {line}" for line in table.lines]
    values = table.numbers(column, si="N/m", plain=True)
    if len(x) and x[0] > rest:  # the point at rest is missing
        x = np.append(rest, x)
        values = np.append(0.0, values)
        labels = [name, *labels]
    force = values
    if column == "stiffness":  # dS/dE from the point before to each point
        E, force_per_stress = _strain(name, x)
        S = np.cumsum(values * np.diff(E, prepend=0.0))
        force = force_per_stress * S
    _check(name, along, x, force, labels)
    return tuple(zip(x.tolist(), force.tolist(), strict=True))


def _abscissa(name: str) -> tuple[str, float]:
    """What a curve is measured over, and its value at rest."""
    if name == "shear":
        return "angle", 0.0
    return "stretch", 1.0


def _columns(name: str, along: str, rows: Any) -> dict[str, Any]:
    """The columns of rows (k, 2); raises `InputError` for anything else."""
    try:
        x, force = zip(*np.array(rows, dtype=float).tolist(), strict=True)
    except (TypeError, ValueError):
        allowed = f"must be a file, a KES sheet, or rows of {along} and force, (k, 2)"
        raise InputError(f"{name} = {brief(rows)}", allowed, WHERE) from None
    return {along: x, "force": force}


def _strain(name: str, x: Array) -> tuple[Array, Array]:
    """E at the stretches or angles x, and the ratio force/S there."""
    if name == "shear":
        return np.sin(x), np.cos(x)
    return 0.5 * (x * x - 1.0), x


def _check(name: str, along: str, x: Array, force: Array, labels: Sequence[str]) -> None:
    """Raise `InputError` unless a curve begins at rest, rises, and ends below the limit.

    Both x and the stress S must rise from point to point: an energy W with a stress that falls
    is not convex. `along` is the name of x, and `labels` are the names of the points in messages.
    """
    _check_begin(name, along, x, force, labels[0])
    _check_end(name, along, x[-1], labels[-1])
    ratio = "cos(angle)" if name == "shear" else "stretch"
    _, force_per_stress = _strain(name, x)
    S = force / force_per_stress
    for what, values in ((along, x), (f"S = force/{ratio}", S)):
        if (falls := np.flatnonzero(np.diff(values) <= 0)).size:
            row = 1 + int(falls[0])  # the first that does not rise
            said = f"{labels[row]}: {what} = {values[row]:g} after {values[row - 1]:g}"
            remedy = "Leave out rows, or smooth the curve."
            raise InputError(said, "must rise from row to row", WHERE, remedy)


def _check_begin(name: str, along: str, x: Array, force: Array, label: str) -> None:
    """Raise `InputError` for a curve that does not begin at rest, or has one point only."""
    _, rest = _abscissa(name)
    if x[0] != rest or force[0] != 0.0 or len(x) < 2:
        what = f"{label}: {along} = {x[0]:g}, force = {force[0]:g} N/m"
        allowed = f"must begin at {along} = {rest:g} with force 0, and have a second row"
        advice = "A strain e is the stretch 1 + e."
        remedy = f"{advice} Leave out compression, and what the start has."
        raise InputError(what, allowed, WHERE, remedy)


def _check_end(name: str, along: str, last: float, label: str) -> None:
    """Raise `InputError` for a stretch in percent, or an angle of a right angle or more."""
    limit = STRETCH_LIMIT
    allowed = f"must be below {STRETCH_LIMIT:g}: at rest it is 1, with 5 % strain 1.05"
    if name == "shear":
        limit = np.pi / 2
        allowed = "must be below π/2 [rad]; degrees have the column angle [deg]"
    if last >= limit:
        raise InputError(f"{label}: {along} = {last:g}", allowed, WHERE)


@dataclass(frozen=True, eq=False)
class Curve:
    """A stress S(E) through k points, from E = 0 on, and straight beyond both ends.

    Between the points S is the cubic with the given slopes at both points.

    Attributes
    ----------
    E
        (k,) The strains of the points, rising from 0.
    S
        (k,) The stresses there [N/m].
    slopes
        (k,) dS/dE there [N/m].
    end
        The strain up to which the curve was measured; infinite for a straight line.
    """

    E: Array
    S: Array
    slopes: Array
    end: float

    @classmethod
    def through(cls, name: str, rows: Rows) -> Self:
        """The curve through points by PCHIP, with the slopes at both ends kept above 0."""
        x, force = np.array(rows).T
        E, force_per_stress = _strain(name, x)
        S = force / force_per_stress
        slopes = scipy.interpolate.PchipInterpolator(E, S)(E, 1)
        secants = np.diff(S) / np.diff(E)
        slopes[[0, -1]] = np.maximum(slopes[[0, -1]], LEAST_END_SLOPE * secants[[0, -1]])
        return cls(E, S, slopes, end=float(E[-1]))

    @classmethod
    def straight(cls, stiffness: float) -> Self:
        """The line S = stiffness · E."""
        E = np.array([0.0, 1.0])
        return cls(E, stiffness * E, np.full(2, stiffness), end=np.inf)

    def steeper(self, slope: float) -> Self:
        """The curve S + slope · E."""
        return type(self)(self.E, self.S + slope * self.E, self.slopes + slope, self.end)

    @property
    def rest(self) -> float:
        """dS/dE at rest [N/m]."""
        return float(self.slopes[0])

    def pieces(self) -> Array:
        """(k, 6) the pieces of the curve: E₀, w₀, a₀, a₁, a₂, a₃.

        A piece begins at E₀ with the energy w₀, and S = Σ aᵢ (E − E₀)ⁱ. The last piece is the
        straight line beyond the last point.
        """
        spline = scipy.interpolate.CubicHermiteSpline(self.E, self.S, self.slopes)
        beyond = [[self.S[-1]], [self.slopes[-1]], [0.0], [0.0]]
        powers = np.hstack([spline.c[::-1], beyond])
        return np.vstack([self.E, spline.antiderivative()(self.E), powers]).T

    def least_slope(self) -> float:
        """min dS/dE [N/m] over the whole curve.

        In a piece the slope is the parabola a₁ + 2 a₂ t + 3 a₃ t² of t = E − E₀. It is least at
        an end of the piece or, if a₃ > 0, at the vertex t = −a₂/(3 a₃) where that lies inside.
        """
        a1, a2, a3 = self.pieces()[:-1, 3:].T
        vertex = -a2 / np.where(a3 > 0, 3 * a3, np.inf)
        t = np.clip(vertex, 0.0, np.diff(self.E))
        inside = a1 + t * (2 * a2 + 3 * a3 * t)
        return float(min(self.slopes.min(), inside.min()))


def pack(coupling: float, curves: Sequence[Curve]) -> Array:
    """Return the curves of a fabric as one array (p,) of constants for the compiled law.

    It begins with the coupling c [N/m], the number of cells per unit of E for each curve, and
    the number of cells. Then come rows of `PIECE_SIZE` numbers, which are the pieces.

    Each curve is cut into equal cells up to its last point. The row of a cell is the piece in
    which the cell begins. So the law finds a piece by one division and needs no search, whose
    branches a processor guesses wrong where strains jump. Where points lie inside a cell, the
    row leads on to the next pieces of `Curve.pieces`, which follow the cells. First come the
    cells 0 of all curves, then the cells 1, …
    """
    most_points = max(len(curve.E) for curve in curves)
    cells = CELLS_PER_POINT * most_points
    cells_per_strain = [cells / curve.E[-1] for curve in curves]
    first_row = 2 + len(curves)  # the place of the first row in the array
    # Of each curve: the cells, a row for strains beyond its last point, and its pieces. NaN in
    # unused rows: no strain is beyond the NaN of a next piece.
    rows = np.full((cells + 1 + most_points, len(curves), PIECE_SIZE), np.nan)
    for k, curve in enumerate(curves):
        points = len(curve.E)
        next_row = cells + 2 + np.arange(points)
        next_place = first_row + PIECE_SIZE * (k + len(curves) * next_row)
        next_begin = np.append(curve.E[1:], np.nan)  # the last piece has no next one
        pieces = np.column_stack([curve.pieces(), next_begin, next_place])
        begins = np.linspace(0.0, curve.E[-1], cells + 1)[:-1]
        rows[:cells, k] = pieces[np.searchsorted(curve.E, begins, "right") - 1]
        rows[cells, k] = pieces[-1]
        rows[cells + 1 :][:points, k] = pieces
    return np.concatenate([[coupling], cells_per_strain, [cells], rows.ravel()])
