"""The messages and the progress bar of a run on a terminal."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from fecloth.scene.scene import Scene
from fecloth.simulation.steps import StepInfo

if TYPE_CHECKING:
    from rich.console import Console


def terminal() -> "Console | None":
    """Return a console on standard error that prints text as it is; None if it is no terminal.

    Names and formulas may have brackets and colons, which Rich reads as markup and emoji.
    """
    if sys.stderr is None or not sys.stderr.isatty():  # None: it was closed before the start
        return None
    from rich.console import Console

    return Console(stderr=True, markup=False, emoji=False, highlight=False)


def show(words: str, console: "Console | None") -> None:
    """Print words on standard error, above the progress bar of a `terminal`."""
    if console:
        console.print(words, soft_wrap=True)
    else:
        print(words, file=sys.stderr)


@contextmanager
def progress(
    console: "Console | None", scene: Scene, quiet: bool
) -> Iterator[Callable[[StepInfo], None]]:
    """Yield a function that shows the progress of a run; the block calls it after each step.

    It takes the `StepInfo` of the step. It shows a bar up to the end of the scene, with t and its
    unit, the step, the Newton iterations and the time that is left. The bar vanishes after
    the block. With `quiet`, and where there is no terminal, nothing is shown.
    """
    if quiet or not console:
        yield lambda info: None
        return
    from rich.progress import (
        BarColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    time = "t = {task.completed:.4g} of {task.total:g}" + scene.schedule.unit
    bar = Progress(
        TextColumn(time + "  {task.description}", markup=False),
        BarColumn(),
        TimeElapsedColumn(),
        "left",
        TimeRemainingColumn(),
        console=console,
        transient=True,
    )
    task = bar.add_task("", total=scene.schedule.t_end)

    def report(info: StepInfo) -> None:
        bar.start()  # only after a step, so that no error message follows an empty bar
        text = f"step {info.step}  Newton {info.counts.newton}"
        bar.update(task, completed=info.t, description=text)

    try:
        yield report
    finally:
        if bar.live.is_started:
            bar.stop()
