"""The table of commands: a row has the function, the options and the words of the help.

Parser, help, call, folders and exit status follow from it; a study takes one row. The options of a
study that are its own are the arguments of its function.
"""

import importlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from fecloth.cli import options as shared
from fecloth.cli.options import Option, flag, option, optional_name

FIELD_NAMES = (  # the keys of `frame_reader.FIELDS`, and the checker pattern
    *("larger_stretch", "smaller_stretch", "speed", "displacement"),
    *("contact_pressure", "slip", "energy_density", "error_density", "height"),
    *("quality", "larger_stress", "smaller_stress"),
    *("E11", "E22", "E12", "S11", "S22", "S12", "checks"),
)
SPECIMENS = ("tension", "cantilever", "drape")


@dataclass(frozen=True)
class Command:
    """A row of the table."""

    target: str  # module:function, imported when the command runs
    options: Sequence[Option]
    words: str
    # The function is a study: it takes a scene and the options that are its own arguments. Any
    # other function takes all options, and returns the exit status.
    is_study: bool = False
    prints: bool = True  # the text is the result: if it is lost, the command has failed

    def load(self) -> Callable:
        module, name = self.target.split(":")
        return getattr(importlib.import_module(module), name)


def study(
    target: str,
    options: Sequence[Option],
    words: str,
    *,
    scene: Option = shared.SCENE,
    longest: float = 600.0,
) -> Command:
    """Return the row of a study; `longest` is the time of a case [s]."""
    name = target.rpartition(":")[2]
    return Command(target, [scene, *options, *shared.running(name, longest)], words, is_study=True)


COMMANDS = {
    "run": Command(
        "fecloth.cli.runs:run",
        [
            shared.SCENE,
            *shared.READING,
            option("-o --output", "folder to write (default: out/SCENE)", metavar="DIR"),
            flag("--overwrite", "replace the run in that folder"),
            option("--resume", "go on with the run in that folder", metavar="DIR"),
            shared.THREADS,
        ],
        "run a scene and leave files for ParaView",
        prints=False,
    ),
    "view": Command(
        "fecloth.cli.runs:view",
        [shared.FOLDER, flag("--no-open", "only write the page")],
        "make view.html of a run and open it in the browser",
        prints=False,
    ),
    "render": Command(
        "fecloth.cli.runs:render",
        [
            shared.FOLDER,
            option("-o --output", ".mp4, .gif or .png", metavar="FILE", required=True),
            option("--field", f"one of {', '.join(FIELD_NAMES)}", default="larger_stretch"),
            option("--size", "pixels (1280x720)", metavar="WxH", default="1280x720"),
            option("--fps", "frames a second (default: as the cloth moved)", type=float),
            option("--time", "of a .png [s] (default: the last)", type=float, metavar="T"),
        ],
        "draw a run as a movie or a picture",
        prints=False,
    ),
    "check": Command(
        "fecloth.cli.runs:check",
        [
            option("scenes", "a .toml file", nargs="+", metavar="scene"),
            *shared.READING,
            shared.THREADS,
        ],
        "run scenes and verify their [expect] tables",
        prints=False,
    ),
    "converge": study(
        "fecloth.study.converging:converge",
        [
            shared.quantity("judged"),
            shared.REFINE,
            shared.levels(4),
            shared.RATIO,
            flag("--grade", "grade meshes at corners and pins by the space error"),
            shared.SET,
        ],
        "refine a scene: value, uncertainty, order",
    ),
    "compare": study(
        "fecloth.study.comparing:compare",
        [
            shared.VARIANTS,
            shared.quantity("compared"),
            shared.REFINE,
            shared.levels(3),
            shared.RATIO,
            shared.SET,
        ],
        "compare models, or two scenes, beside the error of each",
        scene=shared.SCENES_OR_RUNS,
    ),
    "sweep": study(
        "fecloth.study.sweeps:sweep",
        [shared.QUANTITIES, shared.SET, shared.over(required=True)],
        "run a scene for several values of a key",
    ),
    "chart": study(
        "fecloth.study.charts:chart",
        [
            shared.quantity("compared"),
            shared.METHODS,
            shared.ELEMENTS,
            shared.names("--models", "as StVK,NeoHookean", "the scene's own"),
            option("--meshes", "meshes with h, h/2, … (2)", type=int, default=2, metavar="N"),
            shared.levels(3, "of the limit, from 3"),
            shared.SET,
        ],
        "errors of other settings over CPU seconds",
        longest=60.0,
    ),
    "stability": study(
        "fecloth.study.stability_map:stability",
        [shared.over(), shared.names("--methods", "as bdf2,newmark", "eight"), shared.SET],
        "find the steps at which each method fails, over the values of a key",
        longest=120.0,
    ),
    "sensitivity": study(
        "fecloth.study.sensitivities:sensitivity",
        [
            shared.several("--quantity", 'as "max tip.z"', "Q", "the first of [interest]"),
            *(shared.PARAMETERS, shared.SCALE, shared.EXACTNESS, shared.SET),
        ],
        "how much quantities depend on each number of a scene",
    ),
    "budget": study(
        "fecloth.study.budgeting.budget:budget",
        [
            shared.QUANTITIES,
            option("--samples", "in place of the first order (where it fails, 64)", type=int),
            option("--seed", "of samples and disturbed starts (0)", type=int, default=0),
            shared.SET,
        ],
        "add up how uncertain quantities are, beside what was measured",
    ),
    "fit": study(
        "fecloth.study.fitting.file:fit",
        [option("--starts", "number of starts (1, or as in the file)", type=int, metavar="N")],
        "find the constants of a fabric from measurements, and what these do not tell",
        scene=option("scene", "a file of a fit", metavar="FIT.toml"),
    ),
    "simplify": study(
        "fecloth.study.simplification.simplify:simplify",
        [shared.QUANTITIES, shared.SET, shared.tolerance("change")],
        "find what a scene does not need, and write it without",
    ),
    "tune": study(
        "fecloth.study.tuning.tune:tune",
        [
            shared.QUANTITIES,
            shared.SET,
            shared.tolerance("error", default=None),
            shared.BUDGET,
            flag("--to-data", "take a third of the uncertainty by [uncertain] as the tolerance"),
            flag("--model", "leave out terms, or take cheaper ones, where that changes little"),
            shared.METHODS,
            shared.ELEMENTS,
        ],
        "find the cheapest setting that meets a tolerance, and prove its error",
    ),
    "modes": Command(
        "fecloth.cli.studies:print_modes",
        [
            shared.SCENE,
            option("-n --count", "number of frequencies (6)", type=int, default=6),
            option("-o --output", "folder of report, picture and shapes", metavar="DIR"),
            *shared.READING,
        ],
        "print the natural frequencies of a scene [Hz]",
    ),
    "new": Command(
        "fecloth.cli.new:write_specimen",
        [
            option("name", "of the files: NAME.toml and others", metavar="NAME"),
            option("--test", "of a specimen", choices=SPECIMENS, required=True),
            flag("--overwrite", "replace files of these names"),
        ],
        "write a scene, a fit and example data of a specimen",
        prints=False,
    ),
    "mesh": Command(
        "fecloth.cli.describe:print_mesh",
        [
            option("path", "a .geo, .msh or other mesh file, or a scene"),
            option("--h", "edge length of a .geo file [m]", type=float, metavar="SIZE"),
            option("-o --output", "e.g. cloth.vtu, for ParaView", metavar="FILE"),
            *shared.MESH,
        ],
        "mesh and describe a cloth; write it with -o",
    ),
    "info": Command(
        "fecloth.cli.describe:print_info",
        [
            option("scene", "a .toml file", nargs="?"),
            shared.changes(),
            *shared.MESH,
            option("--ranks", "memory of each of N processes of mpiexec", type=int, metavar="N"),
            optional_name("--fabrics", "the published fabrics; or one, also at larger strains"),
            flag("--schema", "the JSON schema of scene files"),
            optional_name("--terms", "the terms of a scene; with a name, what that term takes"),
        ],
        "versions; with a scene, what it would do",
    ),
}
