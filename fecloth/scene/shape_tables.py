"""The table [cloth] of a scene file: the shapes of one piece."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field

from fecloth.mesh.cloth import Cloth
from fecloth.mesh.gmsh_child import TIME_LIMIT
from fecloth.mesh.grading import Grading
from fecloth.quantities.units import LENGTH
from fecloth.scene.error_words import MESH_FILE
from fecloth.scene.field_types import File, Length
from fecloth.scene.table_model import Table, table_of

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
        sizes = self.width, self.height, self.h
        return Cloth.rectangle(*sizes, self.pattern, self.element, _made(self.grading))


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
        return Cloth.disk(self.radius, self.h, self.element, _made(self.grading))


class MeshFile(Table):
    """``shape = "file"``: a mesh, or a .geo file with an edge length h [m]."""

    shape: Annotated[Literal["file"], Kind]
    path: File
    """A .geo, .msh, .vtu or other mesh file, relative to the scene."""
    h: Annotated[float | None, LENGTH] = None
    """Edge length of a .geo file [m]."""
    element: Element = "P1"
    grading: Gradings = ()

    remedies: ClassVar = {"file": MESH_FILE}

    def cloth(self, trust: bool = False, time_limit: float = TIME_LIMIT) -> Cloth:
        reading = self.element, trust, time_limit, _made(self.grading)
        return Cloth.read(self.path, self.h, *reading)


def _made(grading: tuple) -> tuple[Grading, ...]:
    return tuple(table.make() for table in grading)
