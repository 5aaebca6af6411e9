"""Cases from their JSON files, and the mapping that an adapter gets; BENCH.md has the keys."""

import json
from copy import deepcopy
from pathlib import Path

import numpy as np
from scipy.spatial import Delaunay

from fecloth.mesh.cloth import Cloth
from fecloth.quantities.formula import Formula

CASES = {
    path.stem: {"name": path.stem, **json.loads(path.read_text(encoding="utf-8"))}
    for path in sorted(Path(__file__).with_name("cases").glob("*.json"))
}


def at_level(stated: dict, level: int) -> dict:
    """Return the mapping that an adapter takes: a case on the mesh of a level.

    `stated` is a case of `CASES`, in which formulas and conditions are texts; here they are
    arrays on the mesh. All of it is copied, so that an adapter may change it.
    """
    X, triangles = make_mesh(stated["mesh"], stated["mesh"]["sizes"][level])
    case: dict = {"level": level, "X": X, "triangles": triangles}
    case |= {key: deepcopy(stated[key]) for key in ("name", "static", "fabric", "loads")}
    case |= {key: np.array(stated[key], float) for key in ("gravity", "times")}
    case |= {key: points(stated[key], X)[0] for key in ("x", "v")}
    case["pins"] = _nodes_where(stated["pins"], X)
    for load in case["loads"]:
        load["nodes"] = _nodes_where(load["nodes"], X)
    case["motion"] = stated["motion"]
    if case["motion"]:  # of the pins, over time
        case["motion"] = points(stated["motion"], X[case["pins"]], case["times"])
    return case


def _nodes_where(condition: str, X: np.ndarray) -> np.ndarray:
    """Return the numbers of the nodes for which a condition on X and Y holds."""
    return np.flatnonzero(points([f"where({condition}, 1, 0)"], X))


def make_mesh(mesh: dict, size) -> tuple[np.ndarray, np.ndarray]:
    """Return X (n, 2) [m] and triangles (m, 3) of a rectangle or a disk.

    `size` is the edge length [m] of the rectangle, or the number of rings of nodes of the disk.
    """
    if mesh["shape"] == "rectangle":
        cloth = Cloth.rectangle(mesh["width"], mesh["height"], size, mesh["pattern"])
        return cloth.X + mesh["corner"], np.array(cloth.triangles)
    rings = [np.zeros(1, complex)]  # the centre, and then x + i y of 6 k nodes of ring k
    for k in range(1, size + 1):
        rings.append(k * np.exp(2j * np.pi / (6 * k) * np.arange(6 * k)))
    # A complex number is two floats, x and y.
    X = mesh["radius"] / size * np.concatenate(rings).view(float).reshape(-1, 2)
    return X, Delaunay(X).simplices.astype(np.int64)  # counterclockwise


def points(texts: list[str], X: np.ndarray, times=(0.0,)) -> np.ndarray:
    """Return the values (times, n, 3) of three formulas of X, Y [m] and t [s]."""
    at = {"X": X[None, :, 0], "Y": X[None, :, 1], "t": np.asarray(times)[:, None]}
    return np.stack([Formula(text, ("X", "Y", "t"))(**at) for text in texts], axis=-1)
