"""A term with a history: each node hangs on an elastic spring that slips, and remembers where."""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from fecloth.linalg.block_matrix import BlockMatrix
from fecloth.terms.protocol import BoundTerm
from fecloth.terms.records import remembered


@remembered
@dataclass(frozen=True, eq=False)
class Slid:
    """Where the springs of all nodes are fixed (n, 3) [m], and the heat so far () [J]."""

    place: np.ndarray
    heat: np.ndarray


@dataclass(frozen=True)
class Sliders:
    """|f| ≤ most [N] at each node, and k [N/m] below: with e = x − place and s = k |e|, the energy
    over a step is s²/(2k) for s ≤ most, else (s − most/2) most/k."""

    k: float = 20.0
    most: float = 0.01
    elements = ("P1", "P2")

    def stencil(self, cloth):
        return None

    def bind(self, panel, slots):
        nodes = np.arange(len(panel.cloth.X), dtype=np.int32)
        return BoundSliders(self.k, self.most, slots(nodes[:, None]).ravel())


@dataclass(frozen=True, eq=False)
class BoundSliders(BoundTerm):
    """Without a record the springs are fixed where the nodes are, and there is no force."""

    k: float
    most: float
    own: np.ndarray
    record: Slid | None = None
    name = "Sliders"
    symmetric = has_energy = dissipative = True
    velocity_dependent = False

    def start_history(self, x, t):
        return Slid(x.copy(), np.zeros(()))

    def with_history(self, record):
        return replace(self, record=record)

    def over_step(self, step):
        return SlidersOverStep(
            k=self.k, most=self.most, own=self.own, record=step.history, at_mean=step.at_mean
        )

    def spring(self, x):
        """e (n, 3), s (n,)."""
        e = x - (x if self.record is None else self.record.place)
        return e, self.k * np.linalg.norm(e, axis=1)

    def energy(self, x, t):
        s = self.spring(x)[1]
        below = s**2 / (2 * self.k)
        beyond = (s - 0.5 * self.most) * self.most / self.k
        return float(np.where(s <= self.most, below, beyond).sum())

    def power(self, x, v, t):
        return 0.0

    def add_force(self, x, v, t, f):
        e, s = self.spring(x)
        f -= self.k * np.minimum(1.0, self.most / np.maximum(s, 1e-300))[:, None] * e

    def add_tangent(self, x, v, t, wx, wv, J: BlockMatrix, definite):
        e, s = self.spring(x)
        slides = s > self.most
        n = e / np.maximum(np.linalg.norm(e, axis=1), 1e-300)[:, None]
        across = np.eye(3) - n[:, :, None] * n[:, None, :]
        part = np.where(slides, self.most / np.maximum(s, 1e-300), 1.0)[:, None, None]
        J.values[self.own] += (
            wx * self.k * part * np.where(slides[:, None, None], across, np.eye(3))
        )


@dataclass(frozen=True, eq=False)
class SlidersOverStep(BoundSliders):
    """With the discrete gradient of `EnergyMomentum` the force would be that at the mean."""

    at_mean: bool = field(default=False)
    dissipative = False

    def slip(self, x) -> np.ndarray:
        """(n, 3) [m] by which the springs have slipped at x, the end of the step."""
        e, s = self.spring(x)
        return np.maximum(0.0, 1.0 - self.most / np.maximum(s, 1e-300))[:, None] * e

    def dissipation(self, x):
        return float(self.most * np.linalg.norm(self.slip(x), axis=1).sum())

    def commit(self, x, t):
        before: Any = self.record
        return Slid(before.place + self.slip(x), before.heat + self.dissipation(x))
