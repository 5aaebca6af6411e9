"""The tables [cloth] of one piece, and [cloths.NAME] of pieces that share no node."""

from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field, create_model, model_validator

from fecloth.errors import InputError, amount
from fecloth.mesh.child_process import TIME_LIMIT
from fecloth.mesh.cloth import Cloth
from fecloth.mesh.grading import Grading
from fecloth.quantities.units import LENGTH
from fecloth.scene.error_words import MESH_FILE
from fecloth.scene.field_types import File, Length
from fecloth.scene.placement import Start
from fecloth.scene.table_model import Table, one_of, table_of

GradingTable: Any = table_of(Grading)
Kind = Field(description="The kind of cloth.")
Element = Annotated[
    Literal["P1", "P2"], Field(description="Linear (P1) or quadratic (P2) triangles.")
]
Gradings = Annotated[
    tuple[GradingTable, ...],
    Field(description="Places with smaller triangles, as [[cloth.grading]], see below."),
]


class Rectangle(Table):
    """``shape = "rectangle"``: [0, width] × [0, height], meshed with edge length h [m]."""

    shape: Annotated[Literal["rectangle"], Kind]
    width: Length
    """Length along X, the warp [m]."""
    height: Length
    """Length along Y, the weft [m]."""
    h: Length
    """Edge length of the triangles [m]."""
    pattern: str = "unstructured"
    """"unstructured" (by Gmsh), "right", "cross" or "equilateral"."""
    element: Element = "P1"
    grading: Gradings = ()

    def cloth(self) -> Cloth:
        """Mesh the rectangle."""
        return Cloth.rectangle(
            self.width,
            self.height,
            self.h,
            pattern=self.pattern,
            element=self.element,
            grading=_make_gradings(self.grading),
        )


class Disk(Table):
    """``shape = "disk"``: around the origin, meshed with edge length h [m]."""

    shape: Annotated[Literal["disk"], Kind]
    radius: Length
    """Radius [m]; the middle is the origin."""
    h: Length
    """Edge length of the triangles [m]."""
    element: Element = "P1"
    grading: Gradings = ()

    def cloth(self) -> Cloth:
        """Mesh the disk."""
        grading = _make_gradings(self.grading)
        return Cloth.disk(self.radius, self.h, element=self.element, grading=grading)


class MeshFile(Table):
    """``shape = "file"``: a mesh, or a .geo file with an edge length h [m]."""

    shape: Annotated[Literal["file"], Kind]
    path: File
    """A .geo, .msh, .vtu or other mesh file, relative to the scene."""
    h: Annotated[float | None, LENGTH] = None
    """Edge length of a .geo file [m]."""
    element: Element | None = None
    """Linear (P1) or quadratic (P2) triangles. Left out: P2 for a file of quadratic triangles
    with straight edges, else P1."""
    grading: Gradings = ()
    merge: bool = False
    """Make one node of nodes at the same position."""
    reference: Literal["v", "vt"] | None = None
    """Of an .obj: the coordinates that are the flat cloth. With "vt" the start is `v`. Left out:
    "vt" if its edges are as long as those of `v` within 20 %, else "v", which must be flat."""
    scale: float = Field(1.0, gt=0)
    """Metres of a unit of the coordinates in the file; with reference = "vt", of `vt` alone."""

    remedies: ClassVar = {"file": MESH_FILE}

    def cloth(self, trust: bool = False, time_limit: float = TIME_LIMIT) -> Cloth:
        """Read or mesh the file; see `Cloth.read` for `trust` and `time_limit` [s]."""
        return Cloth.read(
            self.path,
            self.h,
            element=self.element,
            trust=trust,
            time_limit=time_limit,
            grading=_make_gradings(self.grading),
            merge=self.merge,
            reference=self.reference,
            scale=self.scale,
        )


def _make_gradings(tables: tuple) -> tuple[Grading, ...]:
    return tuple(table.make() for table in tables)


_START = {"start": (Start, Field(Start(), description="Where the piece starts."))}
Piece: Any = one_of(
    "shape",
    {
        name: create_model(
            f"{cls.__name__}Piece",
            __base__=cls,
            __cls_kwargs__={"use_attribute_docstrings": False},
            **_START,
        )  # type: ignore[call-overload]  # of dict
        for name, cls in (("rectangle", Rectangle), ("disk", Disk), ("file", MeshFile))
    },
)


class Pieces(Table):
    """``shape = "join"``: several pieces, each with its shape, sets and start.

    It has no `h` and no `grading`: each piece has its own.
    """

    shape: Annotated[Literal["join"], Kind]
    pieces: dict[str, Piece]
    """A table for each piece, as [cloths.NAME] or [cloth.pieces.NAME], see above."""

    h: ClassVar[None] = None
    grading: ClassVar[tuple] = ()

    @model_validator(mode="after")
    def _check_pieces(self):
        """Raise `InputError` for less than two pieces, P1 beside P2, or a frame as a start.

        Of pieces whose element their files say, `Cloth.join` refuses P1 beside P2.
        """
        if len(self.pieces) < 2:
            what = amount(len(self.pieces), "piece")
            raise InputError(what, "must be at least two, or [cloth]")
        if len({piece.element for piece in self.pieces.values()} - {None}) > 1:
            raise InputError("pieces of P1 and of P2", "must have one element")
        for name, piece in self.pieces.items():
            if piece.start.frame:
                raise InputError(f"{name}.start.frame is given", "is for [start] of one cloth")
            if piece.start.is_disturbed:
                what = f"{name}.start.{'disturb' if piece.start.disturb else 'mode'} is given"
                raise InputError(what, "is for [start] of one cloth")
        return self

    @property
    def element(self) -> str | None:
        """The element of all pieces, "P1" or "P2"; None if their files say it."""
        return next(iter(self.pieces.values())).element

    @property
    def paths(self) -> list[str]:
        """The mesh files of the pieces."""
        return [piece.path for piece in self.pieces.values() if piece.shape == "file"]

    def cloth(self, trust: bool = False, time_limit: float = TIME_LIMIT) -> Cloth:
        """Mesh the pieces and join them; see `Cloth.read` for `trust` and `time_limit` [s].

        Raise `InputError`, with the key of the piece and for a mesh file also its path, for a
        piece that cannot be meshed.
        """
        meshed = []
        for name, piece in self.pieces.items():
            try:
                if piece.shape == "file":
                    meshed.append(piece.cloth(trust, time_limit))
                else:
                    meshed.append(piece.cloth())
            except InputError as error:
                if piece.shape == "file":  # `where` is the path of the mesh file
                    what = f"pieces.{name}: {error.where}: {error.what}"
                else:  # `what` begins with the key within the piece
                    what = f"pieces.{name}.{error.what}"
                raise InputError(what, error.allowed, remedy=error.remedy) from error
        return Cloth.join(meshed, list(self.pieces))

    def x(self, cloth: Cloth) -> np.ndarray:
        """Return the positions (n, 3) at the start [m]."""
        x = np.zeros((len(cloth.X), 3))
        for name, piece in self.pieces.items():
            nodes = cloth.nodes(name)
            in_file = None if cloth.start is None else cloth.start[nodes]
            x[nodes] = piece.start.x(cloth.X[nodes], in_file)
        return x

    def v(self, cloth: Cloth) -> np.ndarray:
        """Return the velocities (n, 3) at the start [m/s]."""
        v = np.zeros((len(cloth.X), 3))
        for name, piece in self.pieces.items():
            nodes = cloth.nodes(name)
            v[nodes] = piece.start.v(cloth.X[nodes])
        return v


def join_pieces(data: dict) -> dict:
    """Return the data of a scene with [cloths.NAME] as the pieces of its [cloth]."""
    if "cloths" not in data:
        return data
    if "cloth" in data:
        raise InputError("[cloth] and [cloths.NAME]", "give one of them")
    rest = {key: value for key, value in data.items() if key != "cloths"}
    return {**rest, "cloth": {"shape": "join", "pieces": data["cloths"]}}
