"""What the frames of a run say of its shape: a row of strains.csv, warnings, the summary."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from fecloth.simulation.account import Account, Accounts, End, Run
from fecloth.simulation.doubts.course import wrinkle_warning
from fecloth.simulation.surface_checks import Shape, compressed_share, intersection_warning
from fecloth.system.state import State
from fecloth.terms.records import remembered

STRETCHES = ("smallest", "1 %", "median", "99 %", "largest")


@remembered
@dataclass(frozen=True)
class FrameShape(Account):
    """The shape of the cloth at the frames so far."""

    name = "shape"
    # Over all frames: principal stretches, triangles turned over, pairs of triangles that
    # intersect (None if they were never counted).
    least_stretch: float = math.inf
    largest_stretch: float = -math.inf
    inverted: int = 0
    intersecting: int | None = None
    # At the last frame: its step, the pairs (None if not counted), reasons to doubt the run.
    step: int = 0
    pairs: int | None = None
    doubts: tuple[str, ...] = ()
    counted: float = -math.inf  # step of the last count of pairs
    shape: Shape | None = None  # at the end

    def at_frame(
        self, run: Run, state: State, cells: Mapping[str, np.ndarray], step: int, counts: bool
    ) -> tuple[FrameShape, dict[str, float]]:
        """Return the record after a frame with this cell data, and its row of strains.csv.

        The pairs of triangles that intersect are counted if `counts`; otherwise they are NaN.
        """
        pairs = run.surface.count_intersections(state.x) if counts else None
        inverted = run.surface.count_inverted(state.x)
        compressed = compressed_share(run.system, cells)
        doubts = (
            intersection_warning(state.t, pairs),
            wrinkle_warning(run.system, state.t, compressed),
        )
        row = stretch_row(state.t, cells["principal_stretches"])
        after = replace(
            self,
            least_stretch=min(self.least_stretch, row["smallest"]),
            largest_stretch=max(self.largest_stretch, row["largest"]),
            inverted=max(self.inverted, inverted),
            intersecting=self.intersecting if pairs is None else max(self.intersecting or 0, pairs),
            step=step,
            pairs=pairs,
            doubts=tuple(filter(None, doubts)),
            counted=step if counts else self.counted,
        )
        intersecting = math.nan if pairs is None else pairs
        more = {"compressed": compressed, "inverted": inverted, "intersecting": intersecting}
        return after, row | more

    def finish(self, run: Run, end: End, others: Accounts) -> FrameShape:
        return replace(self, shape=Shape.of(run, end.state, self.pairs))

    def warnings(self) -> tuple[str, ...]:
        """Return what the last frame shows; the start counts where no step follows."""
        return self.doubts if self.step or self.shape else ()

    def summary(self) -> dict[str, object]:
        return {
            "least_stretch": self.least_stretch,
            "largest_stretch": self.largest_stretch,
            "inverted_triangles": self.inverted,
            "intersecting_pairs": self.intersecting,
        }


def stretch_row(t: float, stretches: np.ndarray) -> dict[str, float]:
    """Return the first columns of strains.csv for the principal stretches (m, 2), smaller first.

    "1 %" is a percentile of the smaller stretches, "99 %" one of the larger; the median is the
    median of the larger stretches.
    """
    smaller, larger = np.asarray(stretches).T
    low, high = np.percentile(smaller, 1), np.percentile(larger, 99)
    values = smaller.min(), low, np.median(larger), high, larger.max()
    return {"t": float(t)} | {k: float(v) for k, v in zip(STRETCHES, values, strict=True)}


def shape_message(summary: Mapping) -> str:
    """Return the extremes over all frames in words."""
    pairs = summary["intersecting_pairs"]
    inverted = f"at most {summary['inverted_triangles']} triangles turned over"
    counts = f"{inverted} and {pairs} pairs that intersect, in any frame"
    if pairs is None:
        counts = f"{inverted} in any frame; intersections were not counted"
    return f"stretch {summary['least_stretch']:.4g} to {summary['largest_stretch']:.4g}, {counts}"
