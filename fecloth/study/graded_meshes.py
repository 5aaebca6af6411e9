"""Gradings that spread the error in space evenly, found on the first level of a study."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product

import numpy as np

from fecloth.errors import InputError
from fecloth.mesh.grading import Grading
from fecloth.simulation.setup import Setup
from fecloth.study.problem import border_of, has_bending, is_round
from fecloth.system.space_error import space_error
from fecloth.system.state import State

POWERS = (0.3, 0.45, 0.6, 0.7, 0.8)
SHARES = (0.5, 0.25, 0.12, 0.06)  # of the cloth's size: the distances that are tried
LEAST_SAVED = 0.05  # share of the triangles below which a grading is not worth its table
MOST = 8  # gradings
TURN = np.sin(np.radians(30.0))  # of the border, above which a node is a corner


@dataclass(frozen=True, eq=False)
class _Place:
    """A place to grade towards: `where` or `point` of a `Grading`, and each triangle's distance."""

    named: dict[str, object]
    r: np.ndarray


@dataclass(frozen=True, eq=False)
class _Prediction:
    """Error and triangles of meshes with other sizes, from the error of one mesh."""

    energy: np.ndarray  # (m,) of the error of each triangle [J]
    area: np.ndarray
    size: np.ndarray  # edge length of each triangle [m]
    h: float
    order: float  # of stress in h

    def triangles(self, chosen: Mapping[_Place, Grading]) -> float:
        """Return the relative number of triangles for an error, with the sizes c h s for any c."""
        factors = [shift.factors(place.r, self.h) for place, shift in chosen.items()]
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
    triangles have the same error. Greedily the place, the distance and the power of `Grading`
    are added that reduce it most: first corners of the border and the ends of pins on it, then
    pinned curves. A node that is pinned alone is no such place: a membrane has no finite
    stiffness there, and with smaller triangles it only gives way further.

    `state` is the end of the run of `setup`, on a mesh of edge length h [m] without gradings.
    If all gradings together save less than the share `least_saved` of the triangles, there are
    none.
    """
    error = space_error(setup.system, state)
    cloth = setup.cloth
    if error.reason:
        what = "grade = True"
        remedy = "Leave grade out, or take other terms."
        raise InputError(what, f"needs the error in space: {error.reason}", "converge", remedy)
    area = cloth.weights.sum(axis=1)
    order = 2.0 if cloth.element == "P2" and not has_bending(setup) else 1.0
    sizes = np.sqrt(area * 4 / np.sqrt(3))
    predicted = _Prediction(error.density * area, area, sizes, h, order)
    distances = [share * cloth.extent for share in SHARES if share * cloth.extent > 2 * h]
    points, curves = _places(setup)
    chosen: dict[_Place, Grading] = {}
    for places in (points, curves):
        chosen = _add_greedily(chosen, list(product(places, distances, POWERS)), predicted)
    if predicted.triangles(chosen) > (1 - least_saved) * predicted.triangles({}):
        return ()
    return tuple(chosen.values())


def _add_greedily(
    chosen: dict[_Place, Grading], settings: list[tuple], predicted: _Prediction
) -> dict[_Place, Grading]:
    """Return the gradings with the most saving ones added, or put in place of the place's own."""
    least = predicted.triangles(chosen)
    while settings and len(chosen) < MOST:
        tried = [
            chosen | {place: Grading(**place.named, distance=distance, power=power)}
            for place, distance, power in settings
        ]
        fewest = min(tried, key=predicted.triangles)
        if predicted.triangles(fewest) > (1 - LEAST_SAVED) * least:
            break
        chosen = fewest
        least = predicted.triangles(fewest)
    return chosen


def _places(setup: Setup) -> tuple[list[_Place], list[_Place]]:
    """Return corners of the border and ends of pins on it, and curves that are pinned whole."""
    cloth = setup.cloth
    middle = cloth.X[cloth.triangles].mean(axis=1)
    edges, turning = border_of(cloth)
    corners = (turning > TURN) & (not is_round(cloth))
    nodes = np.flatnonzero(corners | _ends_of_pins(setup, edges))
    points = cloth.X[np.setdiff1d(nodes, alone(setup))]
    singular = [
        _Place({"point": tuple(map(float, X))}, np.linalg.norm(middle - X, axis=1)) for X in points
    ]
    curves = []
    for pin, _ in setup.system.constraints.groups.values():
        if isinstance(pin.where, str) and pin.where in cloth.edge_sets:
            ends = cloth.X[cloth.edge_sets[pin.where]]
            curves.append(_Place({"where": pin.where}, _distance(middle, ends)))
    return singular, curves


def alone(setup: Setup) -> np.ndarray:
    """Return the pinned nodes none of whose neighbours is pinned."""
    cloth = setup.cloth
    pinned = setup.system.constraints.nodes
    ends = np.concatenate([cloth.parts[:, [i, (i + 1) % 3]] for i in range(3)])
    both = ends[np.isin(ends, pinned).all(axis=1)]
    return np.setdiff1d(pinned, both)


def _ends_of_pins(setup: Setup, border: np.ndarray) -> np.ndarray:
    """(n,) whether one of the two edges of the border at a node is pinned, and the other is not."""
    held = np.isin(border, setup.system.constraints.nodes).all(axis=1)
    pinned = np.bincount(border[held].ravel(), minlength=len(setup.cloth.X))
    return pinned == 1


def _distance(points: np.ndarray, segments: np.ndarray) -> np.ndarray:
    """(p,) the distance of points (p, 2) to the nearest of the segments (k, 2, 2) [m]."""
    start = segments[:, 0]
    along = np.diff(segments, axis=1)[:, 0]
    away = points[:, None] - start
    part = np.clip((away * along).sum(axis=2) / (along**2).sum(axis=1), 0, 1)
    return np.linalg.norm(away - part[..., None] * along, axis=2).min(axis=1)
