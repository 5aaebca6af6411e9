"""`fecloth.study.of`: a problem, opened once for all studies."""

from __future__ import annotations

from dataclasses import dataclass

from fecloth.study import charts, comparing, converging, stability_map, sweeps
from fecloth.study.opened import Opened
from fecloth.study.simplification import simplify
from fecloth.study.tuning import tune


@dataclass(frozen=True, eq=False, repr=False)
class Study(Opened):
    """A problem and how its cases run; each study of it is a method.

    A method is the function of the same name, whose first argument is the problem.
    """

    converge = converging.converge
    compare = comparing.compare
    sweep = sweeps.sweep
    chart = charts.chart
    stability = stability_map.stability
    simplify = simplify.simplify
    tune = tune.tune


of = Study.of
