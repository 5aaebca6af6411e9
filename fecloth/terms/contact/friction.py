"""Coulomb friction with a smooth passage from rest to sliding, of points on an obstacle.

    F = −μ λ f₁(y)/y w,   f₁(y) = 2y/ε − y²/ε² for y < ε, else 1

with the normal force λ, the velocity w of sliding, y = |w|, and a small speed ε. F is the
derivative of the potential −μ λ f₀(y) by w, f₀′ = f₁. At rest the cloth creeps with less than ε.

λ and the directions of sliding are taken at one place and time, `Sliding`. Over a step that is
its begin, so that friction has a potential. Over an increment of the loads it is the end, for
which the increment is solved again and again. Outside a step it is the state itself.

Source: Li et al. (2020), Incremental Potential Contact, ACM Trans. Graph. 39(4), section on
friction; f₀ and f₁ as the IPC Toolkit has them.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from fecloth.terms.contact.points import Contacts

# ε over the extent of the cloth, per second: below this speed friction counts as friction at
# rest. A cloth on a slope creeps by less than a thousandth of its extent in a second.
CREEP_OVER_EXTENT = 1e-3


def potential(y: np.ndarray, eps: float) -> np.ndarray:
    """f₀(y) of speeds y (m,) [m/s]."""
    inside = -(y**3) / (3 * eps**2) + y**2 / eps + eps / 3
    return np.where(y < eps, inside, y)


def factor(y: np.ndarray, eps: float) -> np.ndarray:
    """f₁(y)/y of speeds y (m,) [m/s]."""
    return np.where(y < eps, 2 / eps - y / eps**2, 1 / np.maximum(y, eps))


def slope(w: np.ndarray, eps: float) -> np.ndarray:
    """Return ∂(f₁(y)/y w)/∂w (m, 3, 3) at velocities w (m, 3) [m/s]; positive semi-definite.

    It is f₁/y I + (f₁/y)′/y w wᵀ, with the derivative by y.
    """
    y = np.sqrt(np.einsum("mi,mi->m", w, w))
    y_or_one = np.where(y > 0.0, y, 1.0)  # where w is zero, so is w wᵀ
    factor_slope = np.where(y < eps, -1 / eps**2, -1 / np.maximum(y, eps) ** 2)
    factor_slope_over_y = factor_slope / y_or_one
    rank_one = factor_slope_over_y[:, None, None] * w[:, :, None] * w[:, None, :]
    return factor(y, eps)[:, None, None] * np.eye(3) + rank_one


def along(n: np.ndarray, w: np.ndarray) -> np.ndarray:
    """w − n (n · w): the parts of vectors (m, 3) along a surface with the normals n (m, 3)."""
    return w - n * np.einsum("mi,mi->m", n, w)[:, None]


class Sliding(Protocol):
    """Contacts that slide, with the normal forces and directions of one place and time.

    Velocities v (m, 3) belong to its m points in space, w (m, 3) are their parts along and
    relative to the surface that they slide on, both in m/s.
    """

    def values(self, of_nodes: np.ndarray) -> np.ndarray:
        """(m, 3) values at its points, from values at the nodes (n, 3)."""

    def slip(self, v: np.ndarray) -> np.ndarray:
        """w of the velocities v."""

    def rate(self, w: np.ndarray) -> float:
        """Σ μ λ f₀(y) [W]; minus its derivative by w is the force."""

    def power(self, w: np.ndarray) -> float:
        """Σ μ λ f₁(y) y [W], which is dissipated."""


@dataclass(frozen=True, eq=False)
class SlidingPoints:
    """Points of one kind that slide on an obstacle.

    Attributes
    ----------
    contacts
        The p points that touch.
    limit
        μ λ (p,) [N], the most friction of each.
    n
        Normals (p, 3) of the obstacle.
    surface
        Velocity (p, 3) of the obstacle [m/s].
    eps
        Speed ε [m/s] from which friction has its full value.
    """

    contacts: Contacts
    limit: np.ndarray
    n: np.ndarray
    surface: np.ndarray
    eps: float

    def values(self, of_nodes: np.ndarray) -> np.ndarray:
        return self.contacts.points.values(of_nodes, self.contacts.point_numbers)

    def slip(self, v: np.ndarray) -> np.ndarray:
        return along(self.n, v - self.surface)

    def rate(self, w: np.ndarray) -> float:
        return float((self.limit * potential(np.linalg.norm(w, axis=1), self.eps)).sum())

    def power(self, w: np.ndarray) -> float:
        y = np.linalg.norm(w, axis=1)
        return float((self.limit * factor(y, self.eps) * y**2).sum())

    def add_force(self, w: np.ndarray, f: np.ndarray) -> None:
        """f (n, 3) −= μ λ f₁(y)/y w [N]."""
        size = self.limit * factor(np.linalg.norm(w, axis=1), self.eps)
        self.contacts.points.add_force(self.contacts.point_numbers, -size[:, None] * w, f)

    def damping(self, w: np.ndarray, weight: float = 1.0) -> np.ndarray:
        """(p, 3, 3) `weight` times −∂F/∂v, positive semi-definite."""
        slope_along_surface = self._across @ slope(w, self.eps) @ self._across
        return weight * self.limit[:, None, None] * slope_along_surface

    def stiffness(self, v: np.ndarray, change: np.ndarray, spin: np.ndarray) -> np.ndarray:
        """Return −∂F/∂x (p, 3, 3) [N/m] of F = −μ λ (f₁/y) w at one state; it is not symmetric.

        With r = v − surface, w = r − n (n · r) changes because the normal n turns with x, and
        because the velocity of the obstacle does; λ changes, too.

        Parameters
        ----------
        v
            Velocities (p, 3) of the points [m/s].
        change
            ∂(μ λ n)/∂x (p, 3, 3) [N/m].
        spin
            ∂surface/∂x (3, 3) [1/s], with the velocity `surface` of the obstacle.
        """
        w = self.slip(v)
        r = v - self.surface
        turn_of_n = self._across @ change  # μ λ ∂n/∂x, as n keeps its length
        # −μ λ ∂w/∂x: by the turn of n, in both of its places, and by the obstacle's velocity
        minus_dw = np.einsum("mi,mi->m", self.n, r)[:, None, None] * turn_of_n
        minus_dw += self.n[:, :, None] * (r[:, None] @ turn_of_n)
        minus_dw = minus_dw + self.limit[:, None, None] * self._across @ spin
        by_change_of_force = w[:, :, None] * (self.n[:, None] @ change)  # w ⊗ ∂(μ λ)/∂x
        y = np.linalg.norm(w, axis=1)
        by_change_of_force = factor(y, self.eps)[:, None, None] * by_change_of_force
        return by_change_of_force - slope(w, self.eps) @ minus_dw

    @property
    def _across(self) -> np.ndarray:
        """(p, 3, 3) 1 − n nᵀ."""
        return np.eye(3) - self.n[:, :, None] * self.n[:, None, :]
