"""The set-ups of the catalogue: small cloths × methods × steps × frames of the observer.

A `Setup` names a motion of `MOTIONS`, a frame of `FRAMES`, a method of `METHODS` and a step;
`build` makes the arguments of `fc.run` from it, with the step divided by `refine`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

import fecloth as fc

G = (0.0, 0.0, -9.81)


@dataclass(frozen=True)
class Frame:
    """Rigid motion that is added to a motion: velocity [m/s], spin about z [rad/s], a fall."""

    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    spin: float = 0.0
    falls: bool = False


FRAMES = {
    "rest": Frame(),
    "20 m/s": Frame((20.0, 0.0, 0.0)),
    "100 m/s": Frame((60.0, 0.0, 80.0)),
    "falling": Frame(falls=True),
    "spinning": Frame(spin=20.0),
}
METHODS: dict[str, Callable[[float], Any]] = {
    "midpoint": lambda refine: fc.ImplicitMidpoint(),
    "bdf2": lambda refine: fc.BDF2(),
    "backward_euler": lambda refine: fc.BackwardEuler(),
    "generalized_alpha": lambda refine: fc.GeneralizedAlpha(),
    "newmark": lambda refine: fc.Newmark(),
    "energy_momentum": lambda refine: fc.EnergyMomentum(),
    "linearised": lambda refine: fc.LinearlyImplicitEuler(),
    "central_difference": lambda refine: fc.CentralDifference(),
    "symplectic_euler": lambda refine: fc.SymplecticEuler(),
    "adaptive bdf2": lambda refine: fc.Adaptive(fc.BDF2(), rtol=1e-2 / refine**2),
}


@dataclass(frozen=True)
class Setup:
    """One run; `dt` is None for "adaptive" methods, which choose their steps."""

    motion: str
    method: str
    dt: float | None
    frame: str = "rest"

    @property
    def settings(self) -> dict[str, object]:
        """What a case of `fecloth.study` takes."""
        return asdict(self)


@dataclass(frozen=True)
class Run:
    """The arguments of `fc.run`."""

    system: fc.System
    method: Any
    state: fc.State
    dt: float | None
    t_end: float


def build(setup: Setup, refine: int = 1) -> Run:
    """Return the run of a set-up with the step divided by `refine`."""
    system, state, t_end = MOTIONS[setup.motion](FRAMES[setup.frame])
    dt = None if setup.dt is None else setup.dt / refine
    return Run(system, METHODS[setup.method](refine), state, dt, t_end)


# --- parts of the motions -------------------------------------------------------------------------


def _system(frame: Frame, cloth, terms: Sequence, pins: Sequence = (), **fabric) -> fc.System:
    constants = {"areal_density": 0.2, "tensile_stiffness": 500.0, "poisson_ratio": 0.2, **fabric}
    terms = [*terms, fc.Gravity(G)] if frame.falls else list(terms)
    return fc.System(cloth, fc.Fabric(**constants), terms, pins)


def _start(frame: Frame, system: fc.System, x, v=0.0) -> fc.State:
    """Return the start, seen from the frame."""
    x = np.column_stack([np.broadcast_to(part, len(system.cloth.X)) for part in x])
    r = x - x.mean(axis=0)
    turning = frame.spin * np.column_stack([-r[:, 1], r[:, 0], 0 * r[:, 0]])
    return system.state(x, np.array(frame.velocity) + turning + v)


def _pin(where, frame: Frame, motion=None) -> fc.Pin:
    """Return a pin that stays at rest in the frame, or follows `motion` there."""
    if not any(frame.velocity):
        return fc.Pin(where, motion)
    along = np.array(frame.velocity)

    def moved(t):
        return along * t + (0.0 if motion is None else np.asarray(motion(t)))

    return fc.Pin(where, moved)


def _sheet(width=1.0, height=0.6, h=0.1, **options):
    return fc.Cloth.rectangle(width, height, h=h, **options)


def _plane(cloth):
    return cloth.X[:, 0], cloth.X[:, 1]


# --- motions: frame → system, start, t_end --------------------------------------------------------


def released(frame: Frame, bending: float | None = None):
    """Stretched by 5 %, waved by 5 cm, then let go (D1)."""
    cloth = _sheet()
    X, Y = _plane(cloth)
    if bending is None:
        system = _system(frame, cloth, [fc.StVK()])
    else:
        system = _system(frame, cloth, [fc.StVK(), fc.HingeBending()], bending_rigidity=bending)
    return system, _start(frame, system, (1.05 * X, Y, 0.05 * np.sin(9 * X))), 0.3


def breathing(frame: Frame, strain: float = 0.02):
    """Stretched in its plane and let go."""
    cloth = _sheet()
    X, Y = _plane(cloth)
    system = _system(frame, cloth, [fc.StVK()])
    return system, _start(frame, system, ((1 + strain) * X, (1 + strain) * Y, 0.0)), 0.05


def bent(frame: Frame):
    """A stiff sheet, bent and let go."""
    cloth = _sheet()
    X, _ = _plane(cloth)
    terms = [fc.StVK(), fc.HingeBending(), fc.StrainRateDamping(time=0.005)]
    system = _system(frame, cloth, terms, bending_rigidity=0.02)
    x = X, cloth.X[:, 1], 0.04 * (X - 0.5) ** 2
    return system, _start(frame, system, x), 0.4


def drum(frame: Frame, term: Any = None, element: str = "P1"):
    """Taut, struck in the middle (D5)."""
    cloth = _sheet(h=0.1 if element == "P1" else 0.14, element=element)
    X, Y = _plane(cloth)
    system = _system(frame, cloth, [term or fc.StVK()], [_pin("boundary", frame)])
    v = np.zeros((len(X), 3))
    v[:, 2] = np.sin(np.pi * X) * np.sin(np.pi * Y / 0.6)
    return system, _start(frame, system, (1.02 * X, 1.02 * Y, 0.0), v), 0.3


def spring_drum(frame: Frame):
    """The drum as a network of springs."""
    return drum(frame, fc.Springs())


def p2_drum(frame: Frame):
    """The drum on triangles of order two."""
    return drum(frame, element="P2")


def rubber_drum(frame: Frame):
    """The drum of a neo-Hookean membrane."""
    return drum(frame, fc.NeoHookean("compressible"))


def swing(frame: Frame):
    """A damped sheet, let go from the horizontal, held at one side."""
    cloth = _sheet(0.5, 0.5, 0.08)
    terms = [fc.StVK(), fc.HingeBending(), fc.StrainRateDamping(time=0.005), fc.Gravity(G)]
    system = _system(frame, cloth, terms, [_pin("left", frame)], bending_rigidity=1e-5)
    return system, _start(frame, system, (*_plane(cloth), 0.0)), 0.4


def hanging(frame: Frame):
    """A sheet that hangs from its top, its weight switched on: waves along it."""
    cloth = _sheet(0.5, 0.5, 0.08)
    X, Y = _plane(cloth)
    system = _system(frame, cloth, [fc.StVK(), fc.Gravity(G)], [_pin("top", frame)])
    return system, _start(frame, system, (X, 0.0, Y)), 0.3


def cantilever(frame: Frame):
    """A strip clamped by two rows of nodes, bent by its weight."""
    cloth = _sheet(0.3, 0.1, 0.025, pattern="right")
    X, Y = _plane(cloth)
    terms = [fc.StVK(), fc.HingeBending(), fc.Gravity(G)]
    clamp = _pin(lambda X: X[:, 0] < 0.026, frame)
    system = _system(frame, cloth, terms, [clamp], bending_rigidity=5e-3)
    return system, _start(frame, system, (X, Y, 0.0)), 0.4


def flag(frame: Frame):
    """A flag in a breeze, with damping."""
    cloth = _sheet()
    X, Y = _plane(cloth)
    wind = fc.Wind((4.0, 1.0, 0.0), normal=0.7, tangential=0.01)
    damping = fc.StrainRateDamping(time=0.01)
    terms = [fc.StVK(), fc.HingeBending(), damping, fc.Gravity(G), wind]
    system = _system(frame, cloth, terms, ["left"], bending_rigidity=1e-4)
    return system, _start(frame, system, (X, 0.02 * np.sin(4 * X), Y)), 0.3


def curtain(frame: Frame, h: float = 0.12):
    """The curtain of A2: hung at rings, wind of 20 km/h, a stiff fabric with damping."""
    cloth = fc.Cloth.rectangle(1.2, 1.5, h=h)
    X, Y = _plane(cloth)
    wind = fc.Wind((0.0, 20 / 3.6, 0.0), normal=1.2, tangential=0.01)
    damping = fc.StrainRateDamping(time=0.01)
    terms = [fc.StVK(), fc.HingeBending(), fc.Gravity(G), wind, damping]
    pin = fc.Pin(lambda X: (X[:, 1] > 1.499) & (abs(X[:, 0] - 0.2 * np.round(5 * X[:, 0])) < 0.05))
    system = fc.System(cloth, fc.Fabric.preset("polyester-tablecloth"), terms, [pin])
    return system, _start(frame, system, (X, 0.0, Y)), 0.5


def leaf(frame: Frame):
    """A stiff sheet that falls in air."""
    cloth = _sheet(0.4, 0.3, 0.06)
    X, Y = _plane(cloth)
    air = fc.Drag(normal=0.7, tangential=0.01)
    terms = [fc.StVK(), fc.HingeBending(), fc.StrainRateDamping(time=0.005), fc.Gravity(G), air]
    system = _system(frame, cloth, terms, bending_rigidity=0.005)
    return system, _start(frame, system, (X, Y, 0.3 * X**2)), 0.4


def inflated(frame: Frame, p="200 * (1 - exp(-t / 0.03))", element: str = "P1"):
    """A taut sheet under a pressure."""
    cloth = _sheet(h=0.1 if element == "P1" else 0.14, element=element)
    X, Y = _plane(cloth)
    terms = [fc.StVK(), fc.Pressure(p)]
    system = _system(frame, cloth, terms, [_pin("boundary", frame)])
    return system, _start(frame, system, (1.01 * X, 1.01 * Y, 0.0)), 0.3


def p2_inflated(frame: Frame):
    """The same with a step of pressure on triangles of order two (D5)."""
    return inflated(frame, 200.0, "P2")


def pulse(frame: Frame, height: float = 3000.0, width: float = 0.001):
    """A flat flag, hit by a short pulse of pressure (D16)."""
    cloth = _sheet()
    X, Y = _plane(cloth)
    terms = [fc.StVK(), fc.Pressure(f"{height}*exp(-((t-0.1)/{width})**2)")]
    system = _system(frame, cloth, terms, [_pin("left", frame)])
    return system, _start(frame, system, (X, Y, 0.0)), 0.15


def slow_pulse(frame: Frame):
    """A longer pulse."""
    return pulse(frame, 100.0, 0.02)


def magnet(frame: Frame, rate: str = "1e3"):
    """A force towards z = 0 by a formula (D5)."""
    cloth = _sheet()
    X, Y = _plane(cloth)
    terms = [fc.StVK(), fc.UserForce((0, 0, f"-{rate} * z"))]
    system = _system(frame, cloth, terms, ["left"])
    return system, _start(frame, system, (X, Y, 0.05 * np.sin(2 * X))), 0.1


def stiff_magnet(frame: Frame):
    """The stiff force of D5."""
    return magnet(frame, "1e5")


def poked(frame: Frame):
    """A damped, taut sheet that a point force draws."""
    cloth = _sheet(h=0.12)
    X, Y = _plane(cloth)
    poke = fc.PointForce((0.5, 0.3), (0.0, 0.0, "5 * sin(20 * t)"))
    terms = [fc.StVK(), fc.StrainRateDamping(time=0.003), poke]
    system = _system(frame, cloth, terms, [_pin("boundary", frame)])
    return system, _start(frame, system, (1.02 * X, 1.02 * Y, 0.0)), 0.3


def shaken(frame: Frame, motion=None, terms: Sequence = ()):
    """A sheet with some bending whose left side moves up and down."""
    cloth = _sheet()
    X, Y = _plane(cloth)
    motion = motion or (lambda t: (0.0, 0.0, 0.05 * np.sin(15 * t) ** 2))
    pins = [_pin("left", frame, motion)]
    terms = [fc.StVK(), fc.HingeBending(), *terms]
    system = _system(frame, cloth, terms, pins, bending_rigidity=1e-5)
    return system, _start(frame, system, (X, Y, 0.01 * np.sin(4 * X))), 0.3


def jump(frame: Frame):
    """A pin that jumps by 10 cm (D2)."""
    return shaken(frame, lambda t: (0.0, 0.0, 0.0 if t < 0.1 else 0.1))


def stairs(frame: Frame):
    """A pin that jumps by 10 cm each 0.1 s (D2)."""
    return shaken(frame, lambda t: (0.0, 0.0, 0.1 * np.floor(t / 0.1)))


def sign_jump(frame: Frame):
    """A pin that jumps by 4 cm (D2)."""
    return shaken(frame, lambda t: (0.0, 0.0, 0.02 * np.sign(t - 0.2)))


def damped_jump(frame: Frame):
    """A jump, with damping."""
    damping = fc.StrainRateDamping(time=0.01)
    return shaken(frame, lambda t: (0.0, 0.0, 0.0 if t < 0.1 else 0.02), [damping])


MOTIONS: dict[str, Callable[[Frame], tuple[fc.System, fc.State, float]]] = {
    function.__name__: function
    for function in (
        *(released, breathing, bent, drum, spring_drum, p2_drum, rubber_drum, swing, hanging),
        *(cantilever, flag, curtain, leaf, inflated, p2_inflated, pulse, slow_pulse, magnet),
        *(stiff_magnet, poked, shaken, jump, stairs, sign_jump, damped_jump),
    )
}


# --- the catalogue --------------------------------------------------------------------------------


def _grid(motion: str, methods: dict[str, Sequence[float | None]], frames=("rest",)) -> list[Setup]:
    return [
        Setup(motion, method, dt, frame)
        for frame in frames
        for method, steps in methods.items()
        for dt in steps
    ]


FREE = ("rest", "20 m/s", "100 m/s", "falling", "spinning")
MOVED = ("rest", "20 m/s", "100 m/s")

SETUPS: tuple[Setup, ...] = (
    *_grid("breathing", {"midpoint": [2.5e-4, 4e-3], "bdf2": [5e-3]}, FREE),
    *_grid("bent", {"midpoint": [0.002, 0.02], "backward_euler": [0.01]}, FREE),
    *_grid("drum", {"bdf2": [0.02], "midpoint": [0.02, 0.002]}, MOVED),
    *_grid("swing", {"bdf2": [0.02, 0.002], "backward_euler": [0.01]}, MOVED),
    *_grid("drum", {"backward_euler": [0.01], "linearised": [0.01], "bdf2": [0.001]}),
    *_grid("drum", {"generalized_alpha": [0.02, 0.001], "energy_momentum": [0.02, 0.002]}),
    *_grid("drum", {"newmark": [0.02, 0.002], "central_difference": [5e-4]}),
    *_grid("drum", {"symplectic_euler": [5e-4], "adaptive bdf2": [None]}),
    *_grid("spring_drum", {"bdf2": [0.02], "energy_momentum": [0.002]}),
    *_grid("p2_drum", {"bdf2": [0.02], "midpoint": [0.002]}),
    *_grid("rubber_drum", {"bdf2": [0.02], "midpoint": [0.002]}),
    *_grid("hanging", {"midpoint": [0.001], "bdf2": [0.02]}),
    *_grid("cantilever", {"bdf2": [0.002, 0.02], "generalized_alpha": [0.002]}),
    *_grid("leaf", {"bdf2": [0.002, 0.02], "midpoint": [0.002]}),
    *_grid("inflated", {"bdf2": [0.01, 0.001], "midpoint": [0.002]}),
    *_grid("slow_pulse", {"bdf2": [0.001], "midpoint": [0.001]}),
    *_grid("magnet", {"midpoint": [0.001, 0.02], "bdf2": [5e-4]}),
    *_grid("stiff_magnet", {"midpoint": [0.005]}),
    *_grid("poked", {"bdf2": [0.01, 0.002], "generalized_alpha": [0.002]}),
    *_grid("shaken", {"bdf2": [0.01], "midpoint": [0.002]}, ("rest", "100 m/s")),
    *_grid("damped_jump", {"bdf2": [0.005], "midpoint": [0.002]}),
    *_grid("jump", {"bdf2": [0.005], "backward_euler": [0.005], "generalized_alpha": [0.005]}),
    *_grid("stairs", {"bdf2": [0.005]}),
    *_grid("sign_jump", {"bdf2": [0.005]}),
    *_grid("flag", {"bdf2": [0.002, 0.01]}),
    *_grid("curtain", {"bdf2": [0.005]}),
    *_grid("p2_inflated", {"bdf2": [0.005]}),
    *_grid("released", {"midpoint": [0.005]}, FREE),
    *_grid("released", {"bdf2": [0.02]}, ("rest", "100 m/s")),
    *_grid("pulse", {"adaptive bdf2": [None], "central_difference": [1e-4]}),
)
