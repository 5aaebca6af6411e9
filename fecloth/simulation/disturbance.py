"""Disturbed starts: by smooth random waves out of the plane, or by a mode."""

import math

import numpy as np

from fecloth.nonlinear.eigenpairs import least_eigenpairs
from fecloth.system.state import State
from fecloth.system.system import System

ROUND_OFF = 1e-9  # of the area: a shorter sum of normals is round-off
WAVES = 6  # of a disturbance: enough for a shape without symmetry


def lift_by_waves(system: System, x: np.ndarray, height: float, seed: int) -> np.ndarray:
    """Return x (n, 3) with the free nodes moved by smooth random waves, by up to `height` [m].

    They move upward along the mean normal of the cloth, so that they do not enter an obstacle
    below. The same `seed` makes the same waves, also on another mesh.
    """
    cloth = system.cloth
    draw = np.random.default_rng(seed)
    waves = draw.normal(size=(WAVES, 2)) * 2 * math.pi / cloth.extent
    phases = cloth.X @ waves.T + draw.uniform(0, 2 * math.pi, WAVES)
    return lift(system, x, height * (1 + np.cos(phases).mean(axis=1)) / 2)


def lift(system: System, x: np.ndarray, height: np.ndarray) -> np.ndarray:
    """Return x (n, 3) with the free nodes moved by heights (n,) [m] along the mean normal."""
    normal = _mean_normal(x[system.cloth.triangles[:, :3]])
    moved: np.ndarray = x + system.constraints.expand(height[:, None] * normal)
    return moved


def bend_by_mode(
    system: System, x: np.ndarray, about: State, number: int, amplitude: float
) -> np.ndarray:
    """Return x (n, 3) with the shape of a mode added, whose largest way is `amplitude` [m].

    It is mode `number` of `fecloth.modes`, from 1, about the state `about`. Raises `SolveFailed`
    where the stiffness is not finite.
    """
    at_rest = system.with_history(system.start_history(about))
    shape = least_eigenpairs(at_rest, about, number).vectors[number - 1]
    return x + amplitude / np.linalg.norm(shape, axis=1).max() * shape


def _mean_normal(corners: np.ndarray) -> np.ndarray:
    """Return the mean normal (3,) of triangles with the corners (m, 3, 3), turned upward.

    It is z where the normals cancel out, as on a closed cloth.
    """
    a, b, c = np.moveaxis(corners, 1, 0)
    normals = np.cross(b - a, c - a)
    normal = normals.sum(axis=0)
    length = np.linalg.norm(normal)
    if length <= ROUND_OFF * np.linalg.norm(normals, axis=1).sum():
        return np.array([0.0, 0.0, 1.0])
    upward: np.ndarray = normal * (math.copysign(1.0, normal[2]) / length)
    return upward
