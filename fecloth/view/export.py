"""fecloth export DIR -o FILE: the moving cloth for Blender and other programs that render.

A .usda is one text file of Universal Scene Description (openusd.org) with all frames; a .obj
is one numbered file a frame. Both have triangles, normals, texture coordinates of the flat
cloth, and the obstacles. Lengths are in metres, and z points up. Quadratic triangles are cut
into four.
"""

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from fecloth import validation
from fecloth.errors import InputError
from fecloth.output.atomic_files import replace_file, replacing
from fecloth.output.frame_reader import Series, clip_to_drawable, straight
from fecloth.output.obstacle_frames import Obstacles, read_obstacles
from fecloth.view.checker_pattern import material_coordinates

FPS = 24.0  # of a scene by default, as in USD
HEAD = """#usda 1.0
(
    defaultPrim = "World"
    metersPerUnit = 1
    upAxis = "Z"
    framesPerSecond = {fps:.9g}
    timeCodesPerSecond = {fps:.9g}
    startTimeCode = {start:.9g}
    endTimeCode = {end:.9g}
)

def Xform "World"
{{
"""
MESH = """    def Mesh "{name}"
    {{
        uniform token subdivisionScheme = "none"
        uniform bool doubleSided = 1
"""
NOTHING = Obstacles(np.empty((0, 3)), np.empty((0, 3), np.int64))
AT_NODES = '(\n            interpolation = "vertex"\n        )\n'


def export(folder: str | Path, target: str | Path, fps: float | None = None) -> tuple[Path, ...]:
    """Write the frames of a run as one .usda file, or as numbered .obj files.

    The cloth moves in real time, and so linearly between frames; the load steps of an
    equilibrium take one second. Normals are at nodes, as means over the triangles by area.
    Texture coordinates are (X − min X)/L of the flat coordinates X, with the longer side L of
    the flat cloth, so that a texture is not distorted.

    Parameters
    ----------
    folder
        Of a run, or of `write_vtk`.
    target
        A name.usda, or a name.obj for the files name_0000.obj, name_0001.obj, …
    fps
        Of a .usda: frames per second of the scene into which it is imported; by default 24.

    Returns
    -------
    tuple
        The paths of the files.

    Raises
    ------
    InputError
        For another suffix, a wrong fps or an fps with .obj, a folder without frames, or
        numbered files of a longer run.
    """
    target = Path(target)
    series = Series.open(folder)
    if target.suffix == ".obj":
        if fps is not None:
            raise InputError("fps", "applies only to a .usda", str(target), "Omit it for .obj.")
        return _write_objs(series, target)
    if target.suffix != ".usda":
        raise InputError(f"-o {target}", "must end in .usda or .obj")
    if fps is None:
        fps = FPS
    validation.positive("fps", fps, "", "")
    with replacing(target) as part, part.open("w", encoding="utf-8") as file:
        file.writelines(_usd(series, fps))
    return (target,)


def node_normals(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Return unit normals (n, 3) at nodes, the means over their triangles by area.

    A node whose triangles have no area gets the z axis.
    """
    a, b, c = np.moveaxis(points[triangles], 1, 0)
    total = np.zeros_like(points)
    for corner in triangles.T:
        np.add.at(total, corner, np.cross(b - a, c - a))
    length = np.linalg.norm(total, axis=1, keepdims=True)
    return np.where(length > 0, total / np.where(length > 0, length, 1.0), (0.0, 0.0, 1.0))


def texture_coordinates(X: np.ndarray) -> np.ndarray:
    """Return (X − min X)/L of flat coordinates X (n, 2), with the longer side L of the cloth."""
    return (X - X.min(axis=0)) / np.ptp(X, axis=0).max()


def _read(series: Series, i: int) -> Obstacles:
    """Return the points and straight triangles of the cloth in frame i."""
    frame = series.read(i)
    return Obstacles(clip_to_drawable(frame.points), straight(frame.cells))


def _rows(form: str, values: np.ndarray) -> str:
    """Return the rows of an array as text, each in the form, as "v %.7g %.7g %.7g"."""
    return form * len(values) % tuple(values.ravel().tolist())


def _write_objs(series: Series, target: Path) -> tuple[Path, ...]:
    """Write a .obj file for each frame, and return the paths of the files.

    Raises `InputError` if there is a file with the next number: it is of a longer run, and
    programs would show it after the last frame of this one.
    """
    count = len(series.times)
    *files, next_file = (target.with_name(f"{target.stem}_{i:04d}.obj") for i in range(count + 1))
    if next_file.exists():
        remedy = "Remove the files of that run, or choose another name."
        raise InputError(f"{next_file}", f"is of a run with more than {count} frames", "", remedy)
    # st: texture coordinates, as USD calls them.
    st = texture_coordinates(material_coordinates(series.read(0)))
    for i, file in enumerate(files):
        text = _obj("cloth", _read(series, i), st, "%d/%d/%d")
        if obstacles := read_obstacles(series.folder, i):
            # Obstacles have no texture. A .obj numbers the nodes of all its objects together.
            text += _obj("obstacles", obstacles, st[:0], "%d//%d", before=len(st))
        replace_file(file, text.encode())
    return tuple(files)


def _obj(name: str, mesh: Obstacles, st: np.ndarray, corner: str, before: int = 0) -> str:
    """Return an object of a .obj file, whose nodes are numbered from before + 1.

    `st` are its texture coordinates, and `corner` is the form of a corner of a triangle, as
    "%d//%d" with the numbers of the node and of its normal.
    """
    numbers = (mesh.triangles + before + 1).repeat(corner.count("%"), axis=1)
    text = f"o {name}\n"
    text += _rows("v %.7g %.7g %.7g\n", mesh.points)
    text += _rows("vt %.7g %.7g\n", st)
    text += _rows("vn %.7g %.7g %.7g\n", node_normals(mesh.points, mesh.triangles))
    return text + _rows(f"f {corner} {corner} {corner}\n", numbers)


def _usd(series: Series, fps: float) -> Iterator[str]:
    """Yield the text of a .usda file in pieces, so that one frame at a time is in memory."""
    codes = [t * fps for t in series.times]  # the time codes of the frames
    yield HEAD.format(fps=fps, start=codes[0], end=codes[-1])
    st = texture_coordinates(material_coordinates(series.read(0)))
    # The triangles of the cloth do not change: they have the first time code only.
    yield from _mesh("Cloth", codes, changes=codes[:1], read=lambda i: _read(series, i))
    yield f"        texCoord2f[] primvars:st = {_tuples(st)} {AT_NODES}    }}\n"
    surfaces = [read_obstacles(series.folder, i) or NOTHING for i in range(len(codes))]
    if len(surfaces[-1].points):
        moves = _changes(codes, [surface.points for surface in surfaces])
        changes = _changes(codes, [surface.triangles for surface in surfaces])
        yield from _mesh("Obstacles", moves, changes, read=surfaces.__getitem__)
        yield "    }\n"
    yield "}\n"


def _changes(codes: list[float], arrays: list[np.ndarray]) -> list[float]:
    """Return the time codes that a file needs: only the first if all arrays are the same."""
    if any(not np.array_equal(arrays[0], other) for other in arrays):
        return codes
    return codes[:1]


def _mesh(
    name: str, codes: list[float], changes: list[float], read: Callable[[int], Obstacles]
) -> Iterator[str]:
    """Yield the text of a mesh in a .usda, without its closing bracket.

    `codes` are the time codes of its positions and normals, and `changes` those of its
    triangles. ``read(i)`` returns the mesh at the i-th of these codes.
    """
    yield MESH.format(name=name)
    attributes: dict[str, tuple[list[float], Callable[[Obstacles], str]]] = {
        "int[] faceVertexCounts": (changes, lambda mesh: str([3] * len(mesh.triangles))),
        "int[] faceVertexIndices": (changes, lambda mesh: str(mesh.triangles.ravel().tolist())),
        "point3f[] points": (codes, lambda mesh: _tuples(mesh.points)),
        "normal3f[] normals": (
            codes,
            lambda mesh: _tuples(node_normals(mesh.points, mesh.triangles)),
        ),
    }
    for attribute, (times, write) in attributes.items():
        yield f"        {attribute}.timeSamples = {{\n"
        yield from (f"            {t:.9g}: {write(read(i))},\n" for i, t in enumerate(times))
        yield "        }\n"
    yield f"        normal3f[] normals {AT_NODES}"


def _tuples(values: np.ndarray) -> str:
    """Return the rows of an array as a list of tuples in the syntax of USD."""
    form = f"({', '.join(['%.7g'] * values.shape[1])}), "
    return f"[{_rows(form, values)[:-2]}]"
