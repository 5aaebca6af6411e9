"""The processes that hold the parts of one cloth, as the first of them sees them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import numpy as np

from fecloth.distributed.part_system import PartDescription
from fecloth.distributed.partition import Part
from fecloth.distributed.worker import ABILITIES, Worker
from fecloth.terms.step_difference import StepDifference


class Link(Protocol):
    """How calls reach the workers: by MPI, or within one process for tests."""

    size: int

    def begin(self, descriptions: Sequence[PartDescription]) -> Worker:
        """Make one worker of each description, and return that of this process."""
        ...

    def each(self, name: str, arguments: Sequence[tuple]) -> list:
        """What the function `name` of each worker returns for its own arguments."""
        ...


class LocalLink:
    """All workers in this process; for tests."""

    def __init__(self, size: int):
        self.size = size
        self.workers: list[Worker] = []

    def begin(self, descriptions: Sequence[PartDescription]) -> Worker:
        self.workers = [Worker(one) for one in descriptions]
        return self.workers[0]

    def each(self, name: str, arguments: Sequence[tuple]) -> list:
        pairs = zip(self.workers, arguments, strict=True)
        return [getattr(worker, name)(*own) for worker, own in pairs]


@dataclass(eq=False)
class Crew:
    """The workers of a cloth."""

    # How they are called, and the part of each.
    link: Link
    parts: Sequence[Part]
    here: Worker  # the worker of this process
    placed: dict[str, np.ndarray] = field(default_factory=dict)
    forgotten: list = field(default_factory=list)

    @classmethod
    def begin(cls, link: Link, descriptions: Sequence[PartDescription]) -> Crew:
        """Let each process make its part."""
        return cls(link, [one.part for one in descriptions], link.begin(descriptions))

    def call(self, name: str, *arguments: Any) -> list:
        """What the function `name` of each worker returns for the same arguments."""
        return self.each(name, lambda part: arguments)

    def each(self, name: str, arguments: Callable[[Part], tuple]) -> list:
        """What the function `name` of each worker returns for the arguments of its part."""
        if self.forgotten:
            keys = tuple(self.forgotten)
            self.forgotten.clear()
            self.link.each("forget", [(keys,)] * len(self.parts))
        return self.link.each(name, [arguments(part) for part in self.parts])

    def ask(self, key: Any, name: str, *arguments: Any) -> Any:
        """What an ability of a term, one of `ABILITIES`, returns for the whole cloth."""
        ability = ABILITIES[name]
        self.place(*arguments[: ability.placed])
        others = arguments[ability.placed :]
        shares = self.each("ask", lambda part: (key, name, cut(others, part.nodes)))
        return ability.gather(self.parts, shares)

    def place(self, x: np.ndarray | None = None, v: np.ndarray | None = None) -> None:
        """Give each worker positions, and velocities, where they are not what it has."""
        for name, y in (("x", x), ("v", v)):
            if y is None or np.array_equal(self.placed.get(name, np.empty(0)), y):
                continue
            self.placed[name] = y.copy()
            rows = [(y[part.nodes],) for part in self.parts]
            self.link.each(f"place_{name}", rows)

    def gather(self, rows: Sequence[np.ndarray], out: np.ndarray) -> np.ndarray:
        """out += the rows of the nodes that each worker owns, in place."""
        for part, own in zip(self.parts, rows, strict=True):
            out[part.own_nodes] += own
        return out


def cut(value: Any, nodes: np.ndarray) -> Any:
    """What a part needs of an argument: of arrays the rows of its nodes."""
    if isinstance(value, np.ndarray):
        return value[nodes]
    if isinstance(value, tuple | list):
        return tuple(cut(each, nodes) for each in value)
    if isinstance(value, StepDifference):
        return replace(value, start=cut(value.start, nodes), past=cut(value.past, nodes))
    return value
