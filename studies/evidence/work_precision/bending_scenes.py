"""Scenes whose bending decides the result, with four models of it: hinges, quadratic, plates."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import fecloth as fc
from studies.work_precision.scenes import BENDING, PAPER, SWING, Counted, Scene, weights

MODELS = {"hinges": "P1", "quadratic": "P1", "plate": "P1", "plate, P2": "P2"}
LOW = 0.1  # height of a held triangle over the height of its mirror image
CLOTH = fc.Fabric(0.2, 500.0, bending_rigidity=1e-4)
REACH, WIDTH = 0.2, 0.1  # m, of the cantilever
EDGE, CORNER = 0.05, 0.12 - 1e-9  # m, radius of the table, and a corner of the cloth


def swing(model: str, h: float, explicit: bool = False) -> Scene:
    """Return the falling strip of paper of `scenes.swing` with one of `MODELS`."""
    cloth = fc.Cloth.rectangle(SWING, 0.1, h=h, pattern="right", element=MODELS[model])
    terms = [fc.StVK(), bending(model), fc.Gravity()]
    mass = "lumped" if explicit else None
    system = Counted(cloth, PAPER, terms, ["left"], mass=mass)
    return Scene(system, system.rest(), 0.3, weights_of(cloth, system, (SWING, 0.05)))


def cantilever(model: str, h: float) -> Scene:
    """Return a sheet of paper clamped along an edge, at rest: mean and free edge."""
    cloth = fc.Cloth.rectangle(REACH, WIDTH, h=h, element=MODELS[model])
    system = clamped(cloth, "left", PAPER, model)
    x = system.rest().x
    x[:, 2] = -0.5 * x[:, 0].clip(0)  # near enough for Newton
    return Scene(system, system.state(x), 0.0, weights_of(cloth, system, (REACH, WIDTH / 2)))


def table(model: str, h: float) -> Scene:
    """Return a square cloth over a round table, clamped along its edge: mean and a corner."""
    cloth = fc.Cloth.read(Path(__file__).with_name("table.geo"), h=h, element=MODELS[model])
    system = clamped(cloth, "edge", CLOTH, model)
    x = system.rest().x
    beyond = np.linalg.norm(x, axis=1) - EDGE
    lobes = np.cos(4 * np.arctan2(x[:, 1], x[:, 0]))  # corners down, sides up
    x[:, 2] = beyond.clip(0) ** 2 * lobes  # 1/m: near enough for Newton
    return Scene(system, system.state(x), 0.0, weights_of(cloth, system, (CORNER, CORNER)))


REST = {"cantilever": cantilever, "table": table}


def bending(model: str):
    """Return the bending term of a model."""
    return BENDING[model.partition(",")[0]]


def clamped(cloth: fc.Cloth, edge: str, fabric: fc.Fabric, model: str) -> fc.System:
    """Return the system of a cloth clamped along a named edge under gravity.

    Hinges hold no normal: there the clamp is a row of held triangles behind the edge. They are low,
    because the hinge at the edge bends half of the triangles on both of its sides.
    """
    terms = [fc.StVK(), bending(model), fc.Gravity()]
    if model.startswith("plate"):
        return Counted(cloth, fabric, terms, [fc.Pin(edge, clamp=True)])
    cloth = with_held_row(cloth, edge)
    return Counted(cloth, fabric, terms, ["held"])


def with_held_row(cloth: fc.Cloth, edge: str) -> fc.Cloth:
    """Return the cloth with a low triangle behind each edge of a set; its set "held" has them."""
    X, count = cloth.X, len(cloth.X)
    on = np.isin(cloth.triangles, cloth.nodes(edge))
    at = np.flatnonzero(on.sum(axis=1) == 2)
    apex = np.argmin(on[at], axis=1)
    third, a, b = (cloth.triangles[at, (apex + i) % 3] for i in range(3))
    along = (X[b] - X[a]) / np.linalg.norm(X[b] - X[a], axis=1)[:, None]
    to = X[third] - X[a]
    foot = np.sum(to * along, axis=1)[:, None] * along
    behind = X[a] + foot - LOW * (to - foot)
    new = count + np.arange(len(at))
    triangles = np.vstack([cloth.triangles, np.column_stack([new, b, a])])
    sets = {"held": np.concatenate([cloth.nodes(edge), new])}
    return fc.Cloth.from_arrays(np.vstack([X, behind]), triangles, sets=sets)


def weights_of(cloth: fc.Cloth, system: fc.System, point: tuple[float, float]) -> np.ndarray:
    """Return (2, n): weights of the mean over `cloth`, which has no held row, and of a point."""
    mean = system.cloth.load() / cloth.area  # held nodes stay at 0
    return np.vstack([mean, weights(system, point)[1]])
