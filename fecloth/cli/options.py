"""The options that commands share. Options of a study are named as arguments of its function."""

from argparse import Namespace
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Option:
    """An option or argument of a command, as `argparse` takes it."""

    names: list[str]
    keywords: dict[str, Any]

    @property
    def key(self) -> str:
        """Name of its value among the parsed options."""
        return self.keywords.get("dest") or self.names[-1].lstrip("-").replace("-", "_")


def option(names: str, words: str | None = None, **keywords: Any) -> Option:
    """Return an option with the words of its help; several names have a space between them."""
    return Option(names.split(), {"help": words, **keywords})


def flag(name: str, words: str) -> Option:
    return option(name, words, action="store_true")


def several(name: str, words: str, metavar: str, usual: str = "", **keywords: Any) -> Option:
    """Return an option that may be repeated; without it the `usual` is taken."""
    words += "; may be repeated" + (f" (default: {usual})" if usual else "")
    return option(name, words, action="append", metavar=metavar, **keywords)


def optional_name(name: str, words: str) -> Option:
    return option(name, words, nargs="?", const="", metavar="NAME")


def changes(words: str | None = None) -> Option:
    return option("--set", words, action="append", default=[], metavar="KEY=VALUE")


SCENE = option("scene", "a .toml file")
FOLDER = option("folder", "folder of a run", metavar="DIR")
GEO = "allow all commands in a .geo file"
MESH = [
    flag("--trust-geo", f"{GEO}, also commands that run programs and write files"),
    option(
        "--mesh-time",
        "seconds after which the meshing of a file is stopped (300)",
        type=float,
        default=300.0,
        metavar="SECONDS",
    ),
]
READING = [
    *MESH,
    changes("replace a value of the scene, as in --set time.dt=0.005; may be repeated"),
    flag("--quiet", "print warnings, mistakes and failures only"),
]


def reading(options: Namespace) -> dict[str, Any]:
    """Return the arguments of `load_scene` that the options of `MESH` are."""
    return {"trust_geo": options.trust_geo, "mesh_time": options.mesh_time}


THREADS = option(
    "--threads",
    'threads that share the loops, or "auto": all or one, whichever is faster (auto)',
    metavar="N",
)

SET = changes("replace a value")
QUANTITIES = several("--quantity", 'as "max tip.z"', "Q", "all of [interest]")
REFINE = option("--refine", "what is refined (h)", choices=("h", "dt", "both"), default="h")
RATIO = option("--ratio", "h or dt of a level over the next (2 or √2)", type=float, metavar="R")


def quantity(verb: str) -> Option:
    words = f'what is {verb}, as "max tip.z" (default: the first of [interest])'
    return option("--quantity", words, metavar="Q")


def levels(default: int, words: str = "from 3 to 10") -> Option:
    return option("--levels", f"{words} ({default})", type=int, default=default, metavar="N")


def tolerance(what: str, default: str | None = "1%") -> Option:
    """Return the option for the largest `what` of a quantity."""
    words = f"largest {what} of each quantity, as 1%% or 0.01 (1%%)"
    return option("--tolerance", words, default=default, metavar="T")


def names(name: str, example: str, default: str) -> Option:
    """Return an option that takes names with commas."""
    words = f"{example}, with commas (default: {default})"
    return option(name, words, type=read_names, metavar="A,B")


def read_names(text: str) -> list[str]:
    return [name.strip() for name in text.split(",") if name.strip()]


def read_seconds(text: str) -> str | float:
    """Return a bare number as seconds, and a text with a unit as it is."""
    try:
        return float(text)
    except ValueError:
        return text


def over(required: bool = False) -> Option:
    words = "values of a key: KEY=a:b:log:n, KEY=a:b:lin:n or KEY=v1,v2"
    return several("--over", words, "KEY=VALUES", required=required)


def read_size(text: str) -> tuple[str, float]:
    """Return the key and the number of KEY=SIZE."""
    key, _, number = text.partition("=")
    return key.strip(), float(number)


PARAMETERS = several(
    "--parameter",
    "a number of the scene, as fabric.bending_rigidity",
    "KEY",
    "all numbers of the fabric and of the terms",
    dest="parameters",
)
SCALE = several(
    "--scale", "a usual change of a number that is 0", "KEY=SIZE", type=read_size, default=[]
)
EXACTNESS = option(
    "--tolerance", "relative error of the derivatives (1e-4)", default=1e-4, metavar="T"
)


METHODS = names("--methods", "as bdf2,newmark", "the scene's own and the usual others")
ELEMENTS = names("--elements", "of P1,P2", "both")


SCENES_OR_RUNS = option(
    "scene", "a .toml file; several without --variants; or the folders of two runs", nargs="+"
)
VARIANTS = several("--variants", "values of a key, as terms.0.type=StVK,Springs", "KEY=VALUES")
BUDGET = option(
    "--budget",
    'longest CPU time of the tuned run, as "60 s": seek the most accurate setting within it',
    type=read_seconds,
    metavar="TIME",
)


def running(command: str, longest: float) -> list[Option]:
    """Return the options that all studies share; `longest` is the CPU time of a case [s]."""
    limit = "longest CPU time of a case (%(default)g s)"
    return [
        option("-o --output", f"folder of the report (out/{command}/SCENE)", metavar="DIR"),
        option("--jobs", "processes, one thread each (1)", type=int, default=1, metavar="N"),
        option("--scheduler", "Dask scheduler that runs the cases", metavar="ADDRESS"),
        option("--time-limit", limit, type=float, default=longest, metavar="S"),
        flag("--yes", "run it however long it may take"),
        flag("--fresh", "run every case again"),
        flag("--trust-geo", GEO),
    ]
