"""The command `fecloth modes`: natural frequencies of a scene."""

from __future__ import annotations

import sys
import warnings
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from fecloth.cli.progress import terminal
from fecloth.errors import FeclothWarning
from fecloth.runs.run_scene import resolve_scene
from fecloth.study.modes import modes

if TYPE_CHECKING:
    from fecloth.scene.scene import Scene


def print_modes(scene: Scene, count: int, folder: str | None, quiet: bool) -> int:
    """Print the frequencies [Hz], one a line; with a folder write report, picture and shapes.

    They are those of small vibrations about the start, or about the equilibrium of a scene with
    [equilibrium]. Whether the state is stable, and the file to open, are printed on standard error.
    """
    problem = scene.build()
    state = problem.state
    if problem.is_static:
        problem, solver, _ = resolve_scene(problem)
        *_, (state, _) = problem.march(solver)
    with warnings.catch_warnings():  # they are printed below
        warnings.simplefilter("ignore", FeclothWarning)
        found = modes(problem.system, state, count=count)
    for frequency in found.frequencies:
        print(f"{frequency:.6g}")
    for words in found.warnings:
        print(f"warning: {words}", file=sys.stderr)
    console = terminal(quiet)
    console.print(found.verdict, soft_wrap=True)
    if folder:
        title = f"Modes of {scene.title or Path(scene.source.partition(' with ')[0]).stem}"
        page = replace(found, title=title).report(folder)
        console.print(f"wrote {page}", soft_wrap=True)
        console.print(f"open {found.write(folder)} in ParaView", soft_wrap=True)
    return 0
