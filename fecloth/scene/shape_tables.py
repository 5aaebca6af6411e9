"""The table [cloth] of a scene file: the shapes of one piece."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from fecloth.mesh.cloth import Cloth
from fecloth.mesh.gmsh_child import TIME_LIMIT
from fecloth.mesh.grading import Grading
from fecloth.quantities.units import LENGTH
from fecloth.scene.error_words import MESH_FILE
from fecloth.scene.field_types import File, Length
from fecloth.scene.table_model import Table, table_of

Element = Literal["P1", "P2"]
GradingTable: Any = table_of(Grading)


class Rectangle(Table):
    """``shape = "rectangle"``: [0, width] × [0, height], meshed with edge length h [m]."""

    shape: Literal["rectangle"]
    width: Length
    height: Length
    h: Length
    pattern: str = "unstructured"
    element: Element = "P1"
    grading: tuple[GradingTable, ...] = ()

    def cloth(self) -> Cloth:
        sizes = self.width, self.height, self.h
        return Cloth.rectangle(*sizes, self.pattern, self.element, _made(self.grading))


class Disk(Table):
    """``shape = "disk"``: around the origin, meshed with edge length h [m]."""

    shape: Literal["disk"]
    radius: Length
    h: Length
    element: Element = "P1"
    grading: tuple[GradingTable, ...] = ()

    def cloth(self) -> Cloth:
        return Cloth.disk(self.radius, self.h, self.element, _made(self.grading))


class MeshFile(Table):
    """``shape = "file"``: a mesh, or a .geo file with an edge length h [m]."""

    shape: Literal["file"]
    path: File
    h: Annotated[float | None, LENGTH] = None
    element: Element = "P1"
    grading: tuple[GradingTable, ...] = ()

    @classmethod
    def meanings(cls) -> dict[str, str]:
        """Return how a mesh file is named, also for the key that is tried by mistake."""
        return {"path": MESH_FILE, "file": MESH_FILE}

    def cloth(self, trust: bool = False, time_limit: float = TIME_LIMIT) -> Cloth:
        reading = self.element, trust, time_limit, _made(self.grading)
        return Cloth.read(self.path, self.h, *reading)


def _made(grading: tuple) -> tuple[Grading, ...]:
    return tuple(table.make() for table in grading)
