"""Set-ups drawn by a seed: terms × methods × steps × frames × loads that switch × wind × pins.

`draw` makes a `Drawn` set-up from a seed and a number; `Drawn.build` makes the arguments of
`fc.run` from it, with the step divided by `refine`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

import fecloth as fc
from studies.evidence.trust.setups import FRAMES, METHODS, Run

G = (0.0, 0.0, -9.81)
MEMBRANES = {
    "StVK": fc.StVK,
    "NeoHookean": lambda: fc.NeoHookean("compressible"),
    "TensionField": fc.TensionField,
    "BiquadraticSprings": lambda: fc.Springs("biquadratic"),
}
EXPLICIT = ("central_difference", "symplectic_euler")
FIRST_ORDER = ("backward_euler", "linearised", "symplectic_euler")  # refined by a better method
TRIANGLES, P2_TRIANGLES = (50, 200), (30, 80)
STEPS, EXPLICIT_STEPS = (25, 90), (60, 400)
DT = 1e-3, 2e-2  # of implicit steps [s]
STIFFNESS = 50.0, 5e4  # in tension [N/m]
RUBBING = ("bdf2", "backward_euler")  # with friction in bending
TOUCHING = ("bdf2", "backward_euler")  # with a plane below
FLOOR_GAP = 1e-3  # of the plane [m]


@dataclass(frozen=True, eq=False)
class Drawn:
    """A set-up that was drawn."""

    size: tuple[float, float]  # of the cloth [m]
    h: float
    pattern: str
    element: str
    pieces: int
    fabric: fc.Fabric
    terms: tuple[Any, ...]
    pins: tuple[fc.Pin, ...]
    stretch: float  # of the start
    wave: float  # amplitude of the start's wave [m]
    speed: float  # of the start, at the middle of the cloth [m/s]
    frame: str
    method: str
    dt: float  # of explicit methods over the stable one
    steps: int

    def build(self, refine: int = 1) -> Run:
        """Return the run with the step divided by `refine`."""
        system = fc.System(self._cloth(), self.fabric, self.terms, self.pins)
        state, dt = self._start(system), self.dt
        if self.method in EXPLICIT:
            dt *= fc.critical_dt(system, state, METHODS[self.method](1))
        name = self.method
        if refine > 1 and name in FIRST_ORDER:
            name = "central_difference" if name in EXPLICIT else "bdf2"
        return Run(system, METHODS[name](refine), state, dt / refine, self.steps * dt)

    def _cloth(self) -> fc.Cloth:
        sheet = fc.Cloth.rectangle(*self.size, h=self.h, pattern=self.pattern, element=self.element)
        names = [f"piece{number}" for number in range(self.pieces)]
        return sheet if self.pieces == 1 else fc.Cloth.join([sheet] * self.pieces, names)

    def _start(self, system: fc.System) -> fc.State:
        """Return a stretched and waved sheet; pieces lie above each other and fly apart."""
        X, Y = system.cloth.X.T
        number = np.arange(len(X)) * self.pieces // len(X)  # of the piece of each node
        width, height = self.size
        bump = np.sin(np.pi * X / width) * np.sin(np.pi * Y / height)
        z = self.wave * np.sin(9 * X / width + 2 * Y / height) + 0.1 * number
        x = np.column_stack([self.stretch * X, self.stretch * Y, z])
        r, frame = x - x.mean(axis=0), FRAMES[self.frame]
        v = frame.spin * np.column_stack([-r[:, 1], r[:, 0], 0 * z]) + np.array(frame.velocity)
        v[:, 2] += self.speed * (bump + number)
        return system.state(x, v)

    @property
    def words(self) -> str:
        """What was drawn, for a table."""
        names = [repr(term) for term in self.terms]
        held = [f"{pin.where}{' clamped' if pin.clamp else ''}" for pin in self.pins] or ["free"]
        frame = [] if self.frame == "rest" else [self.frame]
        pieces = ["two pieces"] if self.pieces == 2 else []
        mesh = f"{self.element} {self.pattern}"
        return ", ".join([mesh, *pieces, *names, *held, *frame])


def draw(seed: int, number: int) -> Drawn:
    """Return one set-up of a seed.

    Examples
    --------
    >>> draw(1, 3).words == draw(1, 3).words != draw(2, 3).words
    True
    """
    rng = np.random.default_rng([seed, number])
    element = _pick(rng, {"P1": 1, "P2": 1})
    pieces = _pick(rng, {1: 12, 2: 1})
    size = _log(rng, 0.2, 1.0), _log(rng, 0.2, 1.0)
    triangles = _log(rng, *(TRIANGLES if element == "P1" else P2_TRIANGLES)) / pieces
    pattern = _pick(rng, {"right": 1, "cross": 1, "unstructured": 1})
    h = _edge(pattern, size, triangles)
    method = _pick(rng, {"midpoint": 4, "bdf2": 4, "backward_euler": 2, "generalized_alpha": 2,
                         "newmark": 1, "energy_momentum": 1, "linearised": 1,
                         "central_difference": 3, "symplectic_euler": 1})  # fmt: skip
    explicit = method in EXPLICIT
    steps = int(_log(rng, *(EXPLICIT_STEPS if explicit else STEPS)))
    dt = rng.uniform(0.2, 0.9) if explicit else _log(rng, *DT)
    clamped = bool(rng.uniform() < 0.3) and not explicit
    membrane = _pick(rng, {"StVK": 6, "NeoHookean": 1, "TensionField": 1, "BiquadraticSprings": 1})
    if element == "P2" or pattern == "unstructured":
        membrane = "StVK" if membrane == "BiquadraticSprings" else membrane
    if element == "P2":
        explicit_p2 = {"central_difference": "midpoint", "symplectic_euler": "bdf2"}
        dt = _log(rng, *DT) if explicit else dt
        steps, method = min(steps, STEPS[1]), explicit_p2.get(method, method)
    bending = _pick(rng, {"": 1, "HingeBending": 2, "PlateBending": 2})
    bending = "PlateBending" if clamped or (bending and element == "P2") else bending
    seconds = steps * (5e-4 if method in EXPLICIT else dt)
    terms = [MEMBRANES[membrane](), *([getattr(fc, bending)()] if bending else [])]
    terms += _dampings(rng, method)
    rubs = bending == "PlateBending" and method in RUBBING and rng.uniform() < 0.3
    if rubs:
        terms.append(fc.BendingFriction())
    if element == "P2" or method == "energy_momentum":
        terms += _loads(rng, size, seconds, conservative=True)
    else:
        terms += _loads(rng, size, seconds)
    pins = _pins(rng, pieces, clamped, size, seconds)
    frame = (
        "rest"
        if pins
        else _pick(rng, {name: 3 if name == "rest" else 1 for name in FRAMES if name != "100 m/s"})
    )
    if FRAMES[frame].falls and not any(isinstance(term, fc.Gravity) for term in terms):
        terms.append(fc.Gravity(G))
    fabric = fc.Fabric(
        _log(rng, 0.08, 0.5), _log(rng, *STIFFNESS), rng.uniform(0, 0.4),
        bending_rigidity=_log(rng, 1e-6, 5e-3), bending_hysteresis=_log(rng, 1e-5, 1e-2),
    )  # fmt: skip
    stretch = _pick(rng, {1.0: 2, 1.0 + _log(rng, 1e-4, 0.05): 1})
    wave = _pick(rng, {0.0: 1, _log(rng, 1e-3, 0.05): 1})
    speed = _pick(rng, {0.0: 2, _log(rng, 0.03, 2.0): 1})
    falls_on = method in TOUCHING and frame == "rest" and not rubs
    if falls_on and rng.uniform() < 0.4:
        terms.append(_floor(rng, wave))
    return Drawn(
        size, h, pattern, element, pieces, fabric, tuple(terms), tuple(pins), stretch, wave, speed,
        frame, method, dt, steps,
    )  # fmt: skip


def _dampings(rng, method: str) -> list:
    kind = _pick(rng, {"": 2, "strain": 3, "mass": 1})
    if kind == "strain":
        return [
            fc.StrainRateDamping(_log(rng, *((1e-4, 1e-3) if method in EXPLICIT else (1e-3, 2e-2))))
        ]
    return [fc.MassDamping(_log(rng, 0.3, 10.0))] if kind else []


def _loads(rng, size, seconds: float, conservative: bool = False) -> list:
    """Return gravity and one more load, which may switch on or off, or blow."""
    loads = [fc.Gravity(G)] if rng.uniform() < 0.6 else []
    begin, end = (
        round(seconds * share, 5) for share in (rng.uniform(0.1, 0.5), rng.uniform(0.55, 0.9))
    )
    kinds = {"": 4, "wind": 3, "pressure": 2, "switched": 2, "pulse": 1, "point": 1, "tether": 1,
             "jumping tether": 1}  # fmt: skip
    kind = _pick(rng, {"": 1} if conservative else kinds)
    p, speed, force = _log(rng, 1.0, 200.0), _log(rng, 0.5, 15.0), _log(rng, 0.01, 3.0)
    rate = rng.uniform(1.0, 6.0) / seconds
    width = seconds * rng.uniform(0.05, 0.2)
    stiff = _log(rng, 1.0, 100.0)
    if kind == "wind":
        loads.append(
            fc.Wind((speed, 0.3 * speed, 0.0), normal=rng.uniform(0.3, 1.2), tangential=0.01)
        )
    elif kind == "pressure":
        loads.append(fc.Pressure(_pick(rng, {p: 1, f"{p:.4g} * sin({rate:.4g} * t)": 1})))
    elif kind == "switched":
        when = f"t > {begin}", f"t < {begin}", f"t > {begin} and t < {end}"
        loads.append(fc.Pressure(f"where({_pick(rng, dict.fromkeys(when, 1))}, {p:.4g}, 0)"))
    elif kind == "pulse":
        loads.append(fc.Pressure(f"{p:.4g} * exp(-((t - {begin}) / {width:.4g})**2)"))
    elif kind == "point":
        place = size[0] / 2, size[1] / 2
        loads.append(fc.PointForce(place, (0.0, 0.0, f"{force:.4g} * where(t < {begin}, 1, 0)")))
    elif kind == "tether":
        loads.append(
            fc.Tether("right", (size[0], size[1] / 2, f"0.1 * sin({rate:.4g} * t)"), stiff)
        )
    elif kind == "jumping tether":
        loads.append(
            fc.Tether("right", (size[0], size[1] / 2, f"where(t < {begin}, 0, 0.1)"), stiff)
        )
    return loads


def _floor(rng, wave: float) -> fc.Obstacle:
    """Return a plane below the sheet."""
    below = wave + FLOOR_GAP + _log(rng, 2e-3, 0.05)
    plane = fc.shapes.Plane((0.0, 0.0, -below), (0.0, 0.0, 1.0))
    return fc.Obstacle(plane, FLOOR_GAP, _pick(rng, {0.0: 1, 0.3: 1}))


def _pins(rng, pieces: int, clamped: bool, size, seconds: float) -> list[fc.Pin]:
    """Return no pins, fixed ones, or one that moves, turns or jumps."""
    if pieces > 1:
        return []
    if not clamped and rng.uniform() < 0.2:
        return []
    where = "left" if clamped else _pick(rng, {"left": 3, "top": 1, "boundary": 2})
    rate, far = rng.uniform(1.0, 6.0) / seconds, _log(rng, 2e-3, 0.05)
    begin = round(seconds * rng.uniform(0.1, 0.5), 5)
    kind = _pick(rng, {"fixed": 4, "shaken": 1, "drawn": 1, "turned": 1, "jumping": 1})
    if kind == "turned":
        omega = _log(rng, 1.0, 20.0)
        middle = (0.0, size[1] / 2, 0.0) if where == "left" else (size[0] / 2, size[1] / 2, 0.0)
        axis = _pick(rng, {(0.0, 0.0, 1.0): 1, (0.0, 1.0, 0.0): 1})
        return [fc.Pin(where, clamp=clamped, rotate=fc.Rotation(middle, axis, f"{omega:.4g} * t"))]
    motion = {
        "fixed": None,
        "shaken": ("0", "0", f"{far:.4g} * sin({rate:.4g} * t)**2"),
        "drawn": (f"{rng.uniform(0.1, 5.0):.4g} * t", "0", "0"),
        "jumping": ("0", "0", f"where(t < {begin}, 0, {far:.4g})"),
    }[kind]
    return [fc.Pin(where, motion, clamp=clamped)]


def _pick(rng, weights: dict):
    """Return one of the keys, by their weights."""
    keys, shares = list(weights), np.array(list(weights.values()), float)
    return keys[rng.choice(len(keys), p=shares / shares.sum())]


def _log(rng, low: float, high: float) -> float:
    """Return a number between low and high, evenly spread in its logarithm, of four digits."""
    return float(f"{np.exp(rng.uniform(np.log(low), np.log(high))):.4g}")


def _edge(pattern: str, size, triangles: float) -> float:
    """Return the h of a mesh with about so many triangles."""
    area = size[0] * size[1] / triangles
    return float(
        f"{np.sqrt({'right': 2, 'cross': 4, 'unstructured': 4 / 3**0.5}[pattern] * area):.4g}"
    )
