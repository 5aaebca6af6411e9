"""Cloths of a few triangles whose uncertainty `studies.budget` adds up.

The argument `extra` is the part of a law that a model without it lacks: a second membrane, or a
pressure.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

import fecloth as fc
from fecloth import study

DENSITY, WIDTH = 0.2, 0.25
Returned = tuple[fc.Cloth, fc.System, Any, fc.State]


@dataclass(frozen=True)
class Specimen:
    """A function of h, its quantity, its numbers, and how much `extra` begins a search."""

    name: str
    problem: Callable[..., Returned]
    quantity: Any
    numbers: Mapping[str, float]
    extra: float = 1.0
    sizes: Mapping[str, Any] = field(default_factory=dict)  # dt and t_end of a motion
    h: float = 0.25

    def open(self, **numbers: Any) -> Any:
        """Return the study of the problem with these numbers."""
        probes = [fc.Probe("tip", "right"), fc.Probe("middle", point=(0.5, WIDTH / 2))]
        given: dict[str, Any] = (
            {"probes": probes, "h": self.h} | dict(self.sizes) | dict(self.numbers) | numbers
        )
        opened = study.of(self.problem, **given)
        return replace(opened, given=replace(opened.given, quiet=True))


def strip(h: float, element: str, pattern: str, width: float = WIDTH) -> fc.Cloth:
    return fc.Cloth.rectangle(1.0, width, h, pattern=pattern, element=element)


def extension(result: Any) -> float:
    """How much longer a strip became in the mean [m]."""
    return 2 * (float(result.state.x[:, 0].mean()) - 0.5)


def membranes(extra: float) -> list:
    return [fc.StVK(), *([fc.TensorCondition(extra)] if extra else [])]


def hang(h, stiffness=20.0, density=DENSITY, g=9.81, extra=0.0, element="P1", pattern="right"):
    """A strip that its weight stretches."""
    cloth = strip(h, element, pattern)
    terms = [*membranes(extra), fc.Gravity((g, 0, 0))]
    system = fc.System(cloth, fc.Fabric(density, stiffness, 0.2), terms, ["left"])
    return cloth, system, None, system.rest()


def pull(h, stiffness=1000.0, drawn=0.05, poisson=0.3, extra=0.0, element="P1", pattern="right"):
    """A strip between two grips."""
    cloth = strip(h, element, pattern)
    fabric = fc.Fabric(DENSITY, stiffness, poisson)
    system = fc.System(cloth, fabric, membranes(extra), ["left", "right"])
    return cloth, system, None, system.state(system.rest().x * [1.0 + drawn, 1.0, 1.0])


def bend(h, B=1e-3, density=DENSITY, g=0.03, extra=0.0, element="P1", pattern="right"):
    """A strip clamped at an end, that its weight bends."""
    cloth = strip(h, element, pattern)
    fabric = fc.Fabric(density, 100.0, 0.0, bending_rigidity=B)
    terms = [fc.StVK(), fc.PlateBending(), fc.Gravity((0, 0, -g))]
    terms += [fc.Pressure(-extra)] if extra else []
    system = fc.System(cloth, fabric, terms, [fc.Pin("left", clamp=True)])
    return cloth, system, None, system.rest()


def blow(h, stiffness=1000.0, pressure=20.0, drawn=0.01, extra=0.0, element="P1", pattern="right"):
    """A taut sheet under pressure."""
    cloth = strip(h, element, pattern, 1.0)
    fabric = fc.Fabric(DENSITY, stiffness, 0.3)
    system = fc.System(cloth, fabric, [*membranes(extra), fc.Pressure(pressure)], ["boundary"])
    x = system.rest().x * (1.0 + drawn)
    return cloth, system, None, system.state(x)


def swing(h, dt, stiffness=100.0, density=DENSITY, extra=0.0, element="P1", pattern="right"):
    """A taut string that swings."""
    cloth = strip(h, element, pattern)
    system = fc.System(cloth, fc.Fabric(density, stiffness), membranes(extra), ["left", "right"])
    x = system.rest().x * [1.1, 1.0, 1.0]
    v = np.zeros_like(x)
    v[:, 2] = np.sin(np.pi * cloth.X[:, 0])
    return cloth, system, fc.ImplicitMidpoint(), system.state(x, v)


def ring(
    h, stiffness=1000.0, density=DENSITY, drawn=0.02, extra=0.0, element="P1", pattern="right"
):
    """A taut sheet, for its lowest frequency."""
    cloth = strip(h, element, pattern, 1.0)
    fabric = fc.Fabric(density, 1000.0, 0.3)
    system = fc.System(cloth, fabric, membranes(extra), ["boundary"])
    return cloth, system, None, system.state(system.rest().x * (1.0 + drawn))


def press(h, drawn=0.0, B=1e-3):
    """A strip between two grips, neither taut nor slack: it buckles where they come closer."""
    cloth = strip(h, "P1", "right")
    fabric = fc.Fabric(DENSITY, 100.0, 0.0, bending_rigidity=B)
    system = fc.System(cloth, fabric, [fc.StVK(), fc.PlateBending()], ["left", "right"])
    x = system.rest().x * [1.0 + drawn, 1.0, 1.0]
    x[:, 2] = 1e-3 * np.sin(np.pi * cloth.X[:, 0])
    return cloth, system, None, system.state(x)


def stand(h, B=0.03, density=DENSITY, g=1.0):
    """A strip that stands, clamped below; from ρ g L³/B = 7.84 on it folds over."""
    cloth = strip(h, "P1", "right")
    fabric = fc.Fabric(density, 1000.0, 0.0, bending_rigidity=B)
    terms = [fc.StVK(), fc.PlateBending(), fc.Gravity((-g, 0, 0))]
    system = fc.System(cloth, fabric, terms, [fc.Pin("left", clamp=True)])
    x = system.rest().x
    x[:, 2] = 1e-3 * cloth.X[:, 0] ** 2
    return cloth, system, None, system.state(x)


SMOOTH = [
    Specimen("hang", hang, extension, {"stiffness": 20.0, "density": DENSITY}, 1.0),
    Specimen("pull", pull, "reaction.right.x", {"stiffness": 1000.0, "drawn": 0.05}, 50.0),
    Specimen("bend", bend, "tip.z", {"B": 1e-3, "density": DENSITY}, 1e-3),
    Specimen("blow", blow, "volume", {"stiffness": 1000.0, "pressure": 20.0}, 50.0),
    Specimen(
        "swing", swing, "middle.z", {"stiffness": 100.0, "density": DENSITY}, 5.0,
        {"dt": 0.01, "t_end": 0.1},
    ),
    Specimen("ring", ring, "frequency(1)", {"density": DENSITY, "drawn": 0.02}, 50.0),
]  # fmt: skip
ROUGH: list[tuple[Specimen, dict[str, Any]]] = [
    (Specimen("press", press, "reaction.right.x", {}), {"drawn": 0.005}),
    (Specimen("stand", stand, extension, {"B": 0.027}), {"B": "20 %"}),
]
