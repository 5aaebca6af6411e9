"""The whole cloth as the first process sees it, with terms whose loops run on all processes."""

from __future__ import annotations

import weakref
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import count
from typing import Any

import numpy as np

from fecloth.distributed.crew import Crew
from fecloth.distributed.worker import cut_step
from fecloth.terms.protocol import BoundTerm, has_own
from fecloth.terms.step_difference import StepDifference

_new_keys = count()


@dataclass(frozen=True, eq=False)
class RemoteTerm:
    """A bound term of the whole cloth; each process has it bound to a part.

    It has the abilities that the term has on this process, as far as they are functions here, and
    the plain attributes of that. What the term has not does nothing here either.

    Attributes
    ----------
    crew, key
        The processes, and the name of the term there.
    near
        The term as it is bound to the part of this process.
    """

    crew: Crew
    key: Any
    near: Any

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        value = getattr(self.near, name)
        if not callable(value):
            return value
        if not has_own(self.near, name):
            return vars(BoundTerm)[name].__get__(self)
        if name not in ABILITIES:
            raise AttributeError(f"{name} of {self.near.name} is not offered by several processes")
        return ABILITIES[name].__get__(self)

    def here(self) -> BoundTerm:
        """The term as it is bound to the part of this process."""
        return self.near

    def add_force(self, x, v, t, f) -> None:
        """f += the force [N]."""
        self.crew.place(x, v)
        self.crew.gather(self.crew.call("force", (self.key,), t), f)

    def add_tangent(self, x, v, t, wx, wv, J, definite) -> None:
        """Add to the matrix that the processes hold, not to J."""
        self.crew.place(x, v)
        self.crew.call("add_tangent", self.key, t, wx, wv, definite)

    def rate_bounds(self, mass: np.ndarray) -> tuple[float, float]:
        """The largest bounds of all parts."""
        bounds = self.crew.each("rate_bounds", lambda part: (self.key, mass[part.nodes]))
        return max(b[0] for b in bounds), max(b[1] for b in bounds)


def _energy(self: RemoteTerm, x, t) -> float:
    self.crew.place(x)
    return self.crew.total("energy", self.key, t)


def _power(self: RemoteTerm, x, v, t) -> float:
    self.crew.place(x, v)
    return self.crew.total("power", self.key, t)


def _supply(self: RemoteTerm, x, v, t) -> float:
    self.crew.place(x, v)
    return self.crew.total("supply", self.key, t)


def _dissipation(self: RemoteTerm, x) -> float:
    self.crew.place(x)
    return self.crew.total("dissipation", self.key)


def _add_stress(self: RemoteTerm, x, out) -> None:
    self.crew.place(x)
    _gather_cells(self.crew, self.crew.call("stress", self.key), out)


def _strain_error(self: RemoteTerm, x, t) -> np.ndarray:
    self.crew.place(x)
    error = np.zeros(sum(map(len, rows := self.crew.call("strain_error", self.key, t))))
    _gather_cells(self.crew, rows, error)
    return error


def _gather_cells(crew: Crew, rows: Sequence[np.ndarray], out: np.ndarray) -> None:
    """out += the rows of the triangles that count in each part."""
    for part, own in zip(crew.parts, rows, strict=True):
        out[part.cells[part.counted(part.triangles)]] += own


def _work_of_clamps(self: RemoteTerm, old, new, stages) -> float:
    def cut(part) -> tuple:
        def at(place):
            return place[0][part.nodes], place[1]

        return self.key, at(old), at(new), [at(stage) for stage in stages]

    return float(sum(self.crew.each("work_of_clamps", cut)))


def _over_step(self: RemoteTerm, step: StepDifference) -> RemoteTerm:
    crew = self.crew
    if self.near.over_step(cut_step(step, crew.parts[0].nodes)) is self.near:
        return self
    new = "step", next(_new_keys)
    crew.each("over_step", lambda part: (self.key, new, cut_step(step, part.nodes)))
    over = RemoteTerm(crew, new, crew.here.terms[new])
    weakref.finalize(over, crew.forgotten.append, new)
    return over


ABILITIES: dict[str, Callable] = {
    "energy": _energy,
    "power": _power,
    "supply": _supply,
    "dissipation": _dissipation,
    "add_stress": _add_stress,
    "strain_error": _strain_error,
    "work_of_clamps": _work_of_clamps,
    "over_step": _over_step,
}


__all__ = ["ABILITIES", "RemoteTerm"]
