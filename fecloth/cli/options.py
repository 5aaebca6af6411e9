"""Arguments that several commands share, and groups of them; `arguments` explains the words."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Literal

# Signals are handled before NumPy is imported: each command imports what it needs when it runs.
if TYPE_CHECKING:
    from fecloth.scene.scene import Scene


Texts = list[str] | None
Names = tuple[str, ...] | None

SceneFile = Annotated[str, "a .toml file"]
RunFolder = Annotated[str, "folder of a run", "DIR"]
Output = Annotated[str | None, "folder to write (default: out/SCENE)", "DIR", "-o"]
Overwrite = Annotated[bool, "replace the run in that folder"]
Changes = Annotated[
    Texts,
    "replace a value of the scene, as in --set time.dt=0.005; may be repeated",
    "KEY=VALUE",
]
Threads = Annotated[
    str | None,
    'threads that share the loops, or "auto": all or one, whichever is faster (auto)',
    "N",
]
TrustGeo = Annotated[
    bool, "allow all commands in a .geo file, also commands that run programs and write files"
]
Quantity = Annotated[
    str | None, 'what is judged, as "max tip.z" (default: the first of [interest])', "Q"
]
Quantities = Annotated[Texts, 'as "max tip.z"; may be repeated (default: all of [interest])', "Q"]
Refine = Annotated[Literal["h", "dt", "both"], "what is refined (h)"]
Levels = Annotated[int, "from 3 to 10 (%(default)s)", "N"]
Ratio = Annotated[float | None, "h or dt of a level over the next (2)", "R"]
Over = Annotated[
    list[str],
    "values of a key: KEY=a:b:log:n, KEY=a:b:lin:n or KEY=v1,v2; may be repeated",
    "KEY=VALUES",
]
Methods = Annotated[
    Names,
    "as bdf2,newmark, with commas (default: the scene's own and the usual others)",
    "A,B",
]
Elements = Annotated[Names, "as P1,P2, with commas (default: both)", "A,B"]


@dataclass(frozen=True, kw_only=True)
class Meshing:
    """How the mesh of a file is made.

    Attributes
    ----------
    trust_geo
        Whether a .geo file may hold any command of Gmsh.
    mesh_time
        Longest time [s].
    """

    trust_geo: TrustGeo = False
    mesh_time: Annotated[
        float, "seconds after which the meshing of a file is stopped (300)", "SECONDS"
    ] = 300.0

    def load(self, scene: str, changes: Iterable[str] | None = None) -> "Scene":
        """Read a scene file with changes, as ["time.dt=0.005"]."""
        from fecloth.scene.scene import load_scene

        return load_scene(scene, changes or (), trust_geo=self.trust_geo, mesh_time=self.mesh_time)


@dataclass(frozen=True, kw_only=True)
class Reading(Meshing):
    """How a scene is read, and what is printed of it.

    Attributes
    ----------
    set_
        Changes of the scene.
    quiet
        Whether only warnings, mistakes and failures are printed.
    """

    set_: Changes = None
    quiet: Annotated[bool, "print warnings, mistakes and failures only"] = False
