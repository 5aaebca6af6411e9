"""A run before its first step: what moves, from where, by which steps, and what is recorded."""

from collections.abc import Callable, Generator, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Self

import numpy as np

from fecloth.mesh.cloth import Cloth
from fecloth.nonlinear.context import SolverContext
from fecloth.nonlinear.options import Newton
from fecloth.simulation.answer import places_of
from fecloth.simulation.disturbance import lift, lift_by_waves
from fecloth.simulation.doubts.before_run import OF_SCENES, find_doubts
from fecloth.simulation.doubts.doubt import Doubt
from fecloth.simulation.doubts.planned_run import PlannedRun
from fecloth.simulation.energy_ledger import Ledger
from fecloth.simulation.fused_march import Wanted
from fecloth.simulation.load_steps import LoadSteps
from fecloth.simulation.march import march
from fecloth.simulation.on_request import on_request
from fecloth.simulation.probes import Observer, Probe
from fecloth.simulation.quantity import Quantity
from fecloth.simulation.record_steps import rows_at_least
from fecloth.simulation.resolve import method_to_report, resolve
from fecloth.simulation.run import Result, collect
from fecloth.simulation.steps import Memory, StepInfo
from fecloth.system.state import State
from fecloth.system.system import System

DISTURBANCE = 1e-3  # of a start, at most, over the extent of the cloth: small beside any motion
Solver = tuple[SolverContext, str]  # and in words why it was chosen


@dataclass(frozen=True, eq=False)
class Setup:
    """A system with its start and how it is solved; an equilibrium without `t_end`.

    Attributes
    ----------
    system, start
        What moves, and its state before the first step.
    steps
        The method and the choice of its steps; `choose` resolves `Auto`.
    t_end
        End of the run [s]; None: an equilibrium is sought.
    newton
        Options of the nonlinear solve; None for the defaults.
    linear
        The choice of the linear solver, as for `solver_for`.
    probes
        Probes, and names of columns on request, as for `Observer.bind`.
    stops
        Times at which a step must end [s].
    shape
        Whether stretches and volume are recorded; see `Observer`.
    memory
        As `march` takes it: with one it does not check the start.
    interest
        The quantities for which it runs; None: where the probes are at the end.
    measured
        Measured values and their standard uncertainties, by the texts of quantities.
    error_in_time
        As `time_error` of `run`.
    like
        A setup whose bound probes serve here too, where cloth and probes are the same, and its
        ledger, where system and start are.
    """

    system: System
    start: State
    steps: Any = None
    t_end: float | None = None
    newton: Newton | None = None
    linear: str = "auto"
    probes: tuple[Probe | str, ...] = ()
    stops: tuple[float, ...] = ()
    shape: bool = False
    memory: Memory | None = None
    interest: tuple[Quantity, ...] | None = None
    measured: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    error_in_time: str = "sampled"
    like: "Setup | None" = None

    @property
    def cloth(self) -> Cloth:
        """The mesh of the system."""
        return self.system.cloth

    @property
    def is_static(self) -> bool:
        """Whether an equilibrium is sought; in load steps t is the part of the loads."""
        return self.t_end is None or isinstance(self.steps, LoadSteps)

    @property
    def method(self) -> Any:
        """The method as reports name it; see `method_to_report`."""
        return method_to_report(self.steps)

    @cached_property
    def observer(self) -> Observer:
        """What records the probes from the start on."""
        known = self.like
        if known and self._has_probes_of(known):
            return known.observer.of(self.system, self.start)
        return Observer.bind(self.system, self.start, self.probes, self.shape)

    def _has_probes_of(self, other: "Setup") -> bool:
        same_cloth = self.cloth is other.cloth
        return same_cloth and self.probes is other.probes and self.shape == other.shape

    @cached_property
    def ledger(self) -> Ledger:
        """The energy ledger at the start."""
        known = self.like
        if known and known.system is self.system and known.start is self.start:
            return known.ledger
        return Ledger.open(self.system, self.start)

    @cached_property
    def planned(self) -> PlannedRun:
        """The run as the doubts look at it before its first step."""
        end = self.t_end
        if end is None:
            end = self.start.t
        ends = np.append(self.stops, end)
        return PlannedRun(self.system, self.start, self.steps or LoadSteps(), ends)

    def doubts(self) -> list[Doubt]:
        """Return the doubts about the set-up."""
        return list(find_doubts(self.planned, OF_SCENES))

    @property
    def asked(self) -> tuple[Quantity, ...]:
        """The quantities that a run answers."""
        if self.interest is None:
            return places_of(self.probes)
        return self.interest

    @property
    def energies(self) -> list[str]:
        """Names of the columns of the ledger."""
        return sorted(self.ledger.row())

    def row(self, rest: State | None = None) -> dict[str, float]:
        """Return the columns at the start, or at an equilibrium."""
        if rest is None:
            return self.ledger.row() | self.observer.row(None, None)
        return Ledger.open(self.system, rest).row() | self.observer.row_at_rest(rest)

    def disturbed(self, seed: int) -> Self:
        """Return the setup with its free nodes moved by smooth random waves, by up to 1e-3 L.

        L is the extent of the cloth; see `lift_by_waves`.
        """
        height = DISTURBANCE * self.cloth.extent
        x = lift_by_waves(self.system, self.start.x, height, seed)
        return replace(self, start=replace(self.start, x=x))

    def raised(self, height: np.ndarray) -> Self:
        """Return the setup with its free nodes raised by heights (n,) along its mean normal [m]."""
        x = lift(self.system, self.start.x, height)
        return replace(self, start=replace(self.start, x=x))

    def recording(self, columns: Iterable[str]) -> Self:
        """Return the setup that also records the shape, and what is on request of `columns`."""
        return replace(self, probes=(*self.probes, *on_request(columns)), shape=True)

    def probed_as(self, base: "Setup") -> Self:
        """Return the setup with the columns of another, which are bound once for one cloth."""
        return replace(self, probes=base.probes, shape=base.shape, like=base)

    def choose(self) -> tuple[Self, Solver]:
        """Return the setup with the steps that are taken, also of `Auto`, and their solver."""
        assert self.t_end is not None
        steps, solver, why = resolve(
            self.system,
            self.steps,
            self.start,
            self.t_end,
            self.linear,
            self.newton,
            stops=self.stops,
        )
        return self.taking(steps), (solver, why)

    def taking(self, steps: Any) -> Self:
        """Return the setup with other steps, from the same start."""
        return replace(self, steps=steps, like=self)

    def march(
        self,
        solver: SolverContext,
        state: State | None = None,
        memory: Memory | None = None,
        wanted: Wanted | None = None,
    ) -> Generator[tuple[State, StepInfo], Wanted | None, None]:
        """March to the end from the start, or from a later state with its `memory`."""
        return march(
            self.system,
            self.steps,
            state or self.start,
            t_end=self.t_end,
            stops=self.stops,
            solver=solver,
            memory=memory or self.memory,
            wanted=wanted,
        )

    def run(
        self,
        chosen: Solver,
        report: Callable[[StepInfo], None] = lambda info: None,
        rows: int | None = None,
        watch: Callable[[Iterable], Iterable] = iter,
    ) -> Result:
        """March to the end with the solver of `choose`, and return what was recorded.

        `report` and `rows` are as for `fecloth.run`; with None each step has a row. `watch`
        gets the steps and passes them on, so that a caller sees each of them.
        """
        solver, why = chosen
        assert self.t_end is not None
        next_row = None
        if rows:
            next_row = rows_at_least(rows, self.start.t, self.t_end)
        return collect(
            watch(self.march(solver)),
            self.system,
            self.method,
            self.ledger,
            self.observer,
            why,
            self.t_end,
            report=report,
            next_row=next_row,
            interest=self.asked,
            measured=self.measured,
            time_error=self.error_in_time,
        )
