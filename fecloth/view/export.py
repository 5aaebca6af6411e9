"""fecloth export DIR -o FILE: the moving cloth for Blender and other programs that render.

A .usda is one text file of Universal Scene Description (openusd.org) with all frames; a .obj
is one numbered file a frame. Both have a mesh for each piece of cloth, with triangles, normals
and texture coordinates of the flat cloth, and the obstacles. Lengths are in metres, and z
points up. Quadratic triangles are cut into four.
"""

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from fecloth import validation
from fecloth.errors import InputError
from fecloth.output.atomic_files import replacing
from fecloth.output.obstacle_frames import Obstacles
from fecloth.view.exported_run import Piece, Run, format_rows, node_normals
from fecloth.view.obj_files import write_objs

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
AT_NODES = '(\n            interpolation = "vertex"\n        )\n'


def export(folder: str | Path, target: str | Path, fps: float | None = None) -> tuple[Path, ...]:
    """Write the frames of a run as one .usda file, or as numbered .obj files.

    The cloth moves in real time, and so linearly between frames; the load steps of an
    equilibrium take one second. Normals are at nodes, as means over the triangles by area.
    Texture coordinates are (X − min X)/L of the flat coordinates X, with the longer side L of
    the flat cloth, so that a texture is not distorted. The meshes of several pieces are called
    Cloth_NAME by their names in the scene, or else Cloth_1, Cloth_2, … in their order. In a
    .usda, what does not change has no time samples.

    Parameters
    ----------
    folder
        Of a run, or of `write_vtk`.
    target
        A name.usda, or a name.obj for the files name_0000.obj, name_0001.obj, …
    fps
        Of a .usda: frames per second of the scene into which it is imported; by default 24. Of
        .obj: files per second; by default there is a file for each frame of the run.

    Returns
    -------
    tuple
        The paths of the files.

    Raises
    ------
    InputError
        For another suffix, a wrong fps, a folder without frames, or numbered files of a longer
        run.
    """
    target = Path(target)
    run = Run.open(folder)
    if target.suffix not in (".usda", ".obj"):
        raise InputError(f"-o {target}", "must end in .usda or .obj")
    if fps is not None:
        validation.positive("fps", fps, "", "")
    if target.suffix == ".obj":
        return write_objs(run, target, fps)
    with replacing(target) as part, part.open("w", encoding="utf-8") as file:
        file.writelines(_usd(run, FPS if fps is None else fps))
    return (target,)


def _usd(run: Run, fps: float) -> Iterator[str]:
    """Yield the text of a .usda file in pieces, so that one frame at a time is in memory."""
    codes = [t * fps for t in run.series.times]  # the time codes of the frames
    yield HEAD.format(fps=fps, start=codes[0], end=codes[-1])
    for piece in run.pieces:

        def read(i: int, piece: Piece = piece) -> Obstacles:
            return Obstacles(run.points(i)[piece.nodes], piece.triangles)

        yield from _mesh(piece.name, codes, changes=codes[:1], read=read)
        yield f"        texCoord2f[] primvars:st = {_tuples(piece.st)} {AT_NODES}    }}\n"
    surfaces = [run.obstacles(i) for i in range(len(codes))]
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
    triangles. ``read(i)`` returns the mesh at the i-th of these codes. A value of one time code
    only has no time samples, so that it holds at all times.
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
        if len(times) == 1:
            yield f"        {attribute} = {write(read(0))}\n"
            continue
        yield f"        {attribute}.timeSamples = {{\n"
        yield from (f"            {t:.9g}: {write(read(i))},\n" for i, t in enumerate(times))
        yield "        }\n"
    yield f"        normal3f[] normals {AT_NODES}"


def _tuples(values: np.ndarray) -> str:
    """Return the rows of an array as a list of tuples in the syntax of USD."""
    form = f"({', '.join(['%.7g'] * values.shape[1])}), "
    return f"[{format_rows(form, values)[:-2]}]"
