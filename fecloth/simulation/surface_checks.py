"""What a run says of the shape of the cloth: stretches, triangles turned over, intersections."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fecloth.simulation.account import Account, Accounts, End, Run
from fecloth.system.state import State
from fecloth.system.system import System
from fecloth.terms.kinematics import extreme_stretches
from fecloth.terms.records import remembered

SQUEEZED = 0.2  # of the mean tension; a triangle with more compression counts as compressed
NOTHING = 1e-6  # of the fabric's stiffness; less compression is none


@dataclass(frozen=True)
class Shape:
    """The shape of a cloth at one time."""

    # Principal stretches of all triangles [-].
    least_stretch: float
    largest_stretch: float
    inverted: int  # triangles that are turned over against all their neighbours
    # Pairs of triangles that pass through each other; None if it was not counted.
    intersecting: int | None

    @classmethod
    def of(cls, run: Run, state: State, intersecting: int | None) -> Shape:
        """Return the shape of a cloth at a state, whose intersections were counted before."""
        stretches = extreme_stretches(run.system.cloth, state.x)
        return cls(*stretches, run.surface.count_inverted(state.x), intersecting)


@remembered
@dataclass(frozen=True)
class ShapeAtEnd(Account):
    """The shape at the end of a run."""

    name = "shape"
    t: float = math.nan  # of the end [s]
    shape: Shape | None = None

    def finish(self, run: Run, end: End, others: Accounts) -> ShapeAtEnd:
        pairs = run.surface.count_intersections(end.state.x)
        return ShapeAtEnd(end.state.t, Shape.of(run, end.state, pairs))

    def warnings(self) -> tuple[str, ...]:
        pairs = self.shape.intersecting if self.shape else None
        return (intersection_warning(self.t, pairs, "at"),)


def intersection_warning(t: float, pairs: float | None, since: str = "from") -> str:
    """Return a sentence if pairs of triangles intersect at t [s], or ""."""
    if not pairs or math.isnan(pairs):
        return ""
    return (
        f"the cloth passes through itself {since} t = {t:g} s ({pairs:.0f} pairs of triangles "
        "intersect); without SelfContact no layer rests on another: trust the motion up to there, "
        "add that term, or place the cloth so that its layers do not meet"
    )


def compressed_share(system: System, cells: Mapping[str, np.ndarray]) -> float:
    """Return the part of the reference area that is compressed, 0 without a membrane.

    A triangle is compressed if its smaller principal stress is below −0.2 times the root mean
    square of the larger ones, by more than round-off. `cells` is the cell data of a frame.
    """
    if "S11" not in cells:
        return 0.0
    S11, S22, S12 = cells["S11"], cells["S22"], cells["S12"]
    area = system.cloth.weights.sum(axis=1)
    mean, radius = (S11 + S22) / 2, np.hypot((S11 - S22) / 2, S12)
    tension = math.sqrt(float(area @ (mean + radius) ** 2) / area.sum())
    stiffness = min(min(fabric.tensile) for fabric in system.panel.fabrics)
    compressed = mean - radius < -(SQUEEZED * tension + NOTHING * stiffness)
    return float(area @ compressed) / float(area.sum())
