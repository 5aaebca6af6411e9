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
NAMES = tuple(sorted(path.stem for path in FOLDER.glob("*.json")))
Map = Mapping[str, Any]


def read_case(name: str) -> dict[str, Any]:
    """Return what the file of a case says; raise `InputError` for an unknown name."""
    known(f"case {name!r}", name, NAMES, "bench")
    text = (FOLDER / f"{name}.json").read_text(encoding="utf-8")
    return {"name": name, **json.loads(text)}


def at_level(said: Map, level: int) -> dict[str, Any]:
    """Return the mapping that an adapter takes, with arrays of its own, on one mesh."""
    X, triangles = make_mesh(said["mesh"], level)
    times, pins, motion = np.array(said["times"]), select(said["pins"], X), said["motion"]
    loads = [{"nodes": select(load["where"], X), "force": load["force"]} for load in said["loads"]]
    return {
        **{key: said[key] for key in ("name", "static")},
        **{"level": level, "X": X, "triangles": triangles, "pins": pins, "times": times},
        **{key: points(said[key], X)[0] for key in ("x", "v")},
        "motion": points(motion, X[pins], times) if motion else None,
        "gravity": np.array(said["gravity"], float),
        "fabric": dict(said["fabric"]),
        "loads": [{**each, "force": np.array(each["force"], float)} for each in loads],
    }


def make_mesh(mesh: Map, level: int) -> tuple[np.ndarray, np.ndarray]:
    """Return X (n, 2) [m] and triangles (m, 3) of a rectangle, or of a disk of rings of nodes."""
    size = mesh["sizes"][level]
    if mesh["shape"] == "rectangle":
        cloth = Cloth.rectangle(mesh["width"], mesh["height"], size, mesh["pattern"])
        return cloth.X + mesh["corner"], np.array(cloth.triangles)
    around = [np.arange(6 * k) / (6 * k) if k else np.zeros(1) for k in range(size + 1)]
    z = np.concatenate([k * np.exp(2j * np.pi * part) for k, part in enumerate(around)])
    X = mesh["radius"] / size * np.column_stack([z.real, z.imag])
    return X, Delaunay(X).simplices.astype(np.int64)  # counterclockwise


def select(where: str, X: np.ndarray) -> np.ndarray:
    """Return the numbers of the nodes where a condition of X and Y holds; none for ""."""
    holds = Formula(where or "X < X", ("X", "Y"), condition=True)(X=X[:, 0], Y=X[:, 1])
    return np.flatnonzero(holds)


def points(texts: Sequence[str], X: np.ndarray, times: Any = (0.0,)) -> np.ndarray:
    """Return the values (times, n, 3) of three formulas of X, Y [m] and t [s]."""
    at = {"X": X[None, :, 0], "Y": X[None, :, 1], "t": np.asarray(times)[:, None]}
    return np.stack([Formula(text, ("X", "Y", "t"))(**at) for text in texts], axis=-1)
