"""Columns that a run has only where they are named: distances, force per width, drape, stress."""

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
from fecloth.quantities.units import LENGTH, quantity
from fecloth.simulation.quantity import STRESS
from fecloth.system.recovered_stress import COMPONENTS, stress_at_point
from fecloth.system.system import System
from fecloth.terms.contact import shapes
from fecloth.terms.traits import parameters_of

ON_REQUEST = re.compile(r"drape_coefficient|folds|distance of .+|line_force[:.].+|stress\..+")
LINES_OF_SHADOW = 1000  # that measure a shadow: its error is below a tenth of a per cent
ANGLES_OF_RIM = 360  # of the rim, for its waves: one for each degree
MOST_FOLDS = 100  # that are looked for: a rim of more is noise of the mesh
LEAST_WAVE = 0.01  # over the mean radius: waves of a smaller amplitude are no folds
NO_TRIANGLES = np.zeros((0, 3), int)
LEAST_COSINE_OF_TILT = 0.999  # of a support that counts as level: 2.6 degrees

# From positions (n, 3) and the row so far to more columns of the row.
Measure = Callable[[np.ndarray, Mapping[str, float]], dict[str, float]]


def on_request(columns: Iterable[str]) -> tuple[str, ...]:
    """Return the columns that have to be named before a run, without repetitions."""
    return tuple(dict.fromkeys(name for name in columns if ON_REQUEST.fullmatch(name)))


def bind_measure(name: str, system: System, probes: Iterable[str]) -> Measure:
    """Return what computes a column on request; `probes` are the names of the probes.

    Raises `InputError` for any other name, and if the cloth has no such quantity.
    """
    if name == "drape_coefficient":
        return _bind_drape(system)
    if name == "folds":
        return _bind_folds(system.cloth)
    if name.startswith("distance of "):
        return _bind_distance(name, list(probes))
    if name.startswith("stress."):
        return _bind_stress(name, system)
    if not ON_REQUEST.fullmatch(name):
        remedy = (
            "By name: distance of A and B, drape_coefficient, folds, line_force.PIN, "
            "stress.xx at (X, Y)."
        )
        allowed = "must be a list of Probe(name, where), or of names of quantities"
        raise InputError(f"probes: {name!r}", allowed, "Observer", remedy)
    pin = re.sub(r"\.[xyz]$", "", name[len("line_force:") :])
    return _bind_line_force(system, pin)


def _bind_distance(name: str, probes: list[str]) -> Measure:
    """Return the measure of the distance between two probes."""
    first, second = _two_probes(name, probes)

    def distance(x: np.ndarray, row: Mapping[str, float]) -> dict[str, float]:
        a = [row[f"{first}.{axis}"] for axis in "xyz"]
        b = [row[f"{second}.{axis}"] for axis in "xyz"]
        return {name: math.dist(a, b)}

    return distance


def _bind_line_force(system: System, pin: str) -> Measure:
    """Return the measure of the force with which a pin holds each metre of its edge."""
    width = grip_width(system, pin)

    def line_force(x: np.ndarray, row: Mapping[str, float]) -> dict[str, float]:
        return {f"line_force:{pin}.{axis}": row[f"reaction:{pin}.{axis}"] / width for axis in "xyz"}

    return line_force


def _bind_stress(name: str, system: System) -> Measure:
    """Return the measure of a component of the recovered stress at a point of the flat cloth."""
    match = STRESS.fullmatch(name)
    if match is None:
        allowed = "must be stress.xx, stress.yy or stress.xy at a point of the flat cloth"
        raise InputError(f"quantity {name!r}", allowed, "", "Write stress.xx at (0.1, 0.2).")
    X, Y = (_length(name, match[axis]) for axis in "XY")
    stress = stress_at_point(system, (X, Y), match["region"])
    component = COMPONENTS.index(match["part"])
    return lambda x, row: {name: float(stress(x)[0, component])}


def _length(name: str, text: str) -> float:
    """Return a coordinate of a point [m]; the text is a number in m, or has a unit."""
    try:
        return float(text)
    except ValueError:
        return quantity(f"a coordinate in {name!r}", text, LENGTH)


def _two_probes(name: str, probes: list[str]) -> tuple[str, str]:
    """Return the probes whose distance has this name, or raise `InputError`."""
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
    _, nodes = groups[pin]
    is_held = np.isin(cloth.triangles, nodes)
    has_edge = is_held.sum(axis=1) == 2
    edges = cloth.triangles[has_edge][is_held[has_edge]].reshape(-1, 2)
    edges = np.unique(np.sort(edges), axis=0)
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
        if isinstance(shape, shapes.Disk):
            axis = np.array(shape.normal, float)
        elif isinstance(shape, shapes.Cylinder):
            axis = np.array(shape.axis, float)
        else:
            continue
        if abs(axis[2]) > LEAST_COSINE_OF_TILT * np.linalg.norm(axis):
            return math.pi * shape.radius**2
    cloth = system.cloth
    is_held = np.isin(cloth.triangles, system.constraints.nodes).all(axis=1)
    return float(cloth.weights[is_held].sum())


def _bind_drape(system: System) -> Measure:
    """Return the measure of a drape: (shadow − support)/(cloth − support).

    A ring may stand for a disc: what its pins hold is then a hole, whose edge and middle are
    triangles of the shadow, of the cloth and of the support.
    """
    cloth = system.cloth
    support = support_area(system)
    holes = [] if support else [nodes for _, nodes in system.constraints.groups.values()]
    triangles_of_holes = _fill_holes(cloth, holes)
    triangles = np.concatenate([Surface.from_cloth(cloth).triangles, triangles_of_holes])

    def shadow(triangles: np.ndarray, x: np.ndarray) -> float:
        points = np.vstack([x, *(x[nodes].mean(axis=0) for nodes in holes)])
        return shadow_area(triangles, points)

    hole = shadow(triangles_of_holes, np.pad(cloth.X, ((0, 0), (0, 1))))
    overhang = cloth.area - support
    if not overhang > 1e-3 * cloth.area:
        what = f"drape_coefficient: the support has {support:g} m² of {cloth.area:g} m²"
        raise InputError(what, "needs cloth beside it", "quantity")

    ring = support + hole
    return lambda x, row: {"drape_coefficient": (shadow(triangles, x) - ring) / overhang}


def _fill_holes(cloth: Cloth, holes: Sequence[np.ndarray]) -> np.ndarray:
    """Return triangles (m, 3) between the edges of holes and a node more in the middle of each.

    `holes` has the nodes around each; the new nodes follow the nodes of the cloth.
    """
    triangles = [NO_TRIANGLES]
    for number, nodes in enumerate(holes):
        edges = cloth.edge_sets["boundary"]
        edges = edges[np.isin(edges, nodes).all(axis=1)]
        middle = np.full((len(edges), 1), len(cloth.X) + number)
        triangles.append(np.hstack([edges, middle]))
    return np.concatenate(triangles)


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
    low = ya.min(initial=np.inf)
    high = yc.max(initial=-np.inf)
    if not high > low:
        return 0.0
    apart = (high - low) / LINES_OF_SHADOW
    t, line = _crossings((ya - low) / apart, (yc - low) / apart)
    y = low + (line + 0.5) * apart
    with np.errstate(divide="ignore", invalid="ignore"):  # of the side that is not taken
        on_long_side = xa[t] + (y - ya[t]) / (yc - ya)[t] * (xc - xa)[t]
        on_lower_side = xa[t] + (y - ya[t]) / (yb - ya)[t] * (xb - xa)[t]
        on_upper_side = xb[t] + (y - yb[t]) / (yc - yb)[t] * (xc - xb)[t]
    on_short_side = np.where(y < yb[t], on_lower_side, on_upper_side)
    width = corners[:, :, 0].max() - corners[:, :, 0].min()
    shift = 2.0 * line * width  # puts the lines one after the other
    left = np.minimum(on_long_side, on_short_side) + shift
    right = np.maximum(on_long_side, on_short_side) + shift
    return float(_covered_length(left, right) * apart)


def _crossings(first: np.ndarray, last: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the triangle and the line of each crossing, line i lying at i + ½.

    `first` and `last` (m,) are the places of the lowest and the highest corner of each triangle,
    in distances of lines.
    """
    first, last = (np.ceil(place - 0.5).astype(int) for place in (first, last))
    count = last - first
    triangle = np.repeat(np.arange(len(count)), count)
    before = np.cumsum(count) - count  # crossings of the triangles before
    line = np.arange(len(triangle)) - np.repeat(before, count) + first[triangle]
    return triangle, line


def _covered_length(left: np.ndarray, right: np.ndarray) -> float:
    """Return the length of the union of intervals from `left` (m,) to `right` (m,)."""
    order = np.argsort(left)
    reached = np.maximum.accumulate(right[order])
    start = np.maximum(left[order], np.append(-np.inf, reached[:-1]))
    return np.maximum(right[order] - start, 0.0).sum()


def _bind_folds(cloth: Cloth) -> Measure:
    """Return the measure of the number of folds, the largest wave of the outer border.

    It is the number, from 2, of the largest amplitude in the Fourier series of the height over
    the angle about the middle of the flat cloth, interpolated at equal angles. It is 0 if the
    rim is flat; a single wave is a tilt.
    """
    from_middle = cloth.X - (cloth.X.max(axis=0) + cloth.X.min(axis=0)) / 2
    radii = np.linalg.norm(from_middle, axis=1)
    nodes = _outer_rim(cloth, int(np.argmax(radii)))
    angles = np.arctan2(from_middle[nodes, 1], from_middle[nodes, 0])
    equal_angles = 2 * np.pi * np.arange(ANGLES_OF_RIM) / ANGLES_OF_RIM
    least = LEAST_WAVE * float(radii[nodes].mean())

    def folds(x: np.ndarray, row: Mapping[str, float]) -> dict[str, float]:
        height = np.interp(equal_angles, angles, x[nodes, 2], period=2 * np.pi)
        waves = np.abs(np.fft.rfft(height))[: MOST_FOLDS + 1] * 2 / ANGLES_OF_RIM
        waves[:2] = 0.0
        if not waves.max() > least:
            return {"folds": 0.0}
        return {"folds": float(np.argmax(waves))}

    return folds


def _outer_rim(cloth: Cloth, node: int) -> np.ndarray:
    """Return the nodes of the border on which this node lies, without the rims of holes."""
    edges = cloth.edge_sets["boundary"]
    number = len(cloth.X)
    graph = sparse.csr_matrix((np.ones(len(edges)), edges.T), shape=(number, number))
    _, loop = connected_components(graph, directed=False)
    return np.flatnonzero(loop == loop[node])
