"""Cloths whose stress is singular at a corner: a taut and a hanging L.

An L is the square [0, 1]² without its upper right quarter; its re-entrant corner is at (½, ½).
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

import fecloth as fc

CORNER = np.array([0.5, 0.5])
OUTLINE = [(0, 0), (1, 0), (1, 0.5), (0.5, 0.5), (0.5, 1), (0, 1)]
SMALL = 1e-4  # m, of the deflection: far below the size, so that its equation is linear
FABRIC = fc.Fabric(areal_density=0.2, tensile_stiffness=200.0, poisson_ratio=0.3)
GEO = """

DefineConstant[ h = 0.1 ];
{points}
{lines}
Curve Loop(1) = {{1, 2, 3, 4, 5, 6}};
Plane Surface(1) = {{1}};
Physical Curve("right") = {{2}};
Physical Curve("top") = {{5}};
"""

Gradings = Sequence[fc.Grading]


def make_l(h: float, element: str = "P1", grading: Gradings = ()) -> fc.Cloth:
    """Return the L; its sets are right, top and boundary."""
    points = [f"Point({i + 1}) = {{{x}, {y}, 0, h}};" for i, (x, y) in enumerate(OUTLINE)]
    lines = [f"Line({i + 1}) = {{{i + 1}, {(i + 1) % 6 + 1}}};" for i in range(6)]
    text = GEO.format(points="\n".join(points), lines="\n".join(lines))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "l.geo")
        path.write_text(text)
        return fc.Cloth.read(path, h, element, grading=grading)


def corner_function(X: np.ndarray) -> np.ndarray:
    """Return r^(2/3) sin(2θ/3), which is harmonic, and 0 on both sides of the corner.

    r and θ are polar coordinates around the corner, θ from its vertical side through the cloth.
    """
    r, theta, _ = _polar(X)
    return r ** (2 / 3) * np.sin(2 / 3 * theta)


def corner_gradient(X: np.ndarray) -> np.ndarray:
    """Return the gradient (p, 2) of `corner_function`."""
    r, theta, outward = _polar(X)
    around = np.stack([-outward[:, 1], outward[:, 0]], axis=1)
    parts = np.sin(2 / 3 * theta)[:, None] * outward + np.cos(2 / 3 * theta)[:, None] * around
    return 2 / 3 * r[:, None] ** (-1 / 3) * parts


def _polar(X: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    away = X - CORNER
    r = np.linalg.norm(away, axis=1)
    angle = np.arctan2(away[:, 1], away[:, 0]) - np.pi / 2
    theta = np.mod(angle + 0.1, 2 * np.pi) - 0.1  # the cut lies outside the cloth
    return r, theta, away / np.maximum(r, 1e-300)[:, None]


def taut_l(h: float, element: str = "P1", grading: Gradings = ()):
    """Return a taut L whose border is raised by `SMALL` × `corner_function`.

    Its stress S is the same in all directions, so that S Δz = 0: the function is the deflection.
    """
    cloth = make_l(h, element, grading)
    system = fc.System(cloth, FABRIC, [fc.StVK()], ["boundary"], mass=cloth.usual_mass)
    raised = np.zeros(len(cloth.X))
    border = cloth.nodes("boundary")
    raised[border] = SMALL * corner_function(cloth.X[border])
    return cloth, system, None, system.state(np.column_stack([1.1 * cloth.X, raised]))


def hanging_l(h: float, element: str = "P1", grading: Gradings = ()):
    """Return an L that hangs from its top."""
    return _hanging(make_l(h, element, grading), (0, -9.81, 0), ["top"])


def _hanging(cloth: fc.Cloth, gravity: tuple, pins: list):
    system = fc.System(cloth, FABRIC, [fc.StVK(), fc.Gravity(gravity)], pins, mass=cloth.usual_mass)
    return cloth, system, None, system.rest()
