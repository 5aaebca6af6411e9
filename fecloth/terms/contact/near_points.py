"""The points of a cloth that are nearer to a shape than the gap."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fecloth.linalg.block_matrix import BlockMatrix
from fecloth.terms.contact.points import Points
from fecloth.terms.contact.shape import Shape
from fecloth.terms.last_states import LastStates


@dataclass(frozen=True, eq=False)
class Contacts:
    """Points of one kind that an obstacle pushes.

    Attributes
    ----------
    points
        All points of the kind.
    point_numbers
        Numbers (p,) of the points nearer than the gap.
    y
        Places (p, 3) of these in the frame of the shape [m].
    s
        Distances (p,) of these over the gap.
    shape
        The shape of the obstacle.
    t
        The time [s].
    """

    points: Points
    point_numbers: np.ndarray
    y: np.ndarray
    s: np.ndarray
    shape: Shape
    t: float

    @cached_property
    def body_slopes(self) -> tuple[np.ndarray, np.ndarray]:
        """Gradient (p, 3) and Hessian (p, 3, 3) of the distance, in the frame of the shape."""
        return self.shape.slopes(self.y, self.t)

    @cached_property
    def slopes(self) -> tuple[np.ndarray, np.ndarray]:
        """The same in space."""
        gradient, hessian = self.body_slopes
        if self.shape.rotate is None:
            return gradient, hessian
        R = self.shape.pose(self.t).R
        return gradient @ R.T, np.einsum("ij,pjk,lk->pil", R, hessian, R)

    @property
    def areas(self) -> np.ndarray:
        return self.points.areas[self.point_numbers]

    def values(self, of_nodes: np.ndarray) -> np.ndarray:
        """(p, 3) values at the points, from values at the nodes (n, 3)."""
        return self.points.values(of_nodes, self.point_numbers)

    def add_force(self, F: np.ndarray, f: np.ndarray) -> None:
        """f (n, 3) += the forces F (p, 3) on the points [N]."""
        self.points.add_force(self.point_numbers, F, f)

    def add_tangent(self, K: np.ndarray, J: BlockMatrix) -> None:
        """J += the stiffness K (p, 3, 3) of the points."""
        self.points.add_tangent(self.point_numbers, K, J)

    def coupling(self, K: np.ndarray) -> None:
        """None: all of its tangent is in the fixed pattern."""

    def hand_on(self, before: "Contacts", e: np.ndarray) -> np.ndarray:
        """e (p, 3) at these points, from the points `before`; 0 where they did not touch."""
        if before.points is not self.points:
            return np.zeros((len(self.s), 3))
        of_all = np.zeros((len(self.points.areas), 3))
        of_all[before.point_numbers] = e
        return of_all[self.point_numbers]


@dataclass(frozen=True, eq=False)
class NearPoints:
    """The points that a shape pushes, at positions of the cloth.

    Attributes
    ----------
    shape
        The shape.
    gap
        Distance at which the barrier begins [m].
    points
        The kinds of points on which the obstacle acts; the nodes are the first.
    """

    shape: Shape
    gap: float
    points: tuple[Points, ...]

    @cached_property
    def placed_nodes(self) -> LastStates[tuple[np.ndarray, np.ndarray]]:
        """Of x and t: the nodes (n, 3) in the frame of the body, and their distances (n,) [m]."""

        def place(x: np.ndarray, t: float) -> tuple[np.ndarray, np.ndarray]:
            y = self.shape.pose(t).to_body(x)
            return y, self.shape.distance(y, t)

        return LastStates(place)

    @cached_property
    def touching(self) -> LastStates[list[Contacts]]:
        """Of x and t: the points nearer than the gap, with their distances; a `Contacts` a kind.

        A kind without such points is left out.
        """
        return LastStates(lambda x, t: list(self._find_touching(x, t)))

    def _find_touching(self, x: np.ndarray, t: float) -> Iterator[Contacts]:
        y_of_nodes, node_distances = self.placed_nodes(x, t)
        for points in self.points:
            point_numbers = points.candidates(node_distances, self.gap)
            if not len(point_numbers):
                continue
            y = points.values(y_of_nodes, point_numbers)
            s = self.shape.distance(y, t) / self.gap
            is_touching = s < 1.0
            if is_touching.any():
                yield Contacts(
                    points=points,
                    point_numbers=point_numbers[is_touching],
                    y=y[is_touching],
                    s=s[is_touching],
                    shape=self.shape,
                    t=t,
                )
