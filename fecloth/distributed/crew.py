"""The processes that hold the parts of one cloth, as the first of them sees them."""

import weakref
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import count
from operator import attrgetter
from types import FunctionType
from typing import Any, Protocol, Self

import numpy as np

from fecloth.distributed.partition import Part, PartDescription
from fecloth.distributed.worker import ABILITIES, Worker, rows
from fecloth.errors import InputError
from fecloth.terms.protocol import BoundTerm, has_own
from fecloth.terms.step_difference import StepDifference


class Link(Protocol):
    """How calls reach the workers."""

    size: int

    def begin(self, descriptions: Sequence[PartDescription]) -> Worker:
        """Make one worker of each description, and return the worker of this process."""

    def call_each(self, name: str, arguments: Sequence[tuple]) -> list:
        """What the function `name` of each worker returns for its own arguments."""


@dataclass(eq=False)
class Crew:
    """The workers of a cloth.

    Attributes
    ----------
    link
        How they are called.
    parts
        The part of each.
    here
        The worker of this process.
    placed
        The positions and velocities that they have, by the names "x" and "v".
    forgotten
        Keys of terms that they still keep and that nothing needs.
    """

    link: Link
    parts: Sequence[Part]
    here: Worker
    placed: dict[str, np.ndarray] = field(default_factory=dict)
    forgotten: list = field(default_factory=list)

    @classmethod
    def begin(cls, link: Link, descriptions: Sequence[PartDescription]) -> Self:
        """Make a worker of each description."""
        parts = [description.part for description in descriptions]
        return cls(link, parts, here=link.begin(descriptions))

    def call(self, name: str, *arguments: Any) -> list:
        """What the function `name` of each worker returns for the same arguments."""
        return self.call_each(name, lambda part: arguments)

    def call_each(self, name: str, arguments: Callable[[Part], tuple]) -> list:
        """What the function `name` of each worker returns for the arguments of its part."""
        if self.forgotten:
            keys = tuple(self.forgotten)
            self.forgotten.clear()
            self.link.call_each("forget", [(keys,)] * len(self.parts))
        return self.link.call_each(name, [arguments(part) for part in self.parts])

    def ask(self, key: Any, name: str, *arguments: Any) -> Any:
        """What the ability `name`, one of `ABILITIES`, of a term returns for the whole cloth.

        The first arguments are positions and velocities, which the workers keep; each worker
        gets its part of the others.
        """
        ability = ABILITIES[name]
        self.place(*arguments[: ability.placed])
        other_arguments = arguments[ability.placed :]

        def arguments_of(part: Part) -> tuple:
            return key, name, cut(other_arguments, part.nodes)

        shares = self.call_each("ask", arguments_of)
        return ability.gather(self.parts, shares)

    def place(self, x: np.ndarray | None = None, v: np.ndarray | None = None) -> None:
        """Give each worker positions x and velocities v (n, 3), if they have changed.

        The workers keep those of the last call; None leaves them as they are.
        """
        for name, y in (("x", x), ("v", v)):
            if y is None or np.array_equal(self.placed.get(name, np.empty(0)), y):
                continue
            self.placed[name] = y.copy()
            self.link.call_each("place", [(name, y[part.nodes]) for part in self.parts])

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
        return tuple(cut(part, nodes) for part in value)
    if isinstance(value, StepDifference):
        return replace(value, start=cut(value.start, nodes), past=cut(value.past, nodes))
    return value


OFFERED = {*ABILITIES, "add_force", "add_tangent", "over_step", "with_history"}
JOINED = {"force_calls", "supply_calls", "tangent_calls", "energy_calls"}
NOT_NEEDED = {"here", "nbytes", "stress_of", *JOINED}  # on several processes
_new_keys = count()


class RemoteTerm(BoundTerm):
    """A bound term of the whole cloth, whose functions ask all processes.

    The processes know it by its `key`. Each has the term on its part of the cloth; the one of
    this process is `local`. Raises `InputError` for a term with a function of its own that
    several processes do not offer.
    """

    def __init__(self, crew: Crew, key: Any, local: BoundTerm):
        self.crew = crew
        self.key = key
        self.local = local
        for name, value in vars(BoundTerm).items():
            if not isinstance(value, FunctionType) or name in OFFERED | NOT_NEEDED:
                continue
            # A term without a function of its own has the one of `BoundTerm`, and so has this.
            if has_own(local, name):
                allowed = "is not offered by several processes"
                raise InputError(f"{name} of {local.name}", allowed, "mpiexec", "Run on one.")

    def start_history(self, x: np.ndarray, t: float) -> Any:
        """The record of the whole cloth; raises `InputError` if it has no rows of triangles."""
        record = self.local.start_history(x[self.crew.parts[0].nodes], t)
        triangles = len(self.crew.parts[0].cells)
        if record and any(np.shape(array)[:1] != (triangles,) for array in vars(record).values()):
            allowed = "must have arrays with a row for each triangle, on several processes"
            raise InputError(f"the history of {self.name}", allowed, "mpiexec", "Run on one.")
        return record and self.crew.ask(self.key, "start_history", x, t)

    def add_stress(self, x, out) -> None:
        """Add the stress of all triangles."""
        out += self.crew.ask(self.key, "add_stress", x)

    def add_force(self, x, v, t, f) -> None:
        """Add the forces of all processes."""
        self.crew.place(x, v)
        self.crew.gather(self.crew.call("force", (self.key,), t), f)

    def add_tangent(self, x, v, t, wx, wv, J, definite) -> None:
        """Add to the matrix that the processes hold, not to J."""
        self.crew.place(x, v)
        self.crew.call("add_tangent", self.key, t, wx, wv, definite)

    def over_step(self, step: StepDifference) -> BoundTerm:
        """The term over a step, which each process keeps until the last one forgets it."""

        def share(part: Part) -> StepDifference:
            return replace(cut(step, part.nodes), history=rows(step.history, part.cells))

        if self.local.over_step(share(self.crew.parts[0])) is self.local:
            return self
        return self._new("over_step", share)

    def with_history(self, record: Any) -> BoundTerm:
        """The term with the record of the whole cloth, whose arrays have a row a triangle."""
        return self._new("with_history", lambda part: rows(record, part.cells))

    def _new(self, name: str, share: Callable[[Part], Any]) -> BoundTerm:
        """What a function of the term gives for the share of each part, kept until forgotten."""
        crew = self.crew
        new = ("step", next(_new_keys))
        crew.call_each(name, lambda part: (self.key, new, share(part)))
        term = RemoteTerm(crew, new, crew.here.terms[new])
        weakref.finalize(term, crew.forgotten.append, new)
        return term

    def here(self) -> BoundTerm:
        """The part of this process."""
        return self.local


def _on_all(name: str) -> Any:
    """One of `ABILITIES`, asked of all processes."""
    return lambda self, *arguments: self.crew.ask(self.key, name, *arguments)


_PROPERTIES = (name for name, value in vars(BoundTerm).items() if isinstance(value, property))
for _name in (*BoundTerm.__annotations__, *_PROPERTIES):  # what the term says of itself here
    setattr(RemoteTerm, _name, property(attrgetter(f"local.{_name}")))
for _name in ABILITIES.keys() - vars(RemoteTerm).keys():
    setattr(RemoteTerm, _name, _on_all(_name))
