"""Reading of .obj files: nodes `v`, texture coordinates `vt`, and faces `f`."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from fecloth.errors import MeshError, amount
from fecloth.mesh.cells import Cells, triangles_of
from fecloth.mesh.raw_mesh import RawMesh

_COORDINATES = {"v": 3, "vt": 2}
_CORNERS = {3: "triangle", 4: "quadrilateral"}
_NO_VT = -1


def read_obj(path: Path, where: str) -> RawMesh:
    """Return the faces of an .obj file, with their texture coordinates if all faces have them.

    Quadrilaterals are split. Nodes of no face are left out. Raises `MeshError`, with the line,
    for a face that has not three or four corners, for a wrong number, and for text that is no
    number.
    """
    rows: dict[str, list] = {"v": [], "vt": []}
    faces: dict[int, list[np.ndarray]] = {3: [], 4: []}
    numbers: dict[int, list[int]] = {3: [], 4: []}  # of the faces in the file, from 1
    count = 0
    for line, (key, *words) in _statements(path):
        try:
            if key in rows:
                values = [float(word) for word in words[: _COORDINATES[key]]]
                rows[key].append(values + [0.0] * (_COORDINATES[key] - len(values)))
            elif key == "f":
                count += 1
                face = _read_face(words, len(rows["v"]), len(rows["vt"]))
                faces[len(face)].append(face)
                numbers[len(face)].append(count)
        except (ValueError, KeyError, IndexError) as error:
            words = [key, *words]
            raise _make_error(" ".join(words), line, error, rows, where) from error
    return _make_raw(rows, faces, numbers, where)


def _statements(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Yield the number of the line and the words of each statement; a backslash continues it."""
    held: list[str] = []
    with path.open(encoding="utf-8", errors="replace") as file:
        for number, line in enumerate(file, 1):
            words = held + line.partition("#")[0].split()
            held = []
            if words and words[-1].endswith("\\"):
                last = words.pop().removesuffix("\\")
                held = words + [last] * bool(last)
            elif words:
                yield number, words


def _read_face(words: list[str], nodes: int, textures: int) -> np.ndarray:
    """Return the indices (k, 2) into `v` and `vt` of a face, from words as 3, 3/4, 3//5 or 3/4/5.

    A face without `vt` has `_NO_VT`. Negative numbers count from the last `v` or `vt` so far.
    Raises `ValueError` for text that is no number, `KeyError` for a number of corners that is
    not allowed, and `IndexError` for a number that is out of range so far.
    """
    if len(words) not in _CORNERS:
        raise KeyError(len(words))
    face = np.full((len(words), 2), _NO_VT)
    for corner, word in zip(face, words, strict=True):
        texts = word.split("/")[:2]  # without the normal
        for column, (text, so_far) in enumerate(zip(texts, (nodes, textures), strict=False)):
            if text:
                number = int(text)
                index = number - 1 if number > 0 else so_far + number
                if number == 0 or index < 0:
                    raise IndexError(number)
                corner[column] = index
    return face


def _make_error(text: str, line: int, error: Exception, rows: dict, where: str) -> MeshError:
    """Return the error of a statement that cannot be read."""
    allowed = f"must be numbers ({error})"
    remedy = ""
    if isinstance(error, KeyError):
        allowed = "must have three or four corners"
        remedy = "Triangulate the faces where you made the file."
    elif isinstance(error, IndexError):
        allowed = f"must be among the {len(rows['v'])} v and {len(rows['vt'])} vt before it"
    return MeshError(f"{text[:60]!r} in line {line}", allowed, where, remedy)


def _make_raw(rows: dict, faces: dict, numbers: dict, where: str) -> RawMesh:
    """Return the arrays of a file, from its rows of coordinates and its faces by their corners."""
    xyz = np.array(rows["v"], dtype=float).reshape(-1, 3)
    corners = {k: np.array(faces[k], dtype=int).reshape(-1, k, 2) for k in faces if faces[k]}
    blocks = [Cells(_CORNERS[k], k, face[:, :, 0]) for k, face in corners.items()]
    for block in blocks:
        if block.nodes.max() >= len(xyz):
            what = f"a face with node {block.nodes.max() + 1}"
            raise MeshError(what, f"must be at most {len(xyz)}, the number of v", where)
    triangles = triangles_of(xyz, blocks, where)
    face_numbers = np.concatenate([numbers[k] for k in corners])
    is_used = np.zeros(len(xyz), bool)
    is_used[triangles.nodes] = True
    notes = list(triangles.notes)
    if not is_used.all():
        notes.append(f"{amount(int((~is_used).sum()), 'node')} of no face left out")
    raw = {
        "xyz": xyz,
        "triangles": triangles.nodes,
        "node_sets": {},
        "edge_sets": {},
        "node_ids": 1 + np.arange(len(xyz)),
        "triangle_ids": face_numbers[triangles.cell],
        "geometric": np.ones(len(xyz), bool),
        "notes": notes,
    }
    vt = np.array(rows["vt"], dtype=float).reshape(-1, 2)
    textures = np.concatenate([face[:, :, 1].ravel() for face in corners.values()])
    if textures.min() == _NO_VT:
        return RawMesh(**raw)
    if textures.max() >= len(vt):
        what = f"a face with vt {textures.max() + 1}"
        raise MeshError(what, f"must be at most {len(vt)}, the number of vt", where)
    vt_triangles = _same_corners(corners, triangles.cell, triangles.nodes)
    return RawMesh(**raw, vt=vt, vt_triangles=vt_triangles)


def _same_corners(corners: dict, cell: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Return the texture coordinates (m, 3) of the corners of triangles (m, 3).

    `corners` are the faces (k, p, 2), by their number p of corners, and `cell` (m,) is the face
    of each triangle.
    """
    padded = [
        np.pad(face, ((0, 0), (0, 4 - p), (0, 0)), constant_values=_NO_VT)
        for p, face in corners.items()
    ]
    face = np.concatenate(padded)[cell]  # (m, 4, 2)
    place = (face[:, None, :, 0] == triangles[:, :, None]).argmax(axis=2)
    return np.take_along_axis(face[:, :, 1], place, axis=1)
