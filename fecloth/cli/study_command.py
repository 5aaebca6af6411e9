"""What the commands of all studies share: how cases run, the folder of the report, the ending."""

import hashlib
import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from fecloth.cli.arguments import option_name
from fecloth.cli.options import Changes, TrustGeo

if TYPE_CHECKING:
    from fecloth.study import Study, StudyResult

# Characters of the question in the name of a folder, with its comma. With the scene and a hash
# the name is then far below the 255 bytes that file systems allow.
LONGEST_QUESTION = 81


@dataclass(frozen=True, kw_only=True)
class Running:
    """How the cases of a study run, and where its report is written.

    Attributes
    ----------
    output
        Folder of the report.
    jobs
        Number of processes.
    scheduler
        Address of a Dask scheduler that runs the cases.
    time_limit
        Longest CPU time of a case [s].
    yes
        Whether it is run however long it may take.
    fresh
        Whether every case is run again.
    trust_geo
        Whether a .geo file may hold any command of Gmsh.
    """

    output: Annotated[
        str | None, "folder of the report (one in out for each question)", "DIR", "-o"
    ] = None
    jobs: Annotated[int, "processes, one thread each (1)", "N"] = 1
    scheduler: Annotated[str | None, "Dask scheduler that runs the cases", "ADDRESS"] = None
    time_limit: Annotated[float, "longest CPU time of a case (%(default)g s)", "S"] = 600.0
    yes: Annotated[bool, "run it however long it may take"] = False
    fresh: Annotated[bool, "run every case again"] = False
    trust_geo: TrustGeo = False

    def how(self) -> dict[str, Any]:
        """Return how the cases run, as the arguments that all studies share."""
        arguments: dict[str, Any] = {
            "cache": self.output or "out",  # without -o all commands share the finished cases
            "jobs": self.jobs,
            "scheduler": self.scheduler,
            "time_limit": self.time_limit,
            "fresh": self.fresh,
        }
        if self.yes:
            arguments["most_seconds"] = None
        return arguments

    def open(self, changes: Changes, *scenes: str) -> "Study":
        """Read scene files, each with the changes, and open them for studies."""
        from fecloth.scene.scene import load_scene
        from fecloth.study import of

        problems = [load_scene(path, changes or (), trust_geo=self.trust_geo) for path in scenes]
        return of(problems, **self.how())


def study(ask: Callable[..., "StudyResult"]) -> Callable[..., int]:
    """Make a command of a function that asks a study.

    The command prints the result, writes its report and returns its exit status. `compare` of
    the folders of two runs is no study: it draws both runs in one picture.
    """

    @wraps(ask)
    def command(scene: str | list[str], *, running: Running, **own: Any) -> int:
        from fecloth.study import threads  # noqa: F401  before NumPy: one thread a case

        paths = [scene] if isinstance(scene, str) else scene
        question = "-".join(Path(path).stem for path in paths) + name_question(ask, own)
        folder = Path(running.output or Path("out") / ask.__name__ / question)
        if len(paths) == 2 and any(Path(path).is_dir() for path in paths):
            from fecloth.study import compare_runs

            print(f"wrote {compare_runs(paths[0], paths[1], folder / 'overlay')}")
            return 0
        result = ask(scene, running=running, **own)
        print(result.summary())
        print(result.describe_files(folder, result.report(folder)))
        return result.exit_status

    return command


def name_question(ask: Callable, own: dict[str, Any]) -> str:
    """Return the options that are not defaults as a text for the name of the study's folder.

    So different questions have different folders. It is "" if all are defaults, and else begins
    with a comma.
    """
    defaults = ask.__kwdefaults__ or {}
    text = ""
    for name, value in own.items():
        if value != defaults.get(name):
            items = value if isinstance(value, list | tuple) else [value]
            text += "".join(f",{option_name(name)}={item}" for item in items if item)
    name = re.sub(r"[^\w.=,+-]", "_", text)  # characters that any file system allows
    # A hash keeps apart texts that have become the same name.
    if name != text or len(name) > LONGEST_QUESTION:
        name = f"{name[:LONGEST_QUESTION]}-{hashlib.sha256(text[1:].encode()).hexdigest()[:6]}"
    return name
