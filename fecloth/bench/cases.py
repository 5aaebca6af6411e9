"""Cases as their JSON files say them, and what an adapter gets of them; BENCH.md has the keys."""

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


def at_level(said: dict, level: int) -> dict:
    """Return the mapping that an adapter takes, with arrays of its own, on one mesh."""
    X, triangles = make_mesh(said["mesh"], said["mesh"]["sizes"][level])
    case: dict = {"level": level, "X": X, "triangles": triangles}
    case |= {key: deepcopy(said[key]) for key in ("name", "static", "fabric", "loads", "pins")}
    case |= {key: np.array(said[key], float) for key in ("gravity", "times")}
    case |= {key: points(said[key], X)[0] for key in ("x", "v")}
    for places, key in ((case, "pins"), *((load, "nodes") for load in case["loads"])):
        places[key] = np.flatnonzero(points([f"where({places[key]}, 1, 0)"], X))
    case["motion"] = said["motion"] and points(said["motion"], X[case["pins"]], case["times"])
    return case


def make_mesh(mesh: dict, size) -> tuple[np.ndarray, np.ndarray]:
    """Return X (n, 2) [m] and triangles (m, 3) of a rectangle, or of a disk of rings of nodes."""
    if mesh["shape"] == "rectangle":
        cloth = Cloth.rectangle(mesh["width"], mesh["height"], size, mesh["pattern"])
        return cloth.X + mesh["corner"], np.array(cloth.triangles)
    z = [k * np.exp(2j * np.pi / (6 * k or 1) * np.arange(6 * k or 1)) for k in range(size + 1)]
    X = mesh["radius"] / size * np.concatenate(z).view(float).reshape(-1, 2)
    return X, Delaunay(X).simplices.astype(np.int64)  # counterclockwise


def points(texts: list[str], X: np.ndarray, times=(0.0,)) -> np.ndarray:
    """Return the values (times, n, 3) of three formulas of X, Y [m] and t [s]."""
    at = {"X": X[None, :, 0], "Y": X[None, :, 1], "t": np.asarray(times)[:, None]}
    return np.stack([Formula(text, ("X", "Y", "t"))(**at) for text in texts], axis=-1)
