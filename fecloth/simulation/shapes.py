"""What a run says of the shape of the cloth: stretches, triangles turned over, intersections."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fecloth.integrators.protocol import chooses_method
from fecloth.linalg.reductions import rms
from fecloth.simulation.account import Account, Accounts, End, Run
from fecloth.simulation.dimensionless import mean_edge
from fecloth.simulation.doubts.course import doubt_wrinkles
from fecloth.simulation.doubts.doubt import Doubt, DoubtKind
from fecloth.simulation.time_error import TimeError
from fecloth.system.space_error import roughness
from fecloth.system.state import State
from fecloth.system.system import System
from fecloth.terms.bending.hinge import hinge_angles
from fecloth.terms.kinematics import extreme_stretches
from fecloth.terms.records import remembered

LEAST_COMPRESSION = 0.2  # over the mean tension; a triangle with more counts as compressed
STRETCHES = ("smallest", "1 %", "median", "99 %", "largest")
NO_COMPRESSION = 1e-6  # over the fabric's stiffness; less compression is round-off


@dataclass(frozen=True)
class Shape:
    """The shape of a cloth at one time.

    Attributes
    ----------
    least_stretch, largest_stretch
        Principal stretches of all triangles [-].
    inverted
        Number of triangles that are turned over against all their neighbours.
    intersecting
        Pairs of triangles that pass through each other; None if they were not counted.
    """

    least_stretch: float
    largest_stretch: float
    inverted: int
    intersecting: int | None

    @classmethod
    def of(cls, run: Run, state: State, intersecting: int | None) -> "Shape":
        """Return the shape of a cloth at a state, whose intersections were counted before."""
        stretches = extreme_stretches(run.system.cloth, state.x)
        return cls(*stretches, run.surface.count_inverted(state.x), intersecting)


@remembered
@dataclass(frozen=True)
class Shapes(Account):
    """The shape of the cloth at the frames so far; of a run without frames, at its end.

    Attributes
    ----------
    least_stretch, largest_stretch, inverted
        Over all frames: principal stretches [-], and the number of triangles turned over.
    intersecting
        Over all frames: pairs of triangles that intersect; None if they were never counted.
    step
        Number of the step of the last frame.
    pairs, intersection
        At the last frame: pairs of triangles that intersect, None if they were not counted, and
        the doubt about them.
    wrinkles
        The doubt about wrinkles at the end.
    counted
        Number of the step at which the pairs were counted last.
    at_end
        The shape at the end.
    """

    name = "shape"
    least_stretch: float = math.inf
    largest_stretch: float = -math.inf
    inverted: int = 0
    intersecting: int | None = None
    step: int | None = None
    pairs: int | None = None
    intersection: Doubt | None = None
    wrinkles: Doubt | None = None
    counted: float = -math.inf
    at_end: Shape | None = None

    def at_frame(
        self, run: Run, state: State, cells: Mapping[str, np.ndarray], step: int, counts: bool
    ) -> "tuple[Shapes, dict[str, float]]":
        """Return the record after a frame with this cell data, and its row of strains.csv.

        The pairs of triangles that intersect are counted if `counts`; otherwise the row has NaN.
        """
        row = stretch_row(state.t, cells["principal_stretches"])
        inverted = run.surface.count_inverted(state.x)
        pairs = None
        counted = self.counted
        if counts:
            pairs = run.surface.count_intersections(state.x)
            counted = step
        intersecting = self.intersecting
        if pairs is not None:
            intersecting = max(intersecting or 0, pairs)
        after = self.changed(
            least_stretch=min(self.least_stretch, row["smallest"]),
            largest_stretch=max(self.largest_stretch, row["largest"]),
            inverted=max(self.inverted, inverted),
            intersecting=intersecting,
            step=step,
            pairs=pairs,
            intersection=doubt_intersections(run, state.t, pairs),
            counted=counted,
        )
        row["compressed"] = compressed_share(run.system, cells)
        row["inverted"] = inverted
        row["intersecting"] = math.nan if pairs is None else pairs
        return after, row

    def finish(self, run: Run, end: End, others: Accounts) -> "Shapes":
        """Return the record at the end; of a run without frames, with the figures of its end."""
        moved = rms(run.system.diagonal_mass, end.state.x - run.start.x)
        estimate = others.get(TimeError)
        if estimate:
            moved = max(moved, estimate.moved)
        wrinkles = find_wrinkles(run.system, end.state, moved)
        if self.step is not None:
            shape = Shape.of(run, end.state, self.pairs)
            return self.changed(wrinkles=wrinkles, at_end=shape)
        pairs = run.surface.count_intersections(end.state.x)
        shape = Shape.of(run, end.state, pairs)
        return Shapes(
            least_stretch=shape.least_stretch,
            largest_stretch=shape.largest_stretch,
            inverted=shape.inverted,
            intersecting=pairs,
            intersection=doubt_intersections(run, end.state.t, pairs, "at"),
            wrinkles=wrinkles,
            at_end=shape,
        )

    def doubts(self) -> list[Doubt]:
        """Return what the last frame shows; the start counts where no step follows."""
        if not (self.step or self.at_end):
            return []
        return [doubt for doubt in (self.intersection, self.wrinkles) if doubt]

    def summary(self) -> dict[str, object]:
        return {
            "least_stretch": self.least_stretch,
            "largest_stretch": self.largest_stretch,
            "inverted_triangles": self.inverted,
            "intersecting_pairs": self.intersecting,
        }


def find_wrinkles(system: System, state: State, moved: float) -> Doubt | None:
    """Return a doubt about wrinkles at a state that has `moved` so far [m, rms], or None.

    There is none without membrane stresses. See `doubt_wrinkles`.
    """
    cells = stress_cells(system, state.x)
    angles = hinge_angles(system.cloth, state.x)
    rough = roughness(system.cloth, angles)
    angle = 0.0
    if len(angles):
        angle = rough * float(np.sqrt((angles**2).mean()))
    height = 0.0
    if moved:
        height = 0.5 * mean_edge(system) * angle / moved
    return doubt_wrinkles(system, compressed_share(system, cells), rough, angle, height)


def stress_cells(system: System, x: np.ndarray) -> dict[str, np.ndarray]:
    """Return the membrane stresses S11, S22, S12 (m,) [N/m] by name; none without a membrane."""
    membranes = [term for term in system.bound if term.has_stress]
    if not membranes:
        return {}
    stress = np.zeros((len(system.cloth.triangles), 4))
    for term in membranes:
        term.add_stress(x, stress)
    S11, S22, S12, _ = stress.T
    return {"S11": S11, "S22": S22, "S12": S12}


def doubt_intersections(
    run: Run, t: float, pairs: float | None, since: str = "from"
) -> Doubt | None:
    """Return a doubt if pairs of triangles intersect at t [s]."""
    if not pairs or math.isnan(pairs):
        return None
    words = (
        f"the cloth passes through itself {since} t = {t:g} s ({pairs:.0f} pairs of triangles "
        "intersect); without SelfContact no layer rests on another"
    )
    takes_contact = run.method.traits.has_difference or chooses_method(run.method)
    method = "" if takes_contact else " and take BDF2"
    remedy = (
        f"trust the motion up to there, add that term{method}, or place the cloth so that its "
        "layers do not meet"
    )
    return Doubt(DoubtKind.INTERSECTION, words, remedy)


def compressed_share(system: System, cells: Mapping[str, np.ndarray]) -> float:
    """Return the part of the reference area that is compressed, 0 without a membrane.

    A triangle is compressed if its smaller principal stress is below −0.2 times the root mean
    square of the larger ones, by more than round-off. `cells` is the cell data of a frame.
    """
    if "S11" not in cells:
        return 0.0
    S11 = cells["S11"]
    S22 = cells["S22"]
    S12 = cells["S12"]
    area = system.cloth.weights.sum(axis=1)
    mean = (S11 + S22) / 2
    radius = np.hypot((S11 - S22) / 2, S12)
    tension = math.sqrt(float(area @ (mean + radius) ** 2) / area.sum())
    stiffness = min(min(fabric.tensile) for fabric in system.panel.fabrics)
    compressed = mean - radius < -(LEAST_COMPRESSION * tension + NO_COMPRESSION * stiffness)
    return float(area @ compressed) / float(area.sum())


def stretch_row(t: float, stretches: np.ndarray) -> dict[str, float]:
    """Return the first columns of strains.csv for the principal stretches (m, 2), smaller first.

    "1 %" is a percentile of the smaller stretches, "99 %" one of the larger; the median is the
    median of the larger stretches.
    """
    smaller, larger = np.asarray(stretches).T
    low = np.percentile(smaller, 1)
    high = np.percentile(larger, 99)
    values = [smaller.min(), low, np.median(larger), high, larger.max()]
    columns = zip(STRETCHES, values, strict=True)
    return {"t": float(t)} | {column: float(value) for column, value in columns}
