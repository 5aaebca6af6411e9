"""The system of a part of the cloth, on the process that owns it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from fecloth.distributed.partition import Part
from fecloth.errors import InputError
from fecloth.mesh.cloth import Cloth
from fecloth.system.clamps import find_clamps
from fecloth.system.constraints import Constraints
from fecloth.system.motion import Motion
from fecloth.system.pins import Pin
from fecloth.system.state import State
from fecloth.system.system import System
from fecloth.terms.springs.springs import KnownSprings


@dataclass(frozen=True, eq=False)
class PartDescription:
    """What a process needs to make the system of its part: the arguments of `System`, cut."""

    part: Part
    fabric: Any
    terms: Sequence
    pins: Sequence[tuple[Pin, np.ndarray]]
    mass: str
    grain: Any
    start: State

    def make(self) -> PartSystem:
        """Bind the terms and pins to the part."""
        cloth = self.part.cloth()
        fabric, grain = (_regions_of(cloth, value) for value in (self.fabric, self.grain))
        pins = [_pin_of(pin, at, cloth, self.start) for pin, at in self.pins]
        return PartSystem(self.part, cloth, fabric, self.terms, pins, self.mass, grain, self.start)


class PartSystem(System):
    """A `System` of a part, in whose sums each element of the cloth counts in one part only."""

    part: ClassVar[Part]  # of each its own, no field

    def __init__(self, part: Part, cloth, fabric, terms, pins, mass, grain, start):
        object.__setattr__(self, "part", part)
        super().__init__(cloth, fabric, terms, pins, mass, grain, start, threads=1)

    @property
    def counted(self) -> Callable[[np.ndarray], np.ndarray]:
        """Which elements count in this part."""
        return self.part.counted


def cut_pins(part: Part, groups: Mapping[str, tuple[Pin, np.ndarray]]) -> list:
    """(pin, nodes) of the pins that hold nodes of the part.

    Positions come from the first process; a motion is left only where a clamp needs it.
    """
    found = []
    for pin, nodes in groups.values():
        places, local = part.restrict(nodes)
        if not len(local):
            continue
        if not pin.clamp:
            pin = replace(pin, motion=None, velocity=None, rotate=None)
        elif isinstance(pin.motion, Motion) and pin.motion.X is not None:
            pin = pin.at(pin.motion.X[places])
        found.append((pin, local))
    return found


def cut_springs(part: Part, springs: KnownSprings) -> KnownSprings:
    """The springs between two nodes of the part."""
    local = np.full(int(max(part.nodes.max(), springs.nodes.max())) + 1, -1, np.int32)
    local[part.nodes] = np.arange(len(part.nodes), dtype=np.int32)
    nodes = local[springs.nodes]
    inside = (nodes >= 0).all(axis=1)
    return replace(springs, nodes=nodes[inside], length=springs.length[inside], k=springs.k[inside])


def _pin_of(pin: Pin, nodes: np.ndarray, cloth: Cloth, start: State) -> Pin:
    """The pin on nodes of the part; a clamp is left out where no edge of it is in the part."""
    pin = replace(pin, where=nodes, name=pin.name or "pin")
    if pin.clamp:
        try:
            find_clamps(Constraints.bind([pin], cloth), cloth, start)
        except InputError:
            return replace(pin, clamp=False)
    return pin


def _regions_of(cloth: Cloth, values: Any) -> Any:
    """One value for all, or those of the regions that the part has."""
    if not isinstance(values, Mapping):
        return values
    return {name: value for name, value in values.items() if name in cloth.triangle_sets}
