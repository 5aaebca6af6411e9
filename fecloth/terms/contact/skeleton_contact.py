"""An obstacle that is thin against the triangles of the cloth: its skeleton acts."""

from dataclasses import dataclass

import numpy as np

from fecloth.terms.contact.inside import starts_inside
from fecloth.terms.contact.shape import Shape
from fecloth.terms.contact.surfaces import Triangles, surface_of
from fecloth.terms.contact.triangle_contact import BoundTriangleContact


@dataclass(frozen=True, eq=False)
class BoundSkeleton(BoundTriangleContact):
    """The `Skeleton` of a shape and a cloth: pairs of edges, and of a point and a triangle."""

    body: Shape

    def least_distance(self, x: np.ndarray, t: float) -> float:
        """The least distance [m] from the surface; infinite beyond the gap."""
        return self.sets.least_distance(self.place(x, t)) - self.sets.thickness

    def surface(self, t: float, place: np.ndarray, reach: float) -> Triangles:
        return surface_of(self.body, t, place, reach)

    def room(self, x: np.ndarray, t: float) -> np.ndarray:
        return self.body.distance(self.place(x, t), t)

    def check_start(self, x: np.ndarray, t: float, where: str) -> None:
        """Raise `InputError` for a cloth of which a part starts inside the shape."""
        if not self.allows(x, t):
            depth = -self.room(x, t)
            nodes = np.flatnonzero(depth >= 0.0)
            raise starts_inside(self.body, self.gap, where, nodes, depth[nodes])
