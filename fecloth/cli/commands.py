"""The commands, in the order of the help. The signature of a function has its arguments.

A command returns its exit status. The first paragraph of its docstring stands in the help.
"""

from collections.abc import Callable

from fecloth.cli.demo import demo
from fecloth.cli.info import info, mesh
from fecloth.cli.new import new
from fecloth.cli.runs import check, export, render, run, view
from fecloth.cli.studies import (
    bench,
    budget,
    chart,
    compare,
    converge,
    fit,
    front,
    modes,
    sensitivity,
    simplify,
    stability,
    sweep,
    tune,
)

COMMANDS: list[Callable[..., int]] = [
    demo,
    run,
    view,
    render,
    export,
    check,
    converge,
    compare,
    sweep,
    chart,
    front,
    stability,
    sensitivity,
    budget,
    fit,
    simplify,
    tune,
    bench,
    modes,
    new,
    mesh,
    info,
]
# The result of these is a file or the exit status: what they print may be lost.
MAY_LOSE_TEXT = {demo, run, view, render, export, check, new}
