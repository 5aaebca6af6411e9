"""The four scenes of the work-precision study."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

import fecloth as fc
from studies.models.homogenised_moduli import NU, Y

SAMPLES = 40  # times at which the paths are compared
MEMBRANES = {
    "StVK": fc.StVK(),
    "NeoHookean": fc.NeoHookean(),
    "TensorCondition": fc.TensorCondition(Y / 4),
    "BaraffWitkin": fc.BaraffWitkin(),
    "Springs": fc.Springs(),
}
BENDING = {
    "hinges": fc.HingeBending(),
    "quadratic": fc.QuadraticBending(),
    "plate": fc.PlateBending(),
}
TRAMPOLINE = fc.Fabric(areal_density=0.2, tensile_stiffness=Y, poisson_ratio=NU)
STRIP = fc.Fabric(areal_density=0.2, tensile_stiffness=1000.0)
PAPER = fc.Fabric(areal_density=0.08, tensile_stiffness=2000.0, bending_rigidity=1e-3)
AMPLITUDE, LENGTH, SWING, PULL, RAMP = 1e-4, 1.0, 0.3, 0.05, 0.1  # m, m, m, m, s


class Counted(fc.System):
    """A system that counts its force evaluations."""

    def __init__(self, *arguments, **keywords):
        object.__setattr__(self, "calls", [0])
        super().__init__(*arguments, **keywords)

    def force(self, state):
        self.calls[0] += 1
        return super().force(state)


@dataclass(frozen=True, eq=False)
class Scene:
    """A problem: system, start, end, and the two paths to compare.

    Attributes
    ----------
    rows
        (2, n) weights of the mean and of a point.
    component
        Component of the displacement, and its sign.
    """

    system: fc.System
    state: fc.State
    t_end: float
    rows: np.ndarray
    component: tuple[int, float] = (2, -1.0)
    options: dict = field(default_factory=dict)

    def values_of(self, values: np.ndarray) -> np.ndarray:
        """Return the mean and the point value (2,) of a nodal field (n, 3)."""
        axis, sign = self.component
        return sign * (self.rows @ values[:, axis])

    @property
    def times(self) -> np.ndarray:
        """Times at which paths are compared [s]."""
        return np.linspace(0.0, self.t_end, SAMPLES + 1)[1:]


# --- the scenes -----------------------------------------------------------------------------------


def trampoline(model: str, element: str, h: float) -> Scene:
    """Return a horizontal disk clamped at its rim, which falls: mean deflection and centre."""
    cloth = fc.Cloth.disk(0.5, h=h, element=element)
    system = Counted(cloth, TRAMPOLINE, [MEMBRANES[model], fc.Gravity()], ["boundary"])
    return Scene(system, system.rest(), 0.2, weights(system, (0.0, 0.0)))


def wave(model: str, element: str, h: float) -> Scene:
    """Return a strip pinned at X = 0 and released from a quarter sine, for two periods."""
    cloth = fc.Cloth.rectangle(LENGTH, 0.25, h=h, element=element)
    system = Counted(cloth, STRIP, [MEMBRANES[model]], ["left", in_plane(cloth, "left")])
    x = system.rest().x
    x[:, 0] += AMPLITUDE * np.sin(0.5 * np.pi * cloth.X[:, 0] / LENGTH)
    period = 4 * LENGTH * np.sqrt(0.2 / 1000.0)
    return Scene(system, system.state(x), 2 * period, weights(system, (LENGTH, 0.125)), (0, 1.0))


def swing(model: str, element: str, h: float) -> Scene:
    """Return a horizontal strip of paper, hinged at an edge, which falls: mean and free edge."""
    membrane, _, bending = model.partition(" + ")
    terms = [MEMBRANES[membrane], *([BENDING[bending]] if bending else []), fc.Gravity()]
    cloth = fc.Cloth.rectangle(SWING, 0.1, h=h, pattern="right", element=element)
    system = Counted(cloth, PAPER, terms, ["left"])
    return Scene(system, system.rest(), 0.3, weights(system, (SWING, 0.05)))


def stretch(model: str, element: str, h: float) -> Scene:
    """Return a plane strip between clamps that pull it by a tenth, until it rests.

    The paths are its narrowing: the mean over both halves, and the middle of the free edge.
    """
    cloth = fc.Cloth.rectangle(0.5, 0.5, h=h, element=element)
    terms = [MEMBRANES[model], fc.MassDamping(60.0)]
    pins = ["left", fc.Pin("right", clamp_shift, clamp_velocity), in_plane(cloth, "left", "right")]
    system = Counted(cloth, TRAMPOLINE, terms, pins)
    upper = weights(system, (0.25, 0.5))
    upper[0] *= np.sign(cloth.X[:, 1] - 0.25)
    return Scene(system, system.rest(), 0.5, upper, (1, -1.0))


SCENES = {"trampoline": trampoline, "wave": wave, "swing": swing, "stretch": stretch}


def clamp_shift(t: float) -> np.ndarray:
    """Return the shift of the right clamp, a smooth ramp to PULL [m]."""
    s = min(t / RAMP, 1.0)
    return np.array([PULL * s * s * (3 - 2 * s), 0.0, 0.0])


def clamp_velocity(t: float) -> np.ndarray:
    """Return the velocity of the right clamp [m/s]."""
    s = min(t / RAMP, 1.0)
    return np.array([PULL * 6 * s * (1 - s) / RAMP, 0.0, 0.0])


def in_plane(cloth: fc.Cloth, *pinned: str) -> fc.Slide:
    """Constrain all nodes but the pinned sets to the plane."""
    rest = np.setdiff1d(np.arange(len(cloth.X)), np.concatenate([cloth.nodes(n) for n in pinned]))
    return fc.Slide(rest, normal=(0.0, 0.0, 1.0))


def weights(system: fc.System, point: tuple[float, float]) -> np.ndarray:
    """Return (2, n): weights of the mean by mass, and of a material point."""
    at = fc.Probe("point", point=point).weights(system.cloth).toarray()
    return np.vstack([system.nodal_mass / system.nodal_mass.sum(), at])
