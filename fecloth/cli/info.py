"""The commands `info` and `mesh`."""

from pathlib import Path
from typing import Annotated

from fecloth.cli.options import Changes, Meshing, SceneFile
from fecloth.errors import InputError


def mesh(
    path: Annotated[str, "a .geo, .msh or other mesh file, or a scene"],
    *,
    h: Annotated[float | None, "edge length of a .geo file [m]", "SIZE"] = None,
    output: Annotated[str | None, "e.g. cloth.vtu, for ParaView", "FILE", "-o"] = None,
    meshing: Meshing,
) -> int:
    """Mesh and describe a cloth; write it with -o.

    Raises `InputError` for an edge length h with a scene, which has its own.
    """
    from fecloth.cli.describe import describe_cloth
    from fecloth.mesh.cloth import Cloth
    from fecloth.output.frames import write_mesh

    is_scene = Path(path).suffix == ".toml"
    if is_scene and h:
        raise InputError("--h", "is for mesh files", path, "Change cloth.h in the scene.")
    if is_scene:
        cloth = meshing.load(path).mesh()
    else:
        cloth = Cloth.read(path, h, trust=meshing.trust_geo, time_limit=meshing.mesh_time)
    print("\n".join(describe_cloth(cloth)))
    if output:
        write_mesh(Path(output), cloth)
        print(f"wrote {Path(output)}")
    return 0


def info(
    scene: SceneFile | None = None,
    *,
    set_: Changes = None,
    meshing: Meshing,
    ranks: Annotated[int | None, "memory of each of N processes of mpiexec", "N"] = None,
    fabrics: Annotated[
        str | bool, "the published fabrics; or one, also at larger strains", "NAME"
    ] = False,
    schema: Annotated[bool, "the JSON schema of scene files"] = False,
    terms: Annotated[
        str | bool, "the terms of a scene; with a name, what that term takes", "NAME"
    ] = False,
) -> int:
    """Versions; with a scene, what it would do.

    The scene is built and its solver chosen, but nothing is run.
    """
    from fecloth.cli import describe
    from fecloth.scene.json_schema import json_schema

    if fabrics is True:
        lines = describe.list_fabrics()
    elif fabrics:
        lines = describe.describe_fabric(fabrics)
    elif schema:
        lines = [json_schema()]
    elif terms is True:
        lines = describe.list_terms()
    elif terms:
        lines = describe.describe_term(terms)
    elif scene:
        lines = describe.describe_scene(meshing.load(scene, set_), ranks)
    else:
        lines = describe.describe_installation()
    print("\n".join(lines))
    return 0
