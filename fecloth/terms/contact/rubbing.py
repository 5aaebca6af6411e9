"""Friction at one state: its force on points, and the derivatives of that."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fecloth.terms.contact import barrier, friction

if TYPE_CHECKING:
    from fecloth.terms.contact.bound_obstacle import BoundObstacle, Contacts


def along(n: np.ndarray, w: np.ndarray) -> np.ndarray:
    """w − n (n · w): the parts of vectors (m, 3) along a surface with the normals n (m, 3)."""
    return w - n * np.einsum("mi,mi->m", n, w)[:, None]


@dataclass(frozen=True, eq=False)
class Rubbing:
    """Points that slide on an obstacle.

    Attributes
    ----------
    limit
        (p,) μ λ [N].
    eps
        Speed from which friction has its full value [m/s].
    steep
        (p,) |∇d|.
    n, turn
        (p, 3) ∇d/|∇d| and (p, 3, 3) its derivative by x [1/m].
    relative, w
        (p, 3) velocity relative to the obstacle, and its part along the surface [m/s].
    spin
        (3, 3) derivative of the obstacle's velocity by x [1/s].
    hessian
        (p, 3, 3) ∇²d [1/m].
    """

    limit: np.ndarray
    eps: float
    steep: np.ndarray
    n: np.ndarray
    turn: np.ndarray
    relative: np.ndarray
    w: np.ndarray
    spin: np.ndarray
    hessian: np.ndarray

    @classmethod
    def of(
        cls,
        obstacle: BoundObstacle,
        at: Contacts,
        gradient: np.ndarray,
        hessian: np.ndarray,
        x: np.ndarray,
        v: np.ndarray,
        t: float,
    ) -> Rubbing:
        """The friction at x, v (n, 3) and t."""
        steep = np.sqrt(np.einsum("mi,mi->m", gradient, gradient))
        n = gradient / steep[:, None]
        across = np.eye(3) - n[:, :, None] * n[:, None, :]
        turn = across @ hessian / steep[:, None, None]
        surface = obstacle.shape.velocity(at.points.values(x, at.which), t)
        relative = at.points.values(v, at.which) - surface
        limit = obstacle.friction * obstacle.normal_force(at) * steep
        spin = np.cross(obstacle.shape.rates(t)[1], np.eye(3)).T
        w = along(n, relative)
        return cls(limit, obstacle.creep, steep, n, turn, relative, w, spin, hessian)

    @property
    def _factor(self) -> np.ndarray:
        y = np.sqrt(np.einsum("mi,mi->m", self.w, self.w))
        return friction.factor(y, self.eps)

    @property
    def force(self) -> np.ndarray:
        """(p, 3) −μ λ f₁(y)/y w [N]."""
        return -(self.limit * self._factor)[:, None] * self.w

    @property
    def damping(self) -> np.ndarray:
        """(p, 3, 3) −∂F/∂v, positive semi-definite."""
        across = np.eye(3) - self.n[:, :, None] * self.n[:, None, :]
        return self._slope @ across

    @property
    def _slope(self) -> np.ndarray:
        """−∂F/∂w."""
        return self.limit[:, None, None] * friction.slope(self.w, self.eps)

    def stiffness(self, obstacle: BoundObstacle, at: Contacts) -> np.ndarray:
        """(p, 3, 3) −∂F/∂x, not symmetric: by λ, by the turn of the normal, by the rotation."""
        s, areas = at.d / obstacle.gap, at.points.areas[at.which]
        stiff = obstacle.stiffness * areas * self.steep**2 / obstacle.gap * barrier.curvature(s)
        more = np.einsum("mij,mj->mi", self.hessian, self.n)
        change = -stiff[:, None] * self.n + obstacle.normal_force(at)[:, None] * more  # ∂λ/∂x
        by_force = obstacle.friction * self._factor[:, None, None] * self.w[:, :, None]
        across = np.einsum("mi,mi->m", self.n, self.relative)[:, None, None]
        turned = (
            across * self.turn
            + self.n[:, :, None] * np.einsum("mj,mjk->mk", self.relative, self.turn)[:, None, :]
        )
        spun = self.spin - self.n[:, :, None] * (self.n @ self.spin)[:, None, :]
        return by_force * change[:, None, :] - self._slope @ (turned + spun)
