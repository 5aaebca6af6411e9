"""The commands of studies, in the words of the help; `bench`, and `modes`."""

import sys
import warnings
from typing import TYPE_CHECKING, Annotated, Literal

from fecloth.cli.options import (
    Changes,
    Elements,
    Levels,
    Methods,
    Names,
    Over,
    Quantities,
    Quantity,
    Ratio,
    Reading,
    Refine,
    SceneFile,
    Texts,
)
from fecloth.cli.study_command import Running, study
from fecloth.errors import FeclothWarning

if TYPE_CHECKING:
    from fecloth.study import StudyResult

Seconds = Annotated[float, "CPU seconds of all runs together (%(default)g)", "S"]
ONE_MINUTE = Running(time_limit=60.0)
TWO_MINUTES = Running(time_limit=120.0)


@study
def converge(
    scene: SceneFile,
    *,
    quantity: Quantity = None,
    refine: Refine = "h",
    levels: Levels = 4,
    ratio: Ratio = None,
    set_: Changes = None,
    grade: Annotated[bool, "grade meshes at corners and pins by the space error"] = False,
    running: Running,
) -> "StudyResult":
    """Refine a scene: value, uncertainty, order."""
    study = running.open(set_, scene)
    return study.converge(quantity, refine, levels, ratio=ratio, grade=grade)


@study
def compare(
    scene: Annotated[
        list[str], "a .toml file; several without --variants; or the folders of two runs"
    ],
    *,
    variants: Annotated[
        Texts,
        "values of a key, as terms.0.type=StVK,Springs; may be repeated",
        "KEY=VALUES",
    ] = None,
    quantity: Quantity = None,
    refine: Refine = "h",
    levels: Levels = 3,
    ratio: Ratio = None,
    set_: Changes = None,
    running: Running,
) -> "StudyResult":
    """Compare models, or two scenes, beside the error of each."""
    study = running.open(set_, *scene)
    return study.compare(variants, quantity, refine, levels, ratio=ratio)


@study
def sweep(
    scene: SceneFile,
    *,
    quantity: Quantities = None,
    set_: Changes = None,
    over: Over,
    running: Running,
) -> "StudyResult":
    """Run a scene for several values of a key."""
    return running.open(set_, scene).sweep(over, quantity)


@study
def chart(
    scene: SceneFile,
    *,
    quantity: Quantity = None,
    methods: Methods = None,
    elements: Elements = None,
    models: Annotated[
        Names, "as StVK,NeoHookean, with commas (default: the scene's own)", "A,B"
    ] = None,
    meshes: Annotated[int, "meshes with h, h/2, … (2)", "N"] = 2,
    levels: Annotated[int, "of the limit, from 3 (%(default)s)", "N"] = 3,
    seconds: Seconds = 120.0,
    set_: Changes = None,
    running: Running = ONE_MINUTE,
) -> "StudyResult":
    """Errors of other settings over CPU seconds."""
    return running.open(set_, scene).chart(
        quantity, methods, elements, models, meshes=meshes, levels=levels, seconds=seconds
    )


@study
def front(
    scene: SceneFile,
    *,
    quantity: Quantities = None,
    axes: Annotated[
        Names, "what varies, with commas: h,dt,method,element,pattern,model,terms,gap", "A,B"
    ] = None,
    tolerance: Annotated[str, "relative error that is sought, as 1%% or 0.01 (1%%)", "T"] = "1%",
    seconds: Seconds = 120.0,
    set_: Changes = None,
    running: Running,
) -> "StudyResult":
    """Run settings in the order of their cost, down to an error."""
    asked = running.open(set_, scene)
    if axes is None:
        return asked.front(quantity, tolerance=tolerance, seconds=seconds)
    return asked.front(quantity, axes, tolerance, seconds)


@study
def stability(
    scene: SceneFile,
    *,
    over: Over | None = None,
    methods: Annotated[Names, "as bdf2,newmark, with commas (default: eight)", "A,B"] = None,
    set_: Changes = None,
    running: Running = TWO_MINUTES,
) -> "StudyResult":
    """Find the steps at which each method fails, over the values of a key."""
    return running.open(set_, scene).stability(over, methods)


@study
def sensitivity(
    scene: SceneFile,
    *,
    quantity: Annotated[
        Texts, 'as "max tip.z"; may be repeated (default: the first of [interest])', "Q"
    ] = None,
    parameter: Annotated[
        Texts,
        "a number of the scene, as fabric.bending_rigidity; may be repeated "
        "(default: all numbers of the fabric and of the terms)",
        "KEY",
    ] = None,
    scale: Annotated[
        list[tuple[str, float]] | None,
        "a usual change of a number that is 0; may be repeated",
        "KEY=SIZE",
    ] = None,
    tolerance: Annotated[str, "relative error of the derivatives (1e-4)", "T"] = "1e-4",
    set_: Changes = None,
    running: Running,
) -> "StudyResult":
    """How much quantities depend on each number of a scene."""
    study = running.open(set_, scene)
    return study.sensitivity(parameter, quantity, scale=scale or (), tolerance=tolerance)


@study
def budget(
    scene: SceneFile,
    *,
    quantity: Quantities = None,
    samples: Annotated[int | None, "in place of the first order (where it fails, 64)"] = None,
    seed: Annotated[int, "of samples and disturbed starts (0)"] = 0,
    set_: Changes = None,
    running: Running,
) -> "StudyResult":
    """Add up how uncertain quantities are, beside what was measured."""
    study = running.open(set_, scene)
    return study.budget(quantity=quantity, samples=samples, seed=seed)


@study
def fit(
    scene: Annotated[str, "a file of a fit", "FIT.toml"],
    *,
    starts: Annotated[int | None, "number of starts (1, or as in the file)", "N"] = None,
    running: Running,
) -> "StudyResult":
    """Find the constants of a fabric from measurements, and what these do not tell."""
    from fecloth.study import fit

    return fit(scene, starts=starts, trust_geo=running.trust_geo, **running.how())


@study
def simplify(
    scene: SceneFile,
    *,
    quantity: Quantities = None,
    set_: Changes = None,
    tolerance: Annotated[str, "largest change of each quantity, as 1%% or 0.01 (1%%)", "T"] = "1%",
    running: Running,
) -> "StudyResult":
    """Find what a scene does not need, and write it without."""
    return running.open(set_, scene).simplify(tolerance, quantity)


@study
def tune(
    scene: SceneFile,
    *,
    quantity: Quantities = None,
    set_: Changes = None,
    tolerance: Annotated[
        str | None, "largest error of each quantity, as 1%% or 0.01 (1%%)", "T"
    ] = None,
    budget: Annotated[
        float | str | None,
        'longest CPU time of the tuned run, as "60 s": seek the most accurate setting within it',
        "TIME",
    ] = None,
    to_data: Annotated[
        bool, "take a third of the uncertainty by [uncertain] as the tolerance"
    ] = False,
    model: Annotated[
        bool, "leave out terms, or take cheaper ones, where that changes little"
    ] = False,
    methods: Methods = None,
    elements: Elements = None,
    seconds: Seconds = 120.0,
    running: Running,
) -> "StudyResult":
    """Find the cheapest setting that meets a tolerance, and prove its error."""
    return running.open(set_, scene).tune(
        tolerance,
        quantity,
        budget=budget,
        to_data=to_data,
        model=model,
        methods=methods,
        elements=elements,
        seconds=seconds,
    )


def bench(
    case: Annotated[Texts, "name of a case (default: all)"] = None,
    *,
    adapter: Annotated[Texts, "a function of a case; may be repeated", "FILE.py:FUNCTION"] = None,
    list_: Annotated[bool, "say what the cases ask, and what is known"] = False,
    levels: Annotated[Literal[1, 2, 3], "meshes of a case, coarse to fine (%(default)s)", "N"] = 3,
    json: Annotated[bool, "print one object a line"] = False,
    output: Annotated[
        str | None, "folder of table.md and a chart of each case", "DIR", "-o"
    ] = None,
) -> int:
    """Compare solvers on cases with known answers."""
    from fecloth.bench.runner import bench

    return bench(
        case or (),
        adapter or (),
        describe=list_,
        levels=levels,
        as_json=json,
        output=output,
    )


def modes(
    scene: SceneFile,
    *,
    count: Annotated[int, "number of frequencies (6)", "COUNT", "-n"] = 6,
    output: Annotated[str | None, "folder of report, picture and shapes", "DIR", "-o"] = None,
    reading: Reading,
) -> int:
    """Print the natural frequencies of a scene [Hz].

    Each has a line. Warnings and the verdict go to standard error.
    """
    from fecloth.study import of

    study = of(reading.load(scene, reading.set_))
    with warnings.catch_warnings():  # they are printed below
        warnings.simplefilter("ignore", FeclothWarning)
        result = study.modes(count=count)
    for frequency in result.frequencies:
        print(f"{frequency:.6g}")
    for words in result.warnings:
        print(f"warning: {words}", file=sys.stderr)
    lines = [result.verdict]
    if output:
        lines += [f"wrote {result.report(output)}", f"open {result.write(output)} in ParaView"]
    if not reading.quiet:
        print("\n".join(lines), file=sys.stderr)
    return 0
