"""A term of the whole cloth as the first process sees it, whose loops run on all processes."""

from __future__ import annotations

import weakref
from itertools import count
from types import FunctionType
from typing import Any

from fecloth.distributed.crew import Crew, cut
from fecloth.distributed.worker import ABILITIES
from fecloth.errors import InputError
from fecloth.terms.protocol import BoundTerm, has_own
from fecloth.terms.step_difference import StepDifference

OFFERED = {*ABILITIES, "add_force", "add_tangent", "over_step"}
NOT_NEEDED = {"here", "nbytes", "force_calls"}  # on several processes
_new_keys = count()


def _on_all(name: str) -> Any:
    """One of `ABILITIES`, asked of all processes."""
    return lambda self, *arguments: self.crew.ask(self.key, name, *arguments)


def _as_here(name: str) -> Any:
    """What the term says of itself on this process."""
    return property(lambda self: getattr(self.near, name))


class RemoteTerm(BoundTerm):
    """A bound term of the whole cloth; each process has it bound to a part.

    Parameters
    ----------
    crew, key
        The processes, and the name of the term there.
    near
        The term as it is bound to the part of this process.
    """

    def __init__(self, crew: Crew, key: Any, near: BoundTerm):
        self.crew, self.key, self.near = crew, key, near
        own = (name for name, each in vars(BoundTerm).items() if isinstance(each, FunctionType))
        for name in own:
            if name not in OFFERED | NOT_NEEDED and has_own(near, name):
                allowed = "is not offered by several processes"
                raise InputError(f"{name} of {near.name}", allowed, "mpiexec", "Run on one.")

    name, symmetric, load = map(_as_here, ("name", "symmetric", "load"))
    has_energy, dissipative = map(_as_here, ("has_energy", "dissipative"))
    velocity_dependent, stores_strain = map(_as_here, ("velocity_dependent", "stores_strain"))
    no_equilibrium, needs_end = map(_as_here, ("no_equilibrium", "needs_end"))
    needs_difference, steady_air = map(_as_here, ("needs_difference", "steady_air"))
    supplies, has_stress = map(_as_here, ("supplies", "has_stress"))
    recovers_strain, objective = map(_as_here, ("recovers_strain", "objective"))
    dissipates_over_step, conserves = map(_as_here, ("dissipates_over_step", "conserves"))

    energy, power, supply = map(_on_all, ("energy", "power", "supply"))
    dissipation, work_of_clamps = map(_on_all, ("dissipation", "work_of_clamps"))
    rate_bounds, strain_error = map(_on_all, ("rate_bounds", "strain_error"))

    def add_stress(self, x, out) -> None:
        """Out += the stress of all triangles."""
        out += self.crew.ask(self.key, "add_stress", x)

    def add_force(self, x, v, t, f) -> None:
        """f += the force [N]."""
        self.crew.place(x, v)
        self.crew.gather(self.crew.call("force", (self.key,), t), f)

    def add_tangent(self, x, v, t, wx, wv, J, definite) -> None:
        """Add to the matrix that the processes hold, not to J."""
        self.crew.place(x, v)
        self.crew.call("add_tangent", self.key, t, wx, wv, definite)

    def over_step(self, step: StepDifference) -> BoundTerm:
        """The term over a step, which each process keeps until the last one forgets it."""
        crew = self.crew
        if self.near.over_step(cut(step, crew.parts[0].nodes)) is self.near:
            return self
        new = "step", next(_new_keys)
        crew.each("over_step", lambda part: (self.key, new, cut(step, part.nodes)))
        over = RemoteTerm(crew, new, crew.here.terms[new])
        weakref.finalize(over, crew.forgotten.append, new)
        return over

    def here(self) -> BoundTerm:
        """The term as it is bound to the part of this process."""
        return self.near
