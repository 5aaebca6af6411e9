"""The shape of the cloth at the frames of a run: its columns in strains.csv, and its warnings."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from fecloth.mesh.surface import Surface
from fecloth.runs.csv_table import Table
from fecloth.scene.problem import Problem
from fecloth.simulation.doubts.course import wrinkle_warning
from fecloth.simulation.surface_checks import Shape, compressed_share, intersection_warning
from fecloth.system.state import State
from fecloth.system.system import System
from fecloth.terms.kinematics import extreme_stretches

APART = {True: 150, False: 6}  # fewest steps between two counts, explicit or not: a tenth of them


@dataclass(frozen=True, eq=False)
class ShapeWatch:
    """Computes the columns of a frame in strains.csv, and the warnings that follow from them."""

    # The system, and its cloth as a surface of flat triangles.
    system: System
    surface: Surface
    # Least number of steps between two counts of intersections; infinite for no counts. A count
    # takes as long as about fifteen explicit steps, or half an implicit one.
    apart: float

    @classmethod
    def bind(cls, problem: Problem) -> ShapeWatch:
        """Return the watch of a problem whose method is chosen."""
        apart = APART[problem.method.traits.explicit] if problem.intersections else math.inf
        return cls(problem.system, Surface.of(problem.cloth), apart)

    def is_due(self, steps: float, ended: bool) -> bool:
        """Return whether a frame is counted, `steps` after the last count, or at the end."""
        return not math.isinf(self.apart) and (ended or steps >= self.apart)

    def row(self, state: State, cells: Mapping[str, np.ndarray], counts: bool) -> dict[str, float]:
        """Return the columns of a frame with this cell data; NaN for what is not counted."""
        pairs = self.surface.count_intersections(state.x) if counts else None
        return {
            "compressed": compressed_share(self.system, cells),
            "inverted": self.surface.count_inverted(state.x),
            "intersecting": math.nan if pairs is None else pairs,
        }

    def shape(self, state: State, row: Mapping[str, float]) -> Shape:
        """Return the shape of the cloth at a state; `row` is that of the last frame."""
        count = row.get("intersecting", math.nan)
        stretches = extreme_stretches(self.system.cloth, state.x)
        inverted = self.surface.count_inverted(state.x)
        return Shape(*stretches, inverted, None if math.isnan(count) else int(count))

    def warnings(self, row: Mapping[str, float]) -> Iterator[str]:
        """Yield the sentences for a row of strains.csv; empty ones are none."""
        yield intersection_warning(row["t"], row["intersecting"])
        yield wrinkle_warning(self.system, row["t"], row["compressed"])


def last_count(strains: Table, steps: Table) -> int:
    """Return the step of the last frame at which intersections were counted."""
    pairs = zip(strains.column("t"), strains.column("intersecting"), strict=True)
    times = [t for t, count in pairs if not math.isnan(count)]
    numbers = dict(zip(steps.column("t"), steps.column("step"), strict=True))
    return int(numbers.get(times[-1], 0)) if times else 0


def shape_summary(strains: Table) -> dict[str, float | int | None]:
    """Return the extremes over all frames, for summary.json."""
    counts = [count for count in strains.column("intersecting") if not math.isnan(count)]
    return {
        "least_stretch": min(strains.column("smallest")),
        "largest_stretch": max(strains.column("largest")),
        "inverted_triangles": int(max(strains.column("inverted"))),
        "intersecting_pairs": int(max(counts)) if counts else None,
    }


def shape_message(summary: Mapping) -> str:
    """Return the extremes over all frames in words."""
    pairs = summary["intersecting_pairs"]
    inverted = f"at most {summary['inverted_triangles']} triangles turned over"
    counts = f"{inverted} and {pairs} pairs that intersect, in any frame"
    if pairs is None:
        counts = f"{inverted} in any frame; intersections were not counted"
    return f"stretch {summary['least_stretch']:.4g} to {summary['largest_stretch']:.4g}, {counts}"
