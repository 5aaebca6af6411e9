"""Forces and moments of each law in stretch, shear, bending and wind, for studies/laws.

A patch of a regular pattern is put into one uniform deformation, and the term computes its forces
f. Their virtual work gives the stress: P = ∂W/∂F = −Σ f ⊗ X / area. Differences of four patches
remove the borders, as in `fecloth.plane_moduli`. Each node of these patterns is a centre of
symmetry, so that a uniformly stretched net of springs is in equilibrium; the curves do not show
whether that equilibrium is stable.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import root

import fecloth as fc
from fecloth.terms.sliders import Sliders
from studies.models.homogenised_moduli import FABRIC, NU, H, Y, published

SIZES = (((4, 4), 1), ((4, 3), -1), ((3, 4), -1), ((3, 3), 1))
STRETCHES = np.round(np.arange(0.3, 1.5001, 0.02), 9)
SHEARS = np.round(np.arange(0.0, 1.0001, 0.02), 9)
FOLDS = np.append(np.arange(0.05, 3.1, 0.1), 3.1)  # κh [rad], angle between neighbouring cells
B, SPEED = 1e-5, 5.0  # N m; m/s
LARGEST = 3.0  # of the curvatures of a loop, over HB/B
WARP = fc.Fabric(0.2, (Y, 0.5 * Y), poisson_ratio=NU, shear_stiffness=0.1 * Y)
WEFT = fc.Fabric(
    0.2, (0.5 * Y, Y), poisson_ratio=0.5 * NU, shear_stiffness=0.1 * Y
)  # turned by 90°


@dataclass(frozen=True)
class InfinitePatch:
    """A term on an infinite mesh: the systems of the four patches with their signs."""

    systems: tuple
    area: float

    @classmethod
    def of(cls, term, fabric: fc.Fabric, pattern: str = "cross", h: float = H) -> InfinitePatch:
        period = np.array([h, h if pattern != "equilateral" else 2 * h * np.sqrt(0.75)])
        cloths = [(sign, fc.Cloth.rectangle(*(size * period), h, pattern)) for size, sign in SIZES]
        systems = tuple((sign, fc.System(cloth, fabric, [term])) for sign, cloth in cloths)
        return cls(systems, float(np.prod(period)))

    def work(self, place, direction) -> np.ndarray:
        """Return −Σ f ⊗ direction / area; `place` and `direction` are functions of X (n, 2)."""
        total = 0.0
        for sign, system in self.systems:
            X = system.cloth.X
            f = system.force(system.state(place(X)))
            total = total - sign * f.T @ direction(X)
        return total / self.area

    def stress(self, F) -> np.ndarray:
        """Return the first Piola-Kirchhoff stress P (2, 2) at F (2, 2) [N/m]."""
        return self.work(lambda X: np.pad(X @ np.transpose(F), ((0, 0), (0, 1))), lambda X: X)[:2]

    def moment(self, curvature: float, pattern: str, h: float = H) -> float:
        """Return dU/dκ, the bending moment per width of the cloth rolled up along X [N]."""
        step = 1e-6 / h

        def turn(X):
            ends = (roll_up(X, curvature + s, pattern, h) for s in (step, -step))
            return np.subtract(*ends) / (2 * step)

        return float(np.trace(self.work(lambda X: roll_up(X, curvature, pattern, h), turn)))


def roll_up(X, curvature, pattern, h):
    """Return positions (n, 3) on a cylinder along Y that keep the shape of all triangles.

    The chord of an edge along X is h. On "equilateral" the chord of half an edge is then longer
    than h/2, and the rows are closer together, so that the slanted edges also keep their length h.
    """
    fold, rows = curvature * h, 1.0
    if pattern == "equilateral":
        rows = np.sqrt((4 - 1 / np.cos(fold / 4) ** 2) / 3)
    radius, angle = h / (2 * np.sin(fold / 2)), curvature * X[:, 0]
    along, up = radius * np.sin(angle), 2 * radius * np.sin(angle / 2) ** 2
    return np.column_stack([along, rows * X[:, 1], up])


@dataclass(frozen=True)
class Curve:
    """The response of one law: nominal stress and width at each stretch, stress at each shear."""

    label: str
    stretch: np.ndarray
    tension: np.ndarray
    width: np.ndarray
    shear: np.ndarray
    shearing: np.ndarray


def pull(patch: InfinitePatch, stretches) -> tuple[np.ndarray, np.ndarray]:
    """Return P11 [N/m] and the width w where P12 = P22 = 0; F = [[λ, g], [0, w]], g unknown."""
    found = np.full((len(stretches), 2), np.nan)
    order = np.argsort(stretches, kind="stable")
    up = [i for i in order if stretches[i] >= 1]
    down = [i for i in order[::-1] if stretches[i] < 1]
    for branch in (up, down):
        q = np.array([0.0, 1.0])
        for i in branch:
            F = lambda q, s=stretches[i]: np.array([[s, q[0]], [0.0, q[1]]])  # noqa: E731
            solved = root(lambda q, F=F: patch.stress(F(q))[:, 1] / Y, q, tol=1e-12)
            if np.abs(solved.fun).max() > 1e-8 or solved.x[1] < 0.1:
                break  # no equilibrium: the rest of the branch stays empty
            q = solved.x
            found[i] = patch.stress(F(q))[0, 0], q[1]
    return found[:, 0], found[:, 1]


def curve(label, term, fabric=FABRIC, pattern="cross", h=H, every=1) -> Curve:
    """Return the response of a term; `every` = 5 takes every fifth point."""
    patch = InfinitePatch.of(term, fabric, pattern, h)
    stretches, shears = STRETCHES[::every], SHEARS[::every]
    shearing = np.array([patch.stress([[1.0, g], [0.0, 1.0]])[0, 1] for g in shears])
    return Curve(label, stretches, *pull(patch, stretches), shears, shearing)


LAWS = {
    "StVK": [
        ("isotropic", fc.StVK()),
        ("orthotropic, along the warp", fc.StVK(), WARP),
        ("orthotropic, along the weft", fc.StVK(), WEFT),
    ],
    "TensorCondition": [("k = Y/4", fc.TensorCondition(Y / 4))],
    "NeoHookean": [
        ("incompressible", fc.NeoHookean()),
        ("compressible", fc.NeoHookean("compressible")),
    ],
    "TensionField": [("isotropic", fc.TensionField())],
    "BaraffWitkin": [
        ("p = ½, on every mesh", fc.BaraffWitkin()),
        ("p = 1, matched at h, on h", published("cross"), FABRIC, "cross", H),
        ("p = 1, matched at h, on h/2", published("cross"), FABRIC, "cross", H / 2),
    ],
    "Springs": [
        ("structural, right", fc.Springs(), FABRIC, "right"),
        ("structural, cross", fc.Springs(), FABRIC, "cross"),
        ("van_gelder, right", fc.Springs(kind="van_gelder"), FABRIC, "right"),
        ("both, equilateral", fc.Springs(), FABRIC, "equilateral"),
        ("biquadratic", fc.Springs(kind="biquadratic")),
    ],
}
PATTERNS = ("right", "equilateral")  # bending a cell leaves no node free


def responses(every: int = 1) -> dict[str, list[Curve]]:
    """Return the curves of each membrane law."""
    return {name: [curve(*row, every=every) for row in rows] for name, rows in LAWS.items()}


def moments(every: int = 1) -> dict[str, dict[str, np.ndarray]]:
    """Return M h/B at the angles κh, by bending law and pattern."""
    fabric = fc.Fabric(0.2, Y, NU, bending_rigidity=B)
    out = {}
    for term in (fc.HingeBending(), fc.QuadraticBending()):
        patches = {p: InfinitePatch.of(term, fabric, p) for p in PATTERNS}
        out[type(term).__name__] = {
            p: np.array([patch.moment(fold / H, p) * H / B for fold in FOLDS[::every]])
            for p, patch in patches.items()
        }
    return out


def loop(m: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the curvatures over HB/B (k,) and the moments over HB of a closed loop."""
    HB = B  # then HB/B is 1/m
    fabric = fc.Fabric(0.2, Y, NU, bending_rigidity=B, bending_hysteresis=2 * HB)
    sliders = Sliders.of_fabric(fabric, m)
    up = np.round(np.arange(-LARGEST, LARGEST + 1e-9, 0.01), 9) + 0.0
    path = np.concatenate([up[up >= 0], up[-2::-1], up[1:]])
    slid, moments = np.zeros((1, 3)), []
    for kappa in path:
        e = np.array([[kappa, 0.0, 0.0]]) - slid
        moments.append(kappa + sliders.moment(e)[0, 0] / HB)
        slid = slid + e - sliders.left(e)
    return path, np.array(moments)


def drag_and_lift(term: fc.Drag, degrees) -> np.ndarray:
    """Return drag and lift (k, 2) of a flat cloth at SPEED, by angle of attack [N/m²]."""
    cloth = fc.Cloth.rectangle(1.0, 1.0, 0.5, "right")
    system, out = fc.System(cloth, FABRIC, [term]), []
    for a in np.radians(degrees):
        along, across = np.array([np.cos(a), 0, -np.sin(a)]), np.array([np.sin(a), 0, np.cos(a)])
        v = np.tile(SPEED * along, (len(cloth.X), 1))
        force = system.force(system.state(system.rest().x, v)).sum(axis=0)
        out.append((-force @ along, force @ across))
    return np.array(out)
