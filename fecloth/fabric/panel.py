"""A cloth with the fabric and the warp direction of each triangle."""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from fecloth.compiled.team import ALONE, Team
from fecloth.errors import InputError
from fecloth.fabric.fabric import Fabric
from fecloth.mesh.cloth import Cloth
from fecloth.quantities.sameness import same


@dataclass(frozen=True, eq=False)
class Clamps:
    """Edges of the boundary at which pins hold the normal of the cloth.

    Attributes
    ----------
    half_edges
        (c,) half-edges of ``cloth.edge_slopes.edges``.
    points
        (c, 3) a point of the held plane of each edge, at the start [m]. It is so far away that
        its direction is the same from wherever the edge goes.
    moved
        Function of points (c, 3) at the start, one for each edge, and of the time t [s]. It
        returns where the pins have moved these points. None: the pins do not move.
    """

    half_edges: np.ndarray
    points: np.ndarray
    moved: Callable[[np.ndarray, float], np.ndarray] | None = None


@dataclass(frozen=True, eq=False)
class Panel:
    """A cloth with the fabric and the warp direction of each triangle; create it with `cut`.

    Terms are bound to a panel.

    Attributes
    ----------
    cloth
        The cloth.
    fabrics
        The fabrics of the regions.
    region
        (m,) index of the fabric of each triangle.
    grain
        (m,) angle from the X axis to the warp in each triangle [rad].
    start
        (n, 3) positions at which the run starts [m]; None: flat, at (X, Y, 0).
    clamps
        The edges whose normal is held by pins.
    mass
        "lumped" or "consistent", as in `System`.
    team
        The threads that share the loops of terms.
    counted
        Function of the nodes (m, k) of elements that returns (m,) whether these elements count
        in sums over elements; a node −1 is no node. Where other processes hold other parts of
        the cloth, each element counts in one process. None, for a whole cloth: all count.
    """

    cloth: Cloth
    fabrics: tuple[Fabric, ...]
    region: np.ndarray
    grain: np.ndarray
    start: np.ndarray | None = None
    clamps: Clamps | None = None
    mass: str = "consistent"
    team: Team = ALONE
    counted: Callable[[np.ndarray], np.ndarray] | None = None

    @classmethod
    def cut(
        cls,
        cloth: Cloth,
        fabric: Fabric | Mapping[str, Fabric],
        grain: float | Mapping[str, float] = 0.0,
    ) -> Self:
        """Return the panel with a fabric and a warp direction for each triangle of a cloth.

        Raises `InputError` for arguments of other types, for an angle that is not finite, for an
        unknown region, and for a triangle that is not in exactly one of the named regions.

        Parameters
        ----------
        fabric
            One fabric, or a fabric by the name of each region.
        grain
            The angle from the X axis to the warp [rad]: one, or one by the name of each region.
        """
        fabrics, region = _by_region(cloth, fabric, "fabric")
        for value in fabrics:
            if not isinstance(value, Fabric):
                allowed = 'must be a Fabric, or {"region": Fabric, ...}'
                raise InputError(f"fabric = {value!r}", allowed, "System")
        angles, angle_index = _by_region(cloth, grain, "grain")
        for angle in angles:
            if not isinstance(angle, float | int | np.number) or not np.isfinite(angle):
                raise InputError(f"grain = {angle!r}", "must be a finite angle [rad]", "System")
        return cls(cloth, fabrics, region, np.array(angles, dtype=float)[angle_index])

    def each(self, constants: Callable[[Fabric], ArrayLike]) -> np.ndarray:
        """(m, p) constants of each triangle, from a function ``constants(fabric) -> (p,)``.

        If the constants are equal in all fabrics, the result is a view of a single row.
        """
        rows = self.rows(constants)
        if len({row.tobytes() for row in rows}) == 1:
            return np.broadcast_to(rows[0], (len(self.region), rows.shape[1]))
        return rows[self.region]

    def rows(self, constants: Callable[[Fabric], ArrayLike]) -> np.ndarray:
        """(f, p) constants of each fabric, from a function ``constants(fabric) -> (p,)``."""
        return rows_of(self.fabrics, constants)

    @cached_property
    def density(self) -> np.ndarray:
        """(m,) mass per reference area of each triangle [kg/m²]."""
        return self.each(lambda fabric: fabric.areal_density)[:, 0]

    @cached_property
    def material(self) -> np.ndarray:
        """(m,) equal where two triangles have one fabric and one warp direction."""
        angle = np.unique(self.grain, return_inverse=True)[1]
        cut = self.region * (int(angle.max()) + 1) + angle
        number: np.ndarray = np.unique(cut, return_inverse=True)[1]
        return number

    @cached_property
    def nodal_mass(self) -> np.ndarray:
        """(n,) row sums of the mass matrix [kg]; zero at the corners of P2 if it is consistent."""
        if self.mass == "lumped":
            return self.cloth.diagonal_mass(self.density)
        return self.cloth.weighted_load(self.density)

    def count(self, y: np.ndarray) -> np.ndarray:
        """Return values (n, 3) of nodes, with zeros at nodes that do not count in sums."""
        if self.counted is None:
            return y
        return np.where(self.counted(np.arange(len(y))[:, None])[:, None], y, 0.0)

    @cached_property
    def gradients(self) -> np.ndarray:
        """(m, q, k, 2) derivatives of N_a along warp and weft [1/m].

        F, E and S from these gradients refer to the directions of the fabric.
        """
        if not self.grain.any():
            return self.cloth.gradients
        c = np.cos(self.grain)
        s = np.sin(self.grain)
        rotation = np.array([[c, -s], [s, c]])  # columns: warp and weft in X and Y
        return np.ascontiguousarray(np.einsum("eqai,ije->eqaj", self.cloth.gradients, rotation))


@dataclass(frozen=True, eq=False)
class WatchedPanel(Panel):
    """A panel that notes what a term reads of the fabrics, of the start and of the clamps.

    All else in a panel follows from the mesh, its regions and the warp direction.

    Attributes
    ----------
    names
        The attributes among `WATCHED` that were read.
    functions
        The functions of a fabric whose values were read, as of `each`.
    """

    names: set[str] = field(default_factory=set)
    functions: list[Callable[[Fabric], ArrayLike]] = field(default_factory=list)

    WATCHED: ClassVar = ("fabrics", "start", "clamps")

    @classmethod
    def of(cls, panel: Panel) -> Self:
        """Return a watched copy of a panel, of which nothing was read yet."""
        watched = cls(**{part.name: getattr(panel, part.name) for part in fields(panel)})
        watched.names.clear()
        return watched

    def __getattribute__(self, name: str) -> Any:
        if name in WatchedPanel.WATCHED:
            self.names.add(name)
        return super().__getattribute__(name)

    def rows(self, constants: Callable[[Fabric], ArrayLike]) -> np.ndarray:
        """As `Panel.rows`; the function is noted in place of the whole fabrics."""
        self.functions.append(constants)
        return rows_of(vars(self)["fabrics"], constants)

    def gave_same(self, other: Panel, names: Collection[str] = ()) -> bool:
        """Return whether all that was read, and the attributes `names`, is the same in another."""
        known = vars(self)
        attributes = all(same(known[name], getattr(other, name)) for name in {*self.names, *names})
        return attributes and all(
            same(rows_of(known["fabrics"], constants), other.rows(constants))
            for constants in self.functions
        )


def rows_of(fabrics: tuple[Fabric, ...], constants: Callable[[Fabric], ArrayLike]) -> np.ndarray:
    """Return the constants (f, p) of each fabric, from a function ``constants(fabric) -> (p,)``."""
    return np.array([np.atleast_1d(constants(fabric)) for fabric in fabrics], dtype=float)


def _by_region(cloth: Cloth, values: Any, name: str) -> tuple[tuple, np.ndarray]:
    """Return the different values, and the index (m,) in them of the value of each triangle.

    `values` is one value for the whole cloth, or a mapping from the name of each region to its
    value. Raises `InputError`, with the `name` of the argument of `System`, for an empty mapping,
    an unknown region, and a triangle that is not in exactly one of the regions.
    """
    if not isinstance(values, Mapping):
        return (values,), np.zeros(len(cloth.triangles), int)
    where = f"System({name}=...)"
    if not values:
        raise InputError(f"{name} = {{}}", "must name a region", where)
    is_inside = np.zeros((len(values), len(cloth.triangles)), bool)  # of each region
    for row, region in zip(is_inside, values, strict=True):
        row[cloth.region(region)] = True
    count = is_inside.sum(axis=0)
    if (count != 1).any():
        bad = int(np.flatnonzero(count != 1)[0])
        what = f"triangle {bad} is in {count[bad]} of the regions {', '.join(values)}"
        remedy = f"The cloth has the regions {', '.join(sorted(cloth.triangle_sets))}."
        raise InputError(what, f"each triangle needs one {name}", where, remedy)
    return tuple(values.values()), is_inside.argmax(axis=0)
