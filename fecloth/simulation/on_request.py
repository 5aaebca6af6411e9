"""Columns that a run has only where they are named: distances, force per width, drape, folds."""

import itertools
import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from fecloth.errors import InputError, did_you_mean
from fecloth.mesh.cloth import Cloth
from fecloth.mesh.surface import Surface
from fecloth.system.system import System
from fecloth.terms.contact import shapes
from fecloth.terms.traits import parameters_of

ON_REQUEST = re.compile(r"drape_coefficient|folds|distance of .+|line_force[:.].+")
LINES_OF_SHADOW = 1000  # that measure a shadow: its error is below a tenth of a per cent
ANGLES_OF_RIM = 360  # of the rim, for its waves: one for each degree
MOST_FOLDS = 100  # that are looked for: a rim of more is noise of the mesh
LEAST_WAVE = 0.01  # over the mean radius: waves of a smaller amplitude are no folds
NO_TRIANGLES = np.zeros((0, 3), int)
LEAST_COSINE_OF_TILT = 0.999  # of a support that counts as level: 2.6 degrees

# From positions (n, 3) and the row so far to more columns of the row.
Measure = Callable[[np.ndarray, Mapping[str, float]], dict[str, float]]


def on_request(columns: Iterable[str]) -> tuple[str, ...]:
    """Return those of the columns that have to be named before a run, each one once."""
    return tuple(dict.fromkeys(name for name in columns if ON_REQUEST.fullmatch(name)))


def bind_measure(name: str, system: System, probes: Iterable[str]) -> Measure:
    """Return what computes a column; `InputError` if the cloth has no such quantity."""
    if name in ("drape_coefficient", "folds"):
        if name == "drape_coefficient":
            return _bind_drape(system)
        return _bind_folds(system.cloth)
    if name.startswith("distance of "):
        pair = _two_probes(name, list(probes))
        return lambda x, row: {name: math.dist(*([row[f"{p}.{c}"] for c in "xyz"] for p in pair))}
    if not ON_REQUEST.fullmatch(name):
        remedy = "By name: distance of A and B, drape_coefficient, folds, line_force.PIN."
        allowed = "must be a list of Probe(name, where), or of names of quantities"
        raise InputError(f"probes: {name!r}", allowed, "Observer", remedy)
    pin = re.sub(r"\.[xyz]$", "", name[len("line_force:") :])
    width = grip_width(system, pin)
    return lambda x, row: {
        f"line_force:{pin}.{c}": row[f"reaction:{pin}.{c}"] / width for c in "xyz"
    }


def _two_probes(name: str, probes: list[str]) -> tuple[str, str]:
    for first, second in itertools.product(probes, probes):
        if name == f"distance of {first} and {second}":
            return first, second
    allowed = f"must be distance of A and B, of the probes {', '.join(probes) or '(none)'}"
    raise InputError(f"quantity {name!r}", allowed, "", "Add [[probes]].")


def grip_width(system: System, pin: str) -> float:
    """Return the length, in the flat cloth, of the line where held and free cloth meet [m].

    It is the sum of the edges between two nodes of the pin that belong to a triangle with a free
    node: of a held edge its length, of a held strip the length of its inner edge. `InputError`
    for a pin that does not exist, or holds no edge.
    """
    groups = system.constraints.groups
    if pin not in groups:
        allowed = f"must be the force of one of the pins {', '.join(groups) or '(none)'}"
        raise InputError(f"quantity 'line_force.{pin}'", allowed, "", did_you_mean(pin, groups))
    cloth = system.cloth
    held = np.isin(cloth.triangles, groups[pin][1])
    two = held.sum(axis=1) == 2
    edges = np.unique(np.sort(cloth.triangles[two][held[two]].reshape(-1, 2)), axis=0)
    width = float(np.linalg.norm(np.diff(cloth.X[edges], axis=1), axis=2).sum())
    if not width:
        what = f"quantity 'line_force.{pin}': the pin holds no edge beside free cloth"
        raise InputError(what, "needs a width", "", f"Take reaction.{pin}.")
    return width


def support_area(system: System) -> float:
    """Return the area of what a drape lies on, as far as the cloth covers it [m²].

    The top of an obstacle that is a round plate (`shapes.Disk`) or an upright `shapes.Cylinder`,
    π R²; without such an obstacle the flat area of the triangles all of whose nodes pins hold.
    """
    for term in system.terms:
        shape = parameters_of(term).get("shape")
        if isinstance(shape, shapes.Disk | shapes.Cylinder):
            axis = np.array(shape.normal if isinstance(shape, shapes.Disk) else shape.axis, float)
            if abs(axis[2]) > LEAST_COSINE_OF_TILT * np.linalg.norm(axis):
                return math.pi * shape.radius**2
    cloth = system.cloth
    held = np.isin(cloth.triangles, system.constraints.nodes).all(axis=1)
    return float(cloth.weights[held].sum())


def _bind_drape(system: System) -> Measure:
    """Return the measure of a drape: (shadow − support)/(cloth − support).

    A ring may stand for a disc: what its pins hold is then a hole, whose edge and middle are
    triangles of the shadow, of the cloth and of the support.
    """
    cloth = system.cloth
    support = support_area(system)
    triangles = [Surface.from_cloth(cloth).triangles]
    middles = list[np.ndarray]()
    for _, nodes in () if support else system.constraints.groups.values():
        edges = cloth.edge_sets["boundary"]
        edges = edges[np.isin(edges, nodes).all(axis=1)]
        tip = np.full((len(edges), 1), len(cloth.X) + len(middles))
        triangles.append(np.hstack([edges, tip]))
        middles.append(nodes)

    def shadow(triangles: Sequence[np.ndarray], x: np.ndarray) -> float:
        points = np.vstack([x, *(x[nodes].mean(axis=0) for nodes in middles)])
        return shadow_area(np.concatenate([NO_TRIANGLES, *triangles]), points)

    hole = shadow(triangles[1:], np.pad(cloth.X, ((0, 0), (0, 1))))
    overhang = cloth.area - support
    if not overhang > 1e-3 * cloth.area:
        what = f"drape_coefficient: the support has {support:g} m² of {cloth.area:g} m²"
        raise InputError(what, "needs cloth beside it", "quantity")

    ring = support + hole
    return lambda x, row: {"drape_coefficient": (shadow(triangles, x) - ring) / overhang}


def shadow_area(triangles: np.ndarray, x: np.ndarray) -> float:
    """Return the area [m²] of the union of the triangles (m, 3), seen from above.

    Lines y = constant, at equal distances, cross the shadow. On each line the intervals of the
    triangles are exact, and parts that several triangles cover count once. Between the lines
    it is the midpoint rule: the error is of order 2 in their distance, and below a thousandth
    of the area also where edges are parallel to the lines.
    """
    corners = x[triangles, :2]
    order = np.argsort(corners[:, :, 1], axis=1)[:, :, None]
    (xa, ya), (xb, yb), (xc, yc) = np.take_along_axis(corners, order, 1).transpose(1, 2, 0)
    if not yc.max(initial=-np.inf) > (low := ya.min(initial=np.inf)):
        return 0.0
    apart = (yc.max() - low) / LINES_OF_SHADOW
    first, last = (np.ceil((y - low) / apart - 0.5).astype(int) for y in (ya, yc))
    count = last - first
    t = np.repeat(np.arange(len(count)), count)
    line = np.arange(len(t)) - np.repeat(np.cumsum(count) - count, count) + first[t]
    y = low + (line + 0.5) * apart
    with np.errstate(divide="ignore", invalid="ignore"):  # of the side that is not taken
        long = xa[t] + (y - ya[t]) / (yc - ya)[t] * (xc - xa)[t]
        lower = xa[t] + (y - ya[t]) / (yb - ya)[t] * (xb - xa)[t]
        upper = xb[t] + (y - yb[t]) / (yc - yb)[t] * (xc - xb)[t]
    short = np.where(y < yb[t], lower, upper)
    shift = 2.0 * line * (corners[:, :, 0].max() - corners[:, :, 0].min())  # a line after the other
    left = np.minimum(long, short) + shift
    right = np.maximum(long, short) + shift
    by = np.argsort(left)
    reached = np.maximum.accumulate(right[by])
    start = np.maximum(left[by], np.append(-np.inf, reached[:-1]))
    return float(np.maximum(right[by] - start, 0.0).sum() * apart)


def _bind_folds(cloth: Cloth) -> Measure:
    """Return the measure of the waves of the outer border: the number, from 2, of the largest one.

    It is the largest amplitude of the Fourier series of the height over the angle about the
    middle of the flat cloth, interpolated at equal angles. 0 if the rim is flat; a single wave
    is a tilt.
    """
    edges = cloth.edge_sets["boundary"]
    n = len(cloth.X)
    graph = sparse.csr_matrix((np.ones(len(edges)), edges.T), shape=(n, n))
    loop = connected_components(graph, directed=False)[1]
    from_middle = cloth.X - (cloth.X.max(axis=0) + cloth.X.min(axis=0)) / 2
    radii = np.linalg.norm(from_middle, axis=1)
    nodes = np.flatnonzero(loop == loop[np.argmax(radii)])  # without the rims of holes
    angles = np.arctan2(*from_middle[nodes].T[::-1])
    equal = 2 * np.pi * np.arange(ANGLES_OF_RIM) / ANGLES_OF_RIM
    least = LEAST_WAVE * float(radii[nodes].mean())

    def folds(x: np.ndarray, row: Mapping[str, float]) -> dict[str, float]:
        height = np.interp(equal, angles, x[nodes, 2], period=2 * np.pi)
        waves = np.abs(np.fft.rfft(height))[: MOST_FOLDS + 1] * 2 / ANGLES_OF_RIM
        waves[:2] = 0.0
        return {"folds": float(np.argmax(waves)) if waves.max() > least else 0.0}

    return folds
