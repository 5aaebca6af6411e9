"""Numbered .obj files: one for each frame of a run, or so many a second."""

from collections.abc import Iterator, Sequence
from functools import lru_cache
from pathlib import Path

import numpy as np

from fecloth.errors import InputError
from fecloth.output.atomic_files import replace_file
from fecloth.output.obstacle_frames import Obstacles
from fecloth.view.exported_run import Piece, Run, format_rows, node_normals


def write_objs(run: Run, target: Path, fps: float | None) -> tuple[Path, ...]:
    """Write a .obj file for each frame, or `fps` files a second; return the paths of the files.

    Raises `InputError` if there is a file with the next number: it is of a longer run, and
    programs would show it after the last frame of this one.
    """
    times = run.series.times
    if fps is not None:
        # The last time may lie before a multiple of 1/fps by round-off.
        count = int((times[-1] - times[0]) * fps * (1 + 1e-12) + 1e-9) + 1
        times = tuple(min(times[0] + k / fps, times[-1]) for k in range(count))
    count = len(times)
    *files, next_file = (target.with_name(f"{target.stem}_{i:04d}.obj") for i in range(count + 1))
    if next_file.exists():
        remedy = "Remove the files of that run, or choose another name."
        raise InputError(f"{next_file}", f"is of a run with more than {count} frames", "", remedy)
    points = lru_cache(maxsize=2)(run.points)  # of the frames before and after a time
    obstacles = lru_cache(maxsize=2)(run.obstacles)
    for file, t in zip(files, times, strict=True):
        i, share = _place(run.series.times, t)
        x = _between(points(i), points(i + 1), share) if share else points(i)
        surface = obstacles(i)
        if share:
            surface = _surface_between(surface, obstacles(i + 1), share)
        replace_file(file, "".join(_objects(run.pieces, x, surface)).encode())
    return tuple(files)


def _place(times: Sequence[float], t: float) -> tuple[int, float]:
    """Return the frame at or before a time, and the share of the way to the next, in [0, 1)."""
    i = int(np.searchsorted(times, t, side="right")) - 1
    if times[i] == t:
        return i, 0.0
    return i, (t - times[i]) / (times[i + 1] - times[i])


def _between(before: np.ndarray, after: np.ndarray, share: float) -> np.ndarray:
    return (1 - share) * before + share * after


def _surface_between(before: Obstacles, after: Obstacles, share: float) -> Obstacles:
    """Return obstacles between two frames; those before if their triangles change."""
    if not np.array_equal(before.triangles, after.triangles):
        return before
    return before._replace(points=_between(before.points, after.points, share))


def _objects(pieces: Sequence[Piece], x: np.ndarray, obstacles: Obstacles) -> Iterator[str]:
    """Yield the objects of a .obj file: the pieces at positions x (n, 3), and the obstacles."""
    before = 0
    for piece in pieces:
        mesh = Obstacles(x[piece.nodes], piece.triangles)
        yield _obj(piece.name.lower(), mesh, piece.st, "%d/%d/%d", before)
        before += len(piece.nodes)  # a .obj numbers the nodes of all its objects together
    if len(obstacles.points):  # they have no texture
        yield _obj("obstacles", obstacles, pieces[0].st[:0], "%d//%d", before)


def _obj(name: str, mesh: Obstacles, st: np.ndarray, corner: str, before: int) -> str:
    """Return an object of a .obj file, whose nodes are numbered from before + 1.

    `st` are its texture coordinates, and `corner` is the form of a corner of a triangle, as
    "%d//%d" with the numbers of the node and of its normal.
    """
    numbers = (mesh.triangles + before + 1).repeat(corner.count("%"), axis=1)
    text = f"o {name}\n"
    text += format_rows("v %.7g %.7g %.7g\n", mesh.points)
    text += format_rows("vt %.7g %.7g\n", st)
    text += format_rows("vn %.7g %.7g %.7g\n", node_normals(mesh.points, mesh.triangles))
    return text + format_rows(f"f {corner} {corner} {corner}\n", numbers)
