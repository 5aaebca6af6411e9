"""What is exported of a run: the pieces of its cloth, their texture, and the obstacles."""

import re
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np

from fecloth.mesh.pieces import piece_of_nodes
from fecloth.output.frame_reader import Series, clip_to_drawable, straight
from fecloth.output.obstacle_frames import Obstacles, read_obstacles
from fecloth.view.checker_pattern import material_coordinates

NOTHING = Obstacles(np.empty((0, 3)), np.empty((0, 3), np.int64))


@dataclass(frozen=True, eq=False)
class Piece:
    """A piece of cloth, which shares no node with the others.

    Attributes
    ----------
    name
        The name of its mesh.
    nodes
        (k,) the numbers of its nodes in the frames, ascending.
    triangles
        (m, 3) its straight triangles, in numbers of its own from 0.
    st
        (k, 2) its texture coordinates, as USD calls them.
    """

    name: str
    nodes: np.ndarray
    triangles: np.ndarray
    st: np.ndarray


@dataclass(frozen=True, eq=False)
class Run:
    """The frames of a run, and the pieces of its cloth."""

    series: Series
    pieces: tuple[Piece, ...]

    @classmethod
    def open(cls, folder: str | Path) -> Self:
        """Open the folder of a run, and find the pieces in its first frame."""
        series = Series.open(folder)
        frame = series.read(0)
        triangles = straight(frame.cells)
        st = texture_coordinates(material_coordinates(frame))
        return cls(series, tuple(find_pieces(triangles, st, read_names(series.folder))))

    def points(self, i: int) -> np.ndarray:
        """Return the positions (n, 3) of all nodes in frame i [m]."""
        return clip_to_drawable(self.series.read(i).points)

    def obstacles(self, i: int) -> Obstacles:
        """Return the obstacles in frame i."""
        return read_obstacles(self.series.folder, i) or NOTHING


def read_names(folder: Path) -> list[str]:
    """Return the names of the pieces in the scene of a run, in their order; [] without them."""
    file = folder / "scene.resolved.toml"
    if not file.is_file():
        return []
    scene = tomllib.loads(file.read_text(encoding="utf-8"))
    return list(scene.get("cloth", {}).get("pieces", {}))


def find_pieces(triangles: np.ndarray, st: np.ndarray, names: Sequence[str]) -> Iterator[Piece]:
    """Yield the pieces that triangles (m, 3) connect, in the order of their lowest nodes.

    `st` (n, 2) are the texture coordinates of all nodes. A mesh is called Cloth_NAME by one of
    the `names`, in letters that USD allows; or by its number if there are not as many names.
    """
    piece_of_node = piece_of_nodes(triangles, len(st))
    count = piece_of_node.max() + 1
    identifiers = [re.sub(r"\W", "_", name, flags=re.ASCII) for name in names]
    if len(set(identifiers)) != count:
        identifiers = [str(piece + 1) for piece in range(count)]
    for piece in range(count):
        nodes = np.flatnonzero(piece_of_node == piece)
        own = triangles[piece_of_node[triangles[:, 0]] == piece]
        name = "Cloth" if count == 1 else f"Cloth_{identifiers[piece]}"
        yield Piece(name, nodes, np.searchsorted(nodes, own), st[nodes])


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


def format_rows(form: str, values: np.ndarray) -> str:
    """Return the rows of an array as text, each in the form, as "v %.7g %.7g %.7g"."""
    return form * len(values) % tuple(values.ravel().tolist())
