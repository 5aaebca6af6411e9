"""Cases as their JSON files say them, and what an adapter gets of them; BENCH.md has the keys."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import Delaunay

from fecloth.mesh.cloth import Cloth
from fecloth.quantities.formula import Formula
from fecloth.validation import known

FOLDER = Path(__file__).with_name("cases")
NAMES = sorted(path.stem for path in FOLDER.glob("*.json"))
Map = Mapping[str, Any]


def read_case(name: str) -> dict[str, Any]:
    """Return what the file of a case says; raise `InputError` for an unknown name."""
    known(f"case {name!r}", name, NAMES, "bench")
    return {"name": name, **json.loads((FOLDER / f"{name}.json").read_text(encoding="utf-8"))}


def at_level(said: Map, level: int) -> dict[str, Any]:
    """Return the mapping that an adapter takes, with arrays of its own, on one mesh."""
    X, triangles = make_mesh(said["mesh"], said["mesh"]["sizes"][level])
    case: dict[str, Any] = {"level": level, "X": X, "triangles": triangles, "motion": None}
    case |= {key: said[key] for key in ("name", "static", "fabric")}
    case |= {key: np.array(said[key], float) for key in ("gravity", "times")}
    case |= {key: points(said[key], X)[0] for key in ("x", "v")}
    case["pins"] = select(said["pins"], X)
    case["loads"] = [{**load, "nodes": select(load["nodes"], X)} for load in said["loads"]]
    if said["motion"]:
        case["motion"] = points(said["motion"], X[case["pins"]], case["times"])
    return case


def make_mesh(mesh: Map, size: float) -> tuple[np.ndarray, np.ndarray]:
    """Return X (n, 2) [m] and triangles (m, 3) of a rectangle, or of a disk of rings of nodes."""
    if mesh["shape"] == "rectangle":
        cloth = Cloth.rectangle(mesh["width"], mesh["height"], size, mesh["pattern"])
        return cloth.X + mesh["corner"], np.array(cloth.triangles)
    around = [np.arange(max(6 * k, 1)) / max(6 * k, 1) for k in range(int(size) + 1)]
    z = np.concatenate([k * np.exp(2j * np.pi * turn) for k, turn in enumerate(around)])
    X = mesh["radius"] / size * np.column_stack([z.real, z.imag])
    return X, Delaunay(X).simplices.astype(np.int64)  # counterclockwise


def select(where: str, X: np.ndarray) -> np.ndarray:
    """Return the numbers of the nodes where a condition of X and Y holds."""
    return np.flatnonzero(points([f"where({where}, 1, 0)"], X))


def points(texts: Sequence[str], X: np.ndarray, times: Any = (0.0,)) -> np.ndarray:
    """Return the values (times, n, 3) of three formulas of X, Y [m] and t [s]."""
    at = {"X": X[None, :, 0], "Y": X[None, :, 1], "t": np.asarray(times)[:, None]}
    return np.stack([Formula(text, ("X", "Y", "t"))(**at) for text in texts], axis=-1)
