"""Local edge lengths: smaller triangles towards points and sets, as size fields of Gmsh."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any

import numpy as np

from fecloth import validation
from fecloth.errors import InputError, MeshError, did_you_mean, is_number
from fecloth.mesh.gmsh_session import set_options
from fecloth.quantities.arguments import checks_arguments
from fecloth.quantities.units import LENGTH

LEAST_FACTOR_AT_SET = 1e-3  # of h: along a curve smaller edges make too many triangles
LEAST_FACTOR_AT_POINT = 1e-5  # of h: smaller edges change no result
LARGEST_POWER = 0.9  # near 1 the smallest edges, h (h/d)^(power/(1 − power)), go to zero
MOST_SAMPLES = 100_000  # points on a curve from which Gmsh measures distances, for its memory


@checks_arguments
@dataclass(frozen=True)
class Grading:
    """Smaller triangles towards a place: at the distance r from it the edge length is h s(r).

        s(r) = min(1, max(r/d, r₁/d)^power),    r₁ = d (h/d)^(1 / (1 − power))

    r₁ is about the edge length at the place; s is at least 10⁻³ at a set and 10⁻⁵ at a point.
    So a smaller h alone refines the whole family of meshes. Where the solution behaves like
    r^λ, as at a corner, uniform meshes of elements with the order p of stress have only the
    order min(λ, p). With power > 1 − λ/p the order is p, and the number of triangles still
    grows like 1/h².

    Source: Babuška, Kellogg and Pitkäranta (1979), Direct and inverse error estimates for finite
    elements with mesh refinements, Numer. Math. 33, 447–471.

    Raises `InputError` if both or neither of `where` and `point` are given, and for a distance
    or power out of range.

    Parameters
    ----------
    where
        A set of points or curves that the shape has before it is meshed, such as "corners" or
        "left" of a rectangle, "boundary", or a physical group of a .geo file.
    point
        In place of `where`: a material point (X, Y) [m].
    distance
        d, beyond which the edge length is h [m].
    power
        How fast the edges become shorter: above 0, at most 0.9.

    Examples
    --------
    >>> corner = Grading(point=(0.0, 0.0), distance="40 cm", power=0.5)
    >>> corner.factors(np.array([0.0, 0.1, 0.5]), h=0.1).tolist()
    [0.25, 0.5, 1.0]
    """

    where: str | None = None
    point: Annotated[tuple[float, float] | None, LENGTH] = None
    distance: Annotated[float, LENGTH] = field(kw_only=True)
    power: float = field(default=0.5, kw_only=True)

    def __post_init__(self):
        """Raise `InputError` for arguments that the class does not allow."""
        if (self.where is None) == (self.point is None):
            raise InputError("a grading", "needs either `where` or `point`", "Grading")
        if self.where is not None and not isinstance(self.where, str):
            raise InputError(f"where = {self.where!r}", "must be the name of a set", "Grading")
        if self.point is not None:
            _check_point(self.point)
        validation.length("distance", self.distance, "Grading")
        if not (is_number(self.power) and 0 < self.power <= LARGEST_POWER):
            allowed = f"must be above 0 and at most {LARGEST_POWER}"
            raise InputError(f"power = {self.power!r}", allowed, "Grading")

    def smallest(self, h: float) -> float:
        """Return the edge length at the place, relative to h."""
        least = LEAST_FACTOR_AT_SET if self.point is None else LEAST_FACTOR_AT_POINT
        return max(min(1.0, h / self.distance) ** (self.power / (1 - self.power)), least)

    def factors(self, r: np.ndarray, h: float) -> np.ndarray:
        """Return s, the edge length over h, at distances r [m]."""
        return np.minimum(1, np.maximum((r / self.distance) ** self.power, self.smallest(h)))


def _check_point(point: Any) -> None:
    is_pair = isinstance(point, list | tuple) and len(point) == 2
    if not (is_pair and all(map(is_number, point))):
        allowed = "must be (X, Y), two finite numbers"
        raise InputError(f"point = {point!r}", allowed, "Grading")


def check_gradings(gradings: Sequence[Grading], where: str) -> None:
    """Raise `InputError` for anything but a list or tuple of `Grading`."""
    example = 'Grading("corners", distance=0.1)'
    validation.instance("grading", gradings, (list, tuple), f"a list of {example}", where)
    for grading in gradings:
        validation.instance("grading", grading, Grading, example, where)


def set_sizes(gmsh, gradings: Sequence[Grading], h: float, where: str) -> None:
    """Let Gmsh take the smallest of h [m] and the edge lengths of all gradings, and no others.

    Raises `MeshError` if the file has size fields of its own, and `InputError` if it has no set
    that a grading names.
    """
    fields = gmsh.model.mesh.field
    if len(fields.list()):
        raise MeshError("grading", "is for files without size fields of their own", where)
    # Gmsh takes sizes from one field, the background mesh.
    all_sizes = [_size_field(gmsh, grading, h, where) for grading in gradings]
    least = fields.add("Min")
    fields.setNumbers(least, "FieldsList", all_sizes)
    fields.setAsBackgroundMesh(least)
    other_sizes = ("Mesh.MeshSizeFromPoints", "Mesh.MeshSizeExtendFromBoundary")
    set_options(gmsh, dict.fromkeys(other_sizes, 0) | {"Mesh.MeshSizeMax": h})


def _size_field(gmsh, grading: Grading, h: float, where: str) -> int:
    """Add the field of the edge length [m] of `Grading`, and return its tag.

    Beyond the distance d it grows above h; `set_sizes` limits it.
    """
    fields = gmsh.model.mesh.field
    if grading.point is not None:
        x, y = (f"({float(c)!r})" for c in grading.point)
        r = f"Sqrt((x - {x})^2 + (y - {y})^2)"
    else:
        r = f"F{_distance_field(gmsh, grading, h, where)}"
    tag = fields.add("MathEval")
    growth = f"({r} / {float(grading.distance)!r})^{float(grading.power)!r}"
    fields.setString(tag, "F", f"{float(h)!r} * max({growth}, {grading.smallest(h)!r})")
    return int(tag)


def _distance_field(gmsh, grading: Grading, h: float, where: str) -> int:
    """Add the field of the distance to the set of a grading; return its tag.

    Raises `InputError` if there is no such set.
    """
    points, curves = _entities(gmsh, grading.where, where)
    box = gmsh.model.getBoundingBox(-1, -1)  # of the whole model: its low and its high corner
    widest = max(np.subtract(box[3:], box[:3]))
    # Gmsh measures the distance from sample points. They are half a smallest edge apart on a
    # curve as long as the model is wide.
    samples = min(int(2 * widest / (h * grading.smallest(h))) + 2, MOST_SAMPLES)
    fields = gmsh.model.mesh.field
    tag = fields.add("Distance")
    fields.setNumbers(tag, "PointsList", points)
    fields.setNumbers(tag, "CurvesList", curves)
    fields.setNumber(tag, "Sampling", samples)
    return int(tag)


def _entities(gmsh, name: str | None, where: str) -> tuple[list[int], list[int]]:
    """Return the tags of the points and the tags of the curves of the set `name`.

    The sets are the physical groups of points and curves, and "boundary", unless a group has
    this name. Raises `InputError` if there is no such set; `where` is the file, for the message.
    """
    groups: dict[str, tuple[list[int], list[int]]] = {}
    for dim, tag in gmsh.model.getPhysicalGroups():
        if dim < 2:
            group = groups.setdefault(gmsh.model.getPhysicalName(dim, tag), ([], []))
            group[dim].extend(map(int, gmsh.model.getEntitiesForPhysicalGroup(dim, tag)))
    if "boundary" not in groups:
        border = gmsh.model.getBoundary(gmsh.model.getEntities(2), oriented=False)
        groups["boundary"] = [], [abs(tag) for _, tag in border]
    if name not in groups:
        allowed = f"must be a set of points or curves: {', '.join(sorted(filter(None, groups)))}"
        remedy = did_you_mean(name, sorted(groups)) or "Or give its point = [X, Y]."
        raise InputError(f"grading: where = {name!r}", allowed, where, remedy)
    return groups[name]
