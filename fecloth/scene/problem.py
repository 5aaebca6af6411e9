"""A problem: the objects of a scene."""

import math
from collections.abc import Generator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from fecloth.integrators.protocol import StepChoice
from fecloth.mesh.cloth import Cloth
from fecloth.nonlinear.context import SolverContext
from fecloth.nonlinear.options import Newton
from fecloth.simulation.doubts.before_run import NOTES, OF_SCENES, find_warnings
from fecloth.simulation.doubts.planned_run import PlannedRun
from fecloth.simulation.energy_ledger import Ledger
from fecloth.simulation.fused_march import Wanted
from fecloth.simulation.load_steps import LoadSteps
from fecloth.simulation.march import Memory, StepInfo, march
from fecloth.simulation.method_choice import Auto
from fecloth.simulation.probes import Observer, Probe
from fecloth.simulation.record_steps import ROWS, rows_at_least
from fecloth.simulation.resolve import method_to_report
from fecloth.system.state import State
from fecloth.system.system import System


@dataclass(frozen=True, eq=False)
class Problem:
    """The objects of a scene, ready for `march`."""

    cloth: Cloth
    system: System
    state: State  # the start
    steps: StepChoice | Auto  # the method and the choice of its steps; `Auto` is resolved later
    t_end: float
    newton: Newton
    linear: str  # the choice of the linear solver
    probes: tuple[Probe, ...]
    ledger: Ledger  # the energies at the start
    observer: Observer  # records each step
    frame_steps: int | None  # steps between two frames of the output; None: frames at `stops`
    stops: tuple[float, ...]
    frame_format: str = "vtu"  # "vtu" or "vtkhdf"
    note: str = ""  # a line to print before the run, or ""
    restarts: int | float | None = None  # steps (an int) or seconds between two restart files
    intersections: bool = True  # whether the pairs of triangles that intersect are counted
    unit: str = " s"  # what follows a value of t in words: " s" or " of the loads"
    error_density: bool = False  # whether frames have the energy of the error in space per area
    rows: int = ROWS  # as `run` takes it

    @property
    def is_static(self) -> bool:
        """Whether an equilibrium is sought, so that t is the part of the loads."""
        return isinstance(self.steps, LoadSteps)

    @property
    def method(self) -> Any:
        """The method as reports name it; see `method_to_report`."""
        return method_to_report(self.steps)

    @property
    def dt(self) -> float | None:
        """The step [s] if it is fixed, else None."""
        return self.steps.dt

    def warnings(self) -> list[str]:
        """Return a sentence for each likely problem of the run, with its remedy."""
        return list(find_warnings(self.planned, OF_SCENES))

    def notes(self) -> list[str]:
        """Return lines to print before the run: facts that are easily overlooked."""
        noted = (f"note: {words}" for words in find_warnings(self.planned, NOTES))
        return [*filter(None, [self.note]), *noted]

    @cached_property
    def planned(self) -> PlannedRun:
        return PlannedRun(self.system, self.state, self.steps, np.append(self.stops, self.t_end))

    def next_row(self, info: StepInfo) -> Wanted:
        """Return the next step after `info` that must have a row, a frame or a restart file."""
        row = rows_at_least(self.rows, self.state.t, self.t_end)(info)
        step, t = row.step, row.t
        if self.frame_steps:
            step = min(step, info.step + self.frame_steps - info.step % self.frame_steps)
        if isinstance(self.restarts, int):
            step = min(step, info.step + self.restarts - info.step % self.restarts)
        elif self.restarts:
            start, every = self.state.t, self.restarts
            t = min(t, start + every * (math.floor((info.t - start) / every + 1e-9) + 1))
        return Wanted(step, t)

    def march(
        self,
        solver: SolverContext,
        state: State | None = None,
        memory: Memory | None = None,
        wanted: Wanted | None = None,
    ) -> Generator[tuple[State, StepInfo], Wanted | None, None]:
        """March to the end from the start, or from a later state with the `Memory` of its step."""
        # With a memory `march` does not search the stable step again: `build` has refused a longer
        # dt.
        run = self.system, self.steps, state or self.state, None, self.t_end
        memory = memory or Memory(0, self.state.t, None)
        return march(*run, stops=self.stops, solver=solver, memory=memory, wanted=wanted)
