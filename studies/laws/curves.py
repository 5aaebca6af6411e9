"""Forces and moments of each law in stretch, shear, bending and wind, for studies/laws.

Every term lies on a patch of a regular pattern that is put into one uniform deformation, and its
own forces f are asked for. Their virtual work is that of the stress: P = ∂W/∂F = −Σ f ⊗ X / area.
Four patches are differenced, as `fecloth.plane_moduli` does, so that their borders drop out. On
these patterns each node is a centre of symmetry, so that a net of springs is in equilibrium as it
is stretched uniformly; whether it stays so, or buckles, is another question.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import root

import fecloth as fc
from studies.models.homogenised_moduli import FABRIC, NU, H, Y, published

SIZES = (((4, 4), 1), ((4, 3), -1), ((3, 4), -1), ((3, 3), 1))
STRETCHES = np.round(np.arange(0.3, 1.5001, 0.02), 9)
SHEARS = np.round(np.arange(0.0, 1.0001, 0.02), 9)
FOLDS = np.append(np.arange(0.05, 3.1, 0.1), 3.1)  # κh [rad]: a cell is folded against the next
B, SPEED = 1e-5, 5.0  # N m; m/s
WARP = fc.Fabric(0.2, (Y, 0.5 * Y), poisson_ratio=NU, shear_stiffness=0.1 * Y)
WEFT = fc.Fabric(0.2, (0.5 * Y, Y), poisson_ratio=0.5 * NU, shear_stiffness=0.1 * Y)  # turned


@dataclass(frozen=True)
class Endless:
    """A term on an endless mesh: the systems of the four patches with their signs."""

    systems: tuple
    area: float

    @classmethod
    def of(cls, term, fabric: fc.Fabric, pattern: str = "cross", h: float = H) -> Endless:
        period = np.array([h, h if pattern != "equilateral" else 2 * h * np.sqrt(0.75)])
        cloths = [(sign, fc.Cloth.rectangle(*(size * period), h, pattern)) for size, sign in SIZES]
        systems = tuple((sign, fc.System(cloth, fabric, [term])) for sign, cloth in cloths)
        return cls(systems, float(np.prod(period)))

    def work(self, place, direction) -> np.ndarray:
        """−Σ f ⊗ direction / area: `place` and `direction` are functions of X (n, 2)."""
        total = 0.0
        for sign, system in self.systems:
            X = system.cloth.X
            f = system.force(system.state(place(X)))
            total = total - sign * f.T @ direction(X)
        return total / self.area

    def stress(self, F) -> np.ndarray:
        """(2, 2) first Piola–Kirchhoff stress P [N/m] at F (2, 2)."""
        return self.work(lambda X: np.pad(X @ np.transpose(F), ((0, 0), (0, 1))), lambda X: X)[:2]

    def moment(self, curvature: float, pattern: str, h: float = H) -> float:
        """dU/dκ, bending moment per width [N], of the cloth rolled up along X."""
        step = 1e-6 / h

        def turn(X):
            ends = (rolled(X, curvature + s, pattern, h) for s in (step, -step))
            return np.subtract(*ends) / (2 * step)

        return float(np.trace(self.work(lambda X: rolled(X, curvature, pattern, h), turn)))


def rolled(X, curvature, pattern, h):
    """(n, 3) on a cylinder along Y, all triangles as large as they were.

    The chord over an edge along X is h; on "equilateral" that over half of it is then longer than
    h/2, and the rows come closer, so that the slanted edges keep h too.
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


def uniaxial(patch: Endless, stretches) -> tuple[np.ndarray, np.ndarray]:
    """P11 [N/m] with P12 = P22 = 0, and the width: F = [[λ, g], [0, w]] with g and w solved for."""
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
    """The response of a term; of every `every`-th point."""
    patch = Endless.of(term, fabric, pattern, h)
    stretches, shears = STRETCHES[::every], SHEARS[::every]
    shearing = np.array([patch.stress([[1.0, g], [0.0, 1.0]])[0, 1] for g in shears])
    return Curve(label, stretches, *uniaxial(patch, stretches), shears, shearing)


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
PATTERNS = ("right", "equilateral")  # without nodes that a bent cell would let move


def responses(every: int = 1) -> dict[str, list[Curve]]:
    """The curves of each membrane law."""
    return {name: [curve(*row, every=every) for row in rows] for name, rows in LAWS.items()}


def moments(every: int = 1) -> dict[str, dict[str, np.ndarray]]:
    """M h/B at the folds κh, by bending law and pattern."""
    fabric = fc.Fabric(0.2, Y, NU, bending_rigidity=B)
    out = {}
    for term in (fc.HingeBending(), fc.QuadraticBending()):
        patches = {p: Endless.of(term, fabric, p) for p in PATTERNS}
        out[type(term).__name__] = {
            p: np.array([patch.moment(fold / H, p) * H / B for fold in FOLDS[::every]])
            for p, patch in patches.items()
        }
    return out


def blown(term: fc.Drag, degrees) -> np.ndarray:
    """(k, 2) drag and lift [N/m²] of a flat cloth that flies at SPEED, by angle of attack."""
    cloth = fc.Cloth.rectangle(1.0, 1.0, 0.5, "right")
    system, out = fc.System(cloth, FABRIC, [term]), []
    for a in np.radians(degrees):
        along, across = np.array([np.cos(a), 0, -np.sin(a)]), np.array([np.sin(a), 0, np.cos(a)])
        v = np.tile(SPEED * along, (len(cloth.X), 1))
        force = system.force(system.state(system.rest().x, v)).sum(axis=0)
        out.append((-force @ along, force @ across))
    return np.array(out)
