"""A cloth cut from its fabrics: which fabric each triangle is of, and where its warp runs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fecloth.errors import InputError
from fecloth.fabric.fabric import Fabric
from fecloth.mesh.cloth import Cloth


@dataclass(frozen=True, eq=False)
class Panel:
    """What a term is bound to; made by `cut`.

    Attributes
    ----------
    cloth
        The reference mesh.
    fabrics
        The fabrics of its regions.
    region
        (m,) index of each triangle's fabric.
    grain
        (m,) angle of the warp from the X axis [rad].
    """

    cloth: Cloth
    fabrics: tuple[Fabric, ...]
    region: np.ndarray
    grain: np.ndarray

    @classmethod
    def cut(
        cls,
        cloth: Cloth,
        fabric: Fabric | Mapping[str, Fabric],
        grain: float | Mapping[str, float] = 0.0,
    ) -> Panel:
        """One fabric for all, or one for each named region; likewise the grain angle [rad].

        Raises
        ------
        InputError
            For a region that the cloth does not have, regions that overlap or leave a gap, what
            is no fabric, or an angle that is not finite.
        """
        fabrics, region = _by_region(cloth, fabric, "fabric")
        for one in fabrics:
            if not isinstance(one, Fabric):
                allowed = 'must be a Fabric, or {"region": Fabric, ...}'
                raise InputError(f"fabric = {one!r}", allowed, "System")
        angles, lies = _by_region(cloth, grain, "grain")
        for angle in angles:
            if not isinstance(angle, float | int | np.number) or not np.isfinite(angle):
                raise InputError(f"grain = {angle!r}", "must be a finite angle [rad]", "System")
        angle = np.array(angles, dtype=float)[lies]
        return cls(cloth, fabrics, region, angle)

    def each(self, constants: Callable[[Fabric], np.ndarray]) -> np.ndarray:
        """(m, p) of ``constants(fabric) -> (p,)``, the triangles' own; one fabric takes one row."""
        rows = np.array([np.atleast_1d(constants(fabric)) for fabric in self.fabrics], dtype=float)
        if len(rows) == 1:
            return np.broadcast_to(rows, (len(self.region), rows.shape[1]))
        return rows[self.region]

    @cached_property
    def density(self) -> np.ndarray:
        """(m,) mass per reference area [kg/m²]."""
        return self.each(lambda fabric: fabric.areal_density)[:, 0]

    @cached_property
    def gradients(self) -> np.ndarray:
        """(m, q, k, 2), ∂N_a along warp and weft [1/m], so that F, E and S are the fabric's."""
        if not self.grain.any():
            return self.cloth.gradients
        c, s = np.cos(self.grain), np.sin(self.grain)
        turn = np.array([[c, -s], [s, c]])  # columns: warp and weft in X and Y
        return np.ascontiguousarray(np.einsum("eqai,ije->eqaj", self.cloth.gradients, turn))


def _by_region(cloth: Cloth, given, name: str) -> tuple[tuple, np.ndarray]:
    """The values that occur, and (m,) index of each triangle's own."""
    if not isinstance(given, Mapping):
        return (given,), np.zeros(len(cloth.triangles), int)
    where = f"System({name}=...)"
    if not given:
        raise InputError(f"{name} = {{}}", "must name a region", where)
    inside = np.zeros((len(given), len(cloth.triangles)), bool)
    for row, region in zip(inside, given, strict=True):
        row[cloth.region(region)] = True
    times = inside.sum(axis=0)
    if (times != 1).any():
        bad = int(np.flatnonzero(times != 1)[0])
        what = f"triangle {bad} lies in {times[bad]} of the regions {', '.join(given)}"
        remedy = f"The cloth has the regions {', '.join(sorted(cloth.triangle_sets))}."
        raise InputError(what, f"each triangle needs one {name}", where, remedy)
    return tuple(given.values()), inside.argmax(axis=0)
