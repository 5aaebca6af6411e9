"""Rectangles and disks with triangles of regular, irregular and graded patterns."""

from __future__ import annotations

import numpy as np

import fecloth as fc

PATTERNS = ("right", "cross", "equilateral", "unstructured", "jittered", "graded")
DISK_PATTERNS = ("equilateral", "unstructured", "jittered", "graded")
MOVED = 0.22  # of the edge length: how far "jittered" moves each node inside, along X and Y
GRADING = 20  # longest edge over shortest of "graded"


def rectangle(width: float, height: float, h: float, pattern: str, element: str = "P1") -> fc.Cloth:
    """Mesh [0, width] × [0, height] with edges of h [m]; of "graded", h is the longest cell."""
    if pattern not in ("jittered", "graded"):
        return fc.Cloth.rectangle(width, height, h, pattern, element)
    cloth = fc.Cloth.rectangle(width, height, h / longer() if pattern == "graded" else h, "right")
    size = np.array([width, height])
    if pattern == "graded":
        X = size * (GRADING ** (cloth.X / size) - 1) / (GRADING - 1)
    else:
        X = move_inside(cloth.X, ~on_sides(cloth.X, width, height), h)
    sets = {name: cloth.nodes(name) for name in ("left", "right", "boundary")}
    return fc.Cloth.from_arrays(X, cloth.triangles, sets=sets, element=element)


def longer() -> float:
    """Return the longest edge of a graded mesh over the longest of an even one with as many."""
    return np.log(GRADING) * GRADING / (GRADING - 1)


def square(pattern: str, n: int, element: str = "P1") -> fc.Cloth:
    """Mesh the unit square with n edges along a side."""
    return rectangle(1.0, 1.0, 1 / n, pattern, element)


def on_sides(X: np.ndarray, width: float = 1.0, height: float = 1.0) -> np.ndarray:
    """Return (n,) whether a point lies on a side of the rectangle."""
    return ((X < 1e-9) | (np.array([width, height]) - 1e-9 < X)).any(axis=1)


def move_inside(X: np.ndarray, inside: np.ndarray, h: float) -> np.ndarray:
    """Return X with the nodes inside moved at random."""
    moved = X.copy()
    moved[inside] += np.random.default_rng(1).uniform(-MOVED, MOVED, (inside.sum(), 2)) * h
    return moved


def disk(pattern: str, n: int, element: str = "P1") -> fc.Cloth:
    """Mesh the disk of radius 1 with n edges along a radius.

    "equilateral" is a hexagon of equilateral triangles whose rings are stretched to circles;
    "jittered" and "graded" are Gmsh's mesh with moved nodes.
    """
    h = 1 / (n * longer()) if pattern == "graded" else 1 / n
    X, triangles = hexagon(n) if pattern == "equilateral" else arrays(fc.Cloth.disk(1.0, h))
    r = np.linalg.norm(X, axis=1)
    if pattern == "jittered":
        X = move_inside(X, r < 1 - 1e-9, 1 / n)
    if pattern == "graded":
        X = X * ((GRADING**r - 1) / (GRADING - 1) / np.maximum(r, 1e-9))[:, None]
    return fc.Cloth.from_arrays(
        X, triangles, sets={"boundary": np.flatnonzero(r > 1 - 1e-9)}, element=element
    )


def arrays(cloth: fc.Cloth) -> tuple[np.ndarray, np.ndarray]:
    return cloth.X, cloth.triangles


def hexagon(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Return points and triangles of n rings of six sectors around the origin."""
    i, j = np.mgrid[-n : n + 1, -n : n + 1]
    ring = np.maximum(np.abs(i + j), np.maximum(np.abs(i), np.abs(j)))
    number = np.full(i.shape, -1)
    number[ring <= n] = np.arange((ring <= n).sum())
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    triangles = np.concatenate([np.stack([a, b, d], -1), np.stack([b, c, d], -1)]).reshape(-1, 3)
    lattice = (i + 0.5 * j)[ring <= n], (np.sqrt(0.75) * j)[ring <= n]
    sector, within = np.divmod(np.arctan2(*lattice[::-1]), np.pi / 3)
    along = 0.5 + 0.5 * np.tan(within - np.pi / 6) / np.tan(np.pi / 6)
    angle, radius = (sector + along) * np.pi / 3, ring[ring <= n] / n
    points = np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])
    return points, triangles[(triangles >= 0).all(axis=1)]
