"""Gradings that spread the error in space evenly, found on the first level of a study."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product

import numpy as np

from fecloth.errors import InputError
from fecloth.mesh.grading import Grading
from fecloth.simulation.setup import Setup
from fecloth.study.orders import border_of, has_bending, is_round
from fecloth.system.space_error import space_error
from fecloth.system.state import State

# The settings of `Grading` that are tried: powers, and distances over the extent of the cloth.
# Chosen by hand, from weak to strong; each distance is about half of the one before.
TRIED_POWERS = (0.3, 0.45, 0.6, 0.7, 0.8)
TRIED_DISTANCES = (0.5, 0.25, 0.12, 0.06)
# The share of the triangles that a grading saves: below it the saving is not worth a table more.
LEAST_SAVED = 0.05
# The sine of the angle by which the border turns at a node: above it the node is a corner.
LEAST_CORNER = np.sin(np.radians(30.0))


@dataclass(frozen=True, eq=False)
class _Place:
    """A place towards which a mesh may be graded.

    Attributes
    ----------
    arguments
        `where` or `point` of its `Grading`.
    distances
        (m,) distance of each triangle from the place [m].
    """

    arguments: dict[str, object]
    distances: np.ndarray


@dataclass(frozen=True, eq=False)
class _Prediction:
    """Predicts how many triangles graded meshes need, from the error of one mesh.

    Attributes
    ----------
    energy
        (m,) energy of the error of each triangle [J].
    area
        (m,) area of each triangle [m²].
    size
        (m,) edge length of each triangle [m].
    h
        Edge length of the mesh without gradings [m].
    order
        Order of stress in h.
    """

    energy: np.ndarray
    area: np.ndarray
    size: np.ndarray
    h: float
    order: float

    def count_triangles(self, gradings: Mapping[_Place, Grading]) -> float:
        """Return N E^(1/p), in proportion to the number of triangles that have the same error.

        Only ratios of it mean something, see `choose_gradings`.
        """
        pairs = gradings.items()
        factors = [grading.factors(place.distances, self.h) for place, grading in pairs]
        s = np.min([np.ones(len(self.area)), *factors], axis=0)
        energy = np.sum(self.energy * (self.h * s / self.size) ** (2 * self.order))
        return float(np.sum(self.area / s**2) * energy ** (1 / self.order))


def choose_gradings(
    setup: Setup, state: State, h: float, least_saved: float = LEAST_SAVED
) -> tuple[Grading, ...]:
    """Return the gradings of a cloth with which the fewest triangles have the same error.

    The energy of the error of a triangle, e_t of `space_error`, goes like its size to the
    power 2p; p is the order of stress. With sizes c h s, N ∝ c⁻² Σ A_t/s_t² triangles have the
    error E ∝ c^2p Σ e_t s_t^2p. So N E^(1/p) does not depend on c; it is least where all
    triangles have the same error.

    The search is greedy: it adds the place, the distance and the power of `Grading` that reduce
    N E^(1/p) most. The places are first corners of the border and the ends of pins on it, then
    pinned curves. A node that is pinned alone is no such place: a membrane has no finite
    stiffness there, and with smaller triangles it only gives way further.

    Return an empty tuple if all gradings together save too little. Raise `InputError` for terms
    without an estimate of the error in space.

    Parameters
    ----------
    setup, state
        A run on a mesh without gradings, and its end.
    h
        Edge length of this mesh [m].
    least_saved
        Share of the triangles: if all gradings together save less, none is returned.
    """
    error = space_error(setup.system, state)
    cloth = setup.cloth
    if error.reason:
        what = "grade = True"
        remedy = "Leave grade out, or take other terms."
        raise InputError(what, f"needs the error in space: {error.reason}", "converge", remedy)
    area = cloth.weights.sum(axis=1)
    order = 1.0  # of stress; with bending also on P2
    if cloth.element == "P2" and not has_bending(setup):
        order = 2.0
    prediction = _Prediction(
        energy=error.density * area,
        area=area,
        size=np.sqrt(area * 4 / np.sqrt(3)),  # of equilateral triangles
        h=h,
        order=order,
    )
    distances = [share * cloth.extent for share in TRIED_DISTANCES]
    distances = [distance for distance in distances if distance > 2 * h]  # more than two edges
    points, curves = _find_places(setup)
    gradings: dict[_Place, Grading] = {}
    for places in (points, curves):
        settings = list(product(places, distances, TRIED_POWERS))
        gradings = _add_greedily(gradings, settings, prediction)
    ungraded = prediction.count_triangles({})
    if prediction.count_triangles(gradings) > (1 - least_saved) * ungraded:
        return ()
    return tuple(gradings.values())


def _add_greedily(
    gradings: dict[_Place, Grading], settings: list[tuple], prediction: _Prediction
) -> dict[_Place, Grading]:
    """Return the gradings with further ones, each the one that saves most triangles then.

    A place has one grading at most: a further one for the same place replaces it. The search
    ends when the best further grading saves less than `LEAST_SAVED` of the triangles.

    Parameters
    ----------
    gradings
        The gradings so far, by their places.
    settings
        Tuples of place, distance [m] and power to choose from.
    """
    least_triangles = prediction.count_triangles(gradings)
    while settings:
        candidates = [
            gradings | {place: Grading(**place.arguments, distance=distance, power=power)}
            for place, distance, power in settings
        ]
        best_gradings = min(candidates, key=prediction.count_triangles)
        if prediction.count_triangles(best_gradings) > (1 - LEAST_SAVED) * least_triangles:
            break
        gradings = best_gradings
        least_triangles = prediction.count_triangles(best_gradings)
    return gradings


def _find_places(setup: Setup) -> tuple[list[_Place], list[_Place]]:
    """Return two lists of places: points, and curves.

    The points are corners of the border and ends of pins on it, but no node that is pinned
    alone. The curves are edge sets that are pinned as a whole.
    """
    cloth = setup.cloth
    centres = cloth.X[cloth.triangles].mean(axis=1)
    edges, turning = border_of(cloth)
    is_corner = (turning > LEAST_CORNER) & (not is_round(cloth))
    nodes = np.flatnonzero(is_corner | _find_ends_of_pins(setup, edges))
    points = []
    for X in cloth.X[np.setdiff1d(nodes, find_lone_pins(setup))]:
        distances = np.linalg.norm(centres - X, axis=1)
        points.append(_Place({"point": (float(X[0]), float(X[1]))}, distances))
    curves = []
    for pin, _ in setup.system.constraints.groups.values():
        if isinstance(pin.where, str) and pin.where in cloth.edge_sets:
            segments = cloth.X[cloth.edge_sets[pin.where]]
            curves.append(_Place({"where": pin.where}, _distance(centres, segments)))
    return points, curves


def find_lone_pins(setup: Setup) -> np.ndarray:
    """Return the pinned nodes none of whose neighbours is pinned."""
    cloth = setup.cloth
    pinned = setup.system.constraints.nodes
    edges = np.concatenate([cloth.parts[:, [i, (i + 1) % 3]] for i in range(3)])
    pinned_edges = edges[np.isin(edges, pinned).all(axis=1)]
    return np.setdiff1d(pinned, pinned_edges)


def _find_ends_of_pins(setup: Setup, border: np.ndarray) -> np.ndarray:
    """Return (n,) whether just one of the two edges of the border at a node is pinned.

    `border` are the edges (b, 2) of the border.
    """
    is_pinned = np.isin(border, setup.system.constraints.nodes).all(axis=1)
    pinned_edges = np.bincount(border[is_pinned].ravel(), minlength=len(setup.cloth.X))
    return pinned_edges == 1


def _distance(points: np.ndarray, segments: np.ndarray) -> np.ndarray:
    """Return (p,) the distance of points (p, 2) to the nearest of the segments (k, 2, 2) [m]."""
    start = segments[:, 0]
    direction = np.diff(segments, axis=1)[:, 0]
    from_start = points[:, None] - start
    part = np.clip((from_start * direction).sum(axis=2) / (direction**2).sum(axis=1), 0, 1)
    return np.linalg.norm(from_start - part[..., None] * direction, axis=2).min(axis=1)
