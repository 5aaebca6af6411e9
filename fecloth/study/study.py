"""`fecloth.study.of`: a problem, opened once for all studies."""

from dataclasses import dataclass, replace

from fecloth.simulation.equilibrium import equilibrium
from fecloth.simulation.setup import Setup
from fecloth.simulation.steps import StepInfo
from fecloth.study import (
    charts,
    comparing,
    converging,
    sensitivities,
    simplifying,
    stability_map,
    sweeps,
    tuning,
)
from fecloth.study.budgeting import budget as budgets
from fecloth.study.fronts import front as fronts
from fecloth.study.modes import Modes, modes
from fecloth.study.opened import Opened
from fecloth.system.state import State


@dataclass(frozen=True, eq=False, repr=False)
class Study(Opened):
    """A problem and how its cases run; its methods are the studies of the same names.

    Attributes
    ----------
    problems
        The problem; several only for `compare`.
    given
        How the cases of all studies run.
    takes_usual_limit
        Whether each study chooses the longest time of a case, because none was given.
    """

    converge = converging.converge
    compare = comparing.compare
    sweep = sweeps.sweep
    stability = stability_map.stability
    front = fronts.front
    chart = charts.chart
    tune = tuning.tune
    simplify = simplifying.simplify
    sensitivity = sensitivities.sensitivity
    budget = budgets.budget

    def modes(self, *, count: int = 6) -> Modes:
        """Find the `fecloth.modes` of lowest frequency about the start or the equilibrium."""
        setup = self.problem.first
        state = setup.start
        if setup.is_static:
            state = _find_equilibrium(setup)
        title = f"Modes of {self.problem.name}"
        return replace(modes(setup.system, state, count=count), title=title)


def _find_equilibrium(setup: Setup) -> State:
    """Return the equilibrium of a static problem, by load steps if it has them."""
    if setup.t_end is None:
        return equilibrium(setup.system, setup.start)
    steps: list[StepInfo] = []
    chosen, solver = setup.choose()
    state = chosen.run(solver, steps.append).state
    return replace(state, history=steps[-1].memory.term_history)


of = Study.of
