"""A flat cloth as a mesh file."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fecloth.errors import InputError
from fecloth.mesh.cloth import Cloth
from fecloth.output.atomic_files import writing
from fecloth.output.frames import MESHIO


def write_mesh(path: Path, cloth: Cloth) -> None:
    """Write the flat mesh by meshio, with the quality and a 0/1 array for each node set."""
    import meshio  # here, as its import is slow

    points = np.column_stack([cloth.X, np.zeros(len(cloth.X))])
    inside = {f"set {name}": np.zeros(len(points)) for name in cloth.node_sets}
    for name, nodes in cloth.node_sets.items():
        inside[f"set {name}"][nodes] = 1.0
    mesh = meshio.Mesh(
        points,
        {MESHIO[cloth.element]: cloth.cells},
        point_data=inside,
        cell_data={"quality": [cloth.quality]},
    )
    try:
        with writing(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            mesh.write(path)
    except (meshio.ReadError, meshio.WriteError) as error:  # ReadError for an unknown suffix
        what = f"{path} cannot be written: {str(error).rstrip('.')}"
        raise InputError(what, remedy="Try .vtu.") from error
