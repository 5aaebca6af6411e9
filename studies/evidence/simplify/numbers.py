"""Dimensionless numbers of a scene, from which `predictions` estimates the effect of changes.

They are orders of magnitude for a cloth of areal density ρ, tensile stiffness Y and bending
rigidity B with a free length L under loads w per area. The positions of the pins and the direction
of the loads at the start decide between three cases:

- across: the pins surround the cloth. A string of span L under w sags by s and carries T:
  s/L = (3 w L/(64 Y))^(1/3), T = w L²/(8 s), from its length L (1 + 8/3 (s/L)²); its lowest
  frequency is ω = (π/L) √(T/ρ).
- hung: the loads act across a cloth that is pinned on one side. With N = w L³/B below 8 it is a
  cantilever with the deflection N L/8 and ω = 3.52 √(B/(ρ L⁴)) (Timoshenko, Vibration Problems in
  Engineering); above, it turns down within ℓ = (B/w)^(1/3) of the clamp, and swings like a heavy
  plate on a hinge, ω = √(3 w/(2 ρ L)).
- along: the loads act in its plane; it stretches by w L/(2 Y), ω = (π/2L) √(Y/ρ).
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import ConvexHull, Delaunay, QhullError, cKDTree

import fecloth as fc
from fecloth.scene.problem import Problem
from fecloth.scene.scene import Scene
from fecloth.terms.traits import DAMPED, TermTraits, has_kind, traits_of


@dataclass(frozen=True, eq=False)
class Numbers:
    """Magnitudes of a scene's terms; the docstring of the file has the formulas."""

    scene: Scene
    built: Problem

    @classmethod
    def of(cls, scene: Scene) -> "Numbers":
        return cls(scene, scene.build())

    @property
    def is_static(self) -> bool:
        """Whether the scene is an equilibrium, without time."""
        return self.scene.equilibrium is not None

    def term(self, name: str):
        """Return the scene's term of a type, or None."""
        return next((t for t in self.built.system.terms if type(t).__name__ == name), None)

    @cached_property
    def traits(self) -> dict[str, TermTraits]:
        """What each term is, by its type."""
        return {type(term).__name__: traits_of(term) for term in self.built.system.terms}

    @cached_property
    def dampings(self) -> tuple[str, ...]:
        """The types of the terms that slow a motion, and do nothing else."""
        return tuple(
            name for name, traits in self.traits.items() if traits.damps and name not in self.loads
        )

    @cached_property
    def loads(self) -> dict[str, float]:
        """Σ |f|/A of each load at the start, by its type [Pa]."""
        return {name: _size(f) / self.built.cloth.area for name, f in self._forces.items()}

    @cached_property
    def _forces(self) -> dict[str, np.ndarray]:
        forces, start = {}, self.built.start
        for term, bound in zip(self.built.system.terms, self.built.system.bound, strict=True):
            if bound.load:
                f = np.zeros_like(start.x)
                bound.add_force(start.x, start.v, start.t, f)
                forces[type(term).__name__] = f
        return forces

    @cached_property
    def w(self) -> float:
        """Sum of all loads [Pa]."""
        return sum(self.loads.values())

    @property
    def density(self) -> float:
        return self._fabric.areal_density

    @property
    def tensile(self) -> float:
        return min(self._fabric.tensile)

    @property
    def rigidity(self) -> float:
        """B [N m]; 0 if the scene has no bending term."""
        return min(self._fabric.bending) if has_kind(self.built.system.terms, "bending") else 0.0

    @property
    def _fabric(self):
        return self.built.system.panel.fabrics[0]

    @cached_property
    def _pinned(self) -> np.ndarray:
        return self.built.cloth.X[self.built.system.constraints.nodes]

    @cached_property
    def case(self) -> str:
        """One of "across", "hung" and "along"."""
        if self._is_surrounded():
            return "across"
        x, (a, b, c) = self.built.start.x, self.built.cloth.triangles[:, :3].T
        normals = np.cross(x[b] - x[a], x[c] - x[a])
        normal = normals.sum(axis=0) / _size(normals)
        acts = sum(np.abs(f @ normal).sum() for f in self._forces.values())
        flat = np.linalg.norm(normal) > 1 - 1e-9
        return "along" if flat and acts < 1e-6 * self.w * self.built.cloth.area else "hung"

    def _is_surrounded(self) -> bool:
        """Return whether the centre of the cloth lies in the convex hull of the pins."""
        try:
            hull = Delaunay(self._pinned[ConvexHull(self._pinned).vertices])
        except (QhullError, ValueError):  # collinear pins, or too few
            return False
        return bool(hull.find_simplex(self.built.cloth.X.mean(axis=0)) >= 0)

    @cached_property
    def L(self) -> float:
        """Largest distance from the pins [m]; twice the distance in the case "across"."""
        X = self.built.cloth.X
        if not len(self._pinned):
            return float(np.ptp(X, axis=0).max())
        return float(cKDTree(self._pinned).query(X)[0].max()) * (1 + (self.case == "across"))

    @cached_property
    def sag(self) -> float:
        """s/L of a string under w [-]."""
        return max((3 * self.w * self.L / (64 * self.tensile)) ** (1 / 3), 1e-12)

    @cached_property
    def moved(self) -> float:
        """Displacement over L [-]."""
        hung = min(1.0, self.N / 8)
        strain = self.w * self.L / (2 * self.tensile)
        return {"across": self.sag, "hung": hung, "along": strain}[self.case]

    @cached_property
    def N(self) -> float:
        """w L³/B [-]."""
        return self.w * self.L**3 / self.rigidity if self.rigidity else math.inf

    @cached_property
    def omega(self) -> float:
        """The lowest frequency [1/s]."""
        L, rho = self.L, self.density
        if self.case == "across":
            return math.pi / L * math.sqrt(self.w * L / (8 * self.sag) / rho)
        if self.case == "along":
            return math.pi / (2 * L) * math.sqrt(self.tensile / rho)
        if self.N < 8:
            return 3.52 * math.sqrt(self.rigidity / (rho * L**4))
        return math.sqrt(3 * self.w / (2 * rho * L))

    @cached_property
    def seconds(self) -> float:
        return self.built.t_end - self.built.start.t

    @cached_property
    def h(self) -> float:
        """Edge length, of equilateral triangles of the mean area [m]."""
        cloth = self.built.cloth
        return math.sqrt(4 / math.sqrt(3) * cloth.area / len(cloth.triangles))

    @cached_property
    def strained(self) -> float:
        """Fraction of a motion's energy in membrane strain [-]."""
        return 1.0 if self.case != "hung" else min(1.0, self.w * self.L / (2 * self.tensile))

    def decay(self, name: str) -> float:
        """Return the exponent of the decay of the slowest motion by a damping term [-]."""
        term = self.term(name)
        if term is None:
            return 0.0
        if self.traits[name].damps == "motion":
            return 0.5 * term.rate * self.seconds
        if self.traits[name].damps == "air":
            return 0.5 * self.slowing(name) * self.omega * self.seconds
        share = self.strained if self.traits[name].damps == "strain" else self.bent
        return 0.5 * self.omega**2 * term.time * share * self.seconds

    @property
    def bent(self) -> float:
        """Fraction of a motion's energy in bending [-]."""
        return min(1.0, self.without_bending())

    def slowing(self, name: str) -> float:
        """Return the air drag at the speed of the slowest motion over the other loads [-]."""
        term, speed = self.term(name), self.omega * self.moved * self.L
        if term is None or not self.w:
            return 0.0
        power = 2 if term.law == "quadratic" else 1
        return max(term.normal, term.tangential) * speed**power / self.w

    @cached_property
    def rest(self) -> float:
        """Fraction of the motion that is left at the end [-]; 1 if the whole path counts."""
        interest = self.scene.interest
        if interest is None or not interest.at_end_only:
            return 1.0
        return math.exp(-sum(self.decay(name) for name in self.dampings))

    def without_bending(self) -> float:
        """Return π² B/(T L²) across, 8/N for a cantilever, ℓ/L if hung, 0 along."""
        if not self.rigidity or self.case == "along" or not self.w:
            return 0.0
        if self.case == "across":
            return math.pi**2 * self.rigidity / (self.w * self.L / (8 * self.sag) * self.L**2)
        return max(8 / self.N, self.N ** (-1 / 3))

    def other_membrane(self) -> float:
        """Return the error of springs in the moduli, times the share of stretch in the motion."""
        # An unstructured mesh counts as an equilateral one.
        pattern = getattr(self.scene.cloth, "pattern", "unstructured")
        lattice = "equilateral" if pattern == "unstructured" else pattern
        C = [
            fc.plane_moduli(term, self._fabric, lattice, self.h)
            for term in (fc.StVK(), fc.Springs())
        ]
        both = [(1 / np.linalg.inv(c)[0, 0], c[0, 0] + c[0, 1]) for c in C]
        apart = max(abs(b / a - 1) for a, b in zip(*both, strict=True))
        stretch = self.w * self.L / (2 * self.tensile) / max(self.moved, 1e-12)
        return apart * {"across": 1 / 3, "hung": min(1.0, stretch), "along": 1.0}[self.case]

    def time_error(self, dt: float) -> float:
        """Return ω t ω dt/2 for a method of first order, ω t (ω dt)²/12 for others; at most 1."""
        # Multiplied by the fraction of the motion that `steps_leave` and `rest` give.
        first = self.built.method.traits.order == 1
        each = self.omega * dt / 2 if first else (self.omega * dt) ** 2 / 12
        return min(1.0, each * self.omega * self.seconds) * self.steps_leave(dt) * self.rest

    def steps_leave(self, dt: float) -> float:
        """Return the fraction of the slowest motion that numerical damping leaves [-]."""
        beyond = self.omega * dt
        if beyond < 1 or self.built.method.traits.at_infinity > 0:
            return 1.0
        return math.exp(-0.5 * self.seconds / dt * math.log1p(beyond**2))

    def mesh_error(self) -> float:
        """Return (κ h)²/12 of linear elements; the half wave is L, or 2 L with a free side."""
        half = self.L if self.case == "across" else 2 * self.L
        return (math.pi * self.h / half) ** 2 / 12


def table(numbers: Numbers) -> list[dict]:
    g, period = (
        numbers.loads.get("Gravity", 0.0),
        2 * math.pi / numbers.omega if numbers.omega else math.inf,
    )
    wave = math.sqrt(numbers.tensile / numbers.density)
    dt = None if numbers.is_static else numbers.built.dt
    rows = [
        ("gravity / membrane stiffness", "ρ g L/Y", g * numbers.L / numbers.tensile) if g else None,
        ("gravity / bending stiffness", "ρ g L³/B", g * numbers.L**3 / numbers.rigidity)
        if g and numbers.rigidity
        else None,
        ("all loads / bending stiffness", "w L³/B", numbers.N) if numbers.rigidity else None,
        ("dt / fastest wave", "dt √(Y/ρ)/h", dt * wave / numbers.h) if dt else None,
        ("dt / slowest period", "dt ω/2π", dt / period) if dt else None,
    ]
    named = () if numbers.is_static else numbers.traits.items()
    for name, traits in sorted(named, key=lambda pair: DAMPED.index(pair[1].damps)):
        term = numbers.term(name)
        if traits.damps == "air":
            load = numbers.loads.get(name) or numbers.slowing(name) * numbers.w
            rows.append((f"{name} / weight", "k u²/(ρ g)", load / g if g else math.inf))
        elif traits.damps == "motion":
            rows.append((f"{name} · slowest period", "2π c/ω", term.rate * period))
        elif traits.damps:
            rows.append((f"{name} / slowest period", "τ ω/2π", term.time / period))
    names = ("number", "formula", "value")
    return [dict(zip(names, row, strict=True)) for row in rows if row]


def _size(vectors: np.ndarray) -> float:
    return float(np.linalg.norm(vectors, axis=1).sum())
