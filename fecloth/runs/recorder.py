"""The recording of a running scene: each step is in all of its files or in none."""

import math
import threading
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from fecloth.errors import FeclothError, InputError, StepFailed, amount
from fecloth.nonlinear.context import SolverContext
from fecloth.nonlinear.statistics import SUMMED
from fecloth.output.atomic_files import WriteError
from fecloth.runs import outcome
from fecloth.runs import restart as restarts
from fecloth.runs.environment import Watch, peak_memory, versions
from fecloth.runs.folder import RunFolder
from fecloth.runs.outcome import DONE, FAILED, INTERRUPTED, SceneResult, place_in_words
from fecloth.runs.restart import Progress, Restart
from fecloth.runs.run_files import RunFiles, check_space
from fecloth.scene.problem import Problem
from fecloth.scene.schedule import MOST_STEPS
from fecloth.simulation.account import Accounts, End, Run
from fecloth.simulation.doubts.doubt import Doubt, in_words
from fecloth.simulation.growth import MOST_GROWTH
from fecloth.simulation.record_steps import Record, record_steps
from fecloth.simulation.run import list_accounts
from fecloth.simulation.shapes import Shapes
from fecloth.simulation.solves import Solves
from fecloth.simulation.steps import Memory, StepInfo
from fecloth.system.state import State
from fecloth.view.html_report import read_table, write_report

_PCG = 'use linear = "pcg" in [solver], or a coarser mesh.'
# By `explicit`: the fewest steps between two counts of intersections. A count then takes about a
# tenth of the time of these steps.
STEPS_BETWEEN_COUNTS = {True: 150, False: 6}
LAST = (Solves, Shapes)  # in this order in the log and among the warnings
ORDER = (  # of the keys of summary.json; keys of other accounts follow
    "status",
    "error",
    "warnings",
    "warning",
    "doubts",
    "t",
    "t_end",
    "unit",
    "time_error",
    "time_error_in_words",
    "least_eigenvalue",
    "space_error",
    "space_error_in_words",
    "contact_in_words",
    "nodes",
    "triangles",
    "free_dofs",
    "method",
    "steps",
    *SUMMED,
    "newton_error_in_words",
    "least_stretch",
    "largest_stretch",
    "inverted_triangles",
    "intersecting_pairs",
    "frames",
    "open",
    "solver",
    "threads",
    "seconds",
    "ledger",
)


class Recorder:
    """The files and the progress of a run."""

    def __init__(
        self,
        folder: RunFolder,
        problem: Problem,
        watch: Watch,
        solver: SolverContext,
        scene: str,
        start: str,
        found: Restart | None = None,
        foreseen: Sequence[Doubt] = (),
    ):
        self.folder = folder
        self.problem = problem
        self.watch = watch
        self.solver = solver
        self.scene = scene
        self.start = start
        self.foreseen = foreseen  # doubts before the first step
        self.run = Run(problem.system, problem.method, problem.observer.start, 0, MOST_GROWTH)
        self.files = RunFiles(folder, problem)
        with watch.phase("output"):
            if found:
                self.progress = found.progress
                self._resume(found)
            else:
                self.progress = self._begin()
                if problem.output.restarts:
                    self.restart(regular=True)

    def _begin(self) -> Progress:
        problem = self.problem
        memory = Memory(0, self.problem.start.t, None)
        kinds = (kind for kind in list_accounts(problem.is_static) if kind not in LAST)
        accounts = Accounts.begin((*kinds, *LAST), self.run, problem.ledger)
        accounts = self._frame(problem.start, memory, accounts)
        first_frame = self.files.frames.files(0)[0]
        check_space(self.folder.path, problem, size=first_frame.stat().st_size)
        rows = accounts.rows(problem.observer.row(None, None))
        self.files.add_rows({name: rows[name] for name in ("energies", "observed")})
        return self._progress(problem.start, memory, accounts)

    def _progress(self, state, memory, accounts: Accounts, doubts=(), wanted=None) -> Progress:
        frames = len(self.files.frames.times)
        sizes = self.files.sizes
        return Progress(state, memory, accounts, doubts, wanted, frames, sizes)

    def _resume(self, found: Restart) -> None:
        """Remove what an earlier run wrote after its restart file."""
        self.files.keep()
        restarts.drop_later(self.folder.path, found)
        if found.exact:
            exactly = ""
        else:
            exactly = ", exact to the solver's tolerance only: a factor was lost"
        at = place_in_words(self.progress.state.t, self.problem.unit)
        self.folder.log(f"goes on from step {self.progress.memory.step} at {at}{exactly}")
        if changed := restarts.differences(found):
            self.folder.log(f"the last bits may differ: {changed}")

    def restart(self, regular: bool = False) -> None:
        """Write a restart file; a regular one drops the solver's factor first."""
        self.folder.check_in_place()
        if regular:
            self.solver.drop()
        restart = Restart(
            scene=self.scene,
            start=self.start,
            method=str(self.problem.method),
            progress=self.progress,
            exact=regular or not self.solver.keeps_state,
            made_on=restarts.machine(),
        )
        self.files.flush()  # `write` flushes the folder of the run
        restarts.write(self.folder.path, restart)

    def march(self, report, warn, interrupted: threading.Event) -> FeclothError | None:
        """March, and return the error that ended it early; leave a restart file in any case."""
        try:
            self._march_to_end(report, warn, interrupted)
        except (StepFailed, InputError, MemoryError) as failure:  # InputError: also a full disk
            with suppress(InputError, MemoryError):
                self.restart()
            if isinstance(failure, StepFailed) and failure.state:
                self.progress = replace(self.progress, state=failure.state)
            if isinstance(failure, MemoryError):
                words = f"memory is full ({failure}). Close other programs, or {_PCG}"
                return FeclothError(words)
            return failure
        except BaseException:  # the second Ctrl-C; errors of report or of a user's term
            with suppress(InputError):
                self.restart()
            raise
        return None

    def _march_to_end(self, report, warn, interrupted: threading.Event) -> None:
        problem = self.problem
        before = self.progress
        if before.state.t >= problem.t_end:  # it was killed while it closed
            return
        steps = problem.march(self.solver, before.state, before.memory, before.wanted)
        accounts = before.accounts
        next_row = problem.next_row
        for record in record_steps(steps, self.run, problem.observer, accounts, next_row):
            info = record.info
            if info.step > MOST_STEPS:
                allowed = f"must be at most {MOST_STEPS}"
                remedy = "Raise rtol, or lower t_end."
                raise InputError(f"step {info.step}", allowed, remedy=remedy)
            self.watch.add({"record": record.seconds})
            with self.watch.phase("output"):
                self.folder.check_in_place()
                self._take(record)
                self._warn(self.progress.accounts, warn)
                if regular := self._is_restart_due(info):
                    self.restart(regular)
            report(info)
            if interrupted.is_set():
                if not regular:
                    self.restart()
                return

    def _take(self, record: Record) -> None:
        """Write a step to all files, or to none if that fails or is interrupted."""
        info = record.info
        before = self.progress
        self.watch.seconds.setdefault("to_first_step", self.watch.total)
        self.watch.add(info.counts.seconds)
        accounts = record.accounts.with_record(before.accounts[Shapes])
        try:
            if not info.is_part:
                counts = info.counts
                row = {"step": info.step, "t": info.t, "dt": info.dt, "newton": counts.newton}
                row |= {key: getattr(counts, key) for key in SUMMED[1:]}
                steps = {**row, "residual": counts.residual, **record.rows["steps"]}
                self.files.add_rows({**record.rows, "steps": steps})
            if self._is_frame_due(info):
                accounts = self._frame(
                    record.state, info.memory, accounts, info.t >= self.problem.t_end
                )
            self.progress = self._progress(
                record.state, info.memory, accounts, doubts=before.doubts, wanted=record.wanted
            )
        except BaseException:
            self.progress = before
            self.files.cut(before)
            raise

    def _frame(
        self, state: State, memory: Memory | None, accounts: Accounts, ended: bool = False
    ) -> Accounts:
        """Write a frame with its row of strains.csv, and return the accounts after it."""
        cells = self.files.add_frame(state, memory)
        shape = accounts[Shapes]
        step = accounts[Solves].steps
        apart = STEPS_BETWEEN_COUNTS[self.problem.method.traits.explicit]
        is_due = ended or step - shape.counted >= apart
        counts = self.problem.output.intersections and is_due
        shape, row = shape.at_frame(self.run, state, cells, step, counts)
        self.files.add_rows({"strains": row})
        return accounts.with_record(shape)

    def _warn(self, accounts: Accounts, warn) -> None:
        for doubt in accounts.new_doubts(self.progress.doubts):
            self.progress = replace(self.progress, doubts=(*self.progress.doubts, doubt))
            with suppress(WriteError):  # `warn` reports it; the next line fails the run
                self.folder.log(f"warning: {doubt}")
            warn(str(doubt))

    def _is_restart_due(self, info: StepInfo) -> bool:
        """Whether the scene asks for a restart file after this step."""
        if not (every := self.problem.output.restarts):
            return False
        if isinstance(every, int):
            due = info.step % every == 0
        else:
            times = np.array([info.old.t, info.t]) - info.memory.start
            before, now = np.floor(times / every + 1e-9)
            due = now > before
        return due or info.t >= self.problem.t_end

    def _is_frame_due(self, info: StepInfo) -> bool:
        """Whether the scene asks for a frame after this step, or the run has reached its end."""
        if info.t >= self.problem.t_end:
            return True
        every = self.problem.frame_steps
        if every is None:
            return info.t in self.problem.stops
        return info.step % every == 0

    def close(self, status: str, why: str, error: FeclothError | None, warn) -> SceneResult:
        """Write the last good state as a frame, the summary, the last line of the log."""
        state = self.progress.state
        try:
            with self.watch.phase("output"):
                if state.t > self.files.frames.times[-1] and not isinstance(error, WriteError):
                    memory = self.progress.memory
                    accounts = self.progress.accounts
                    accounts = self._frame(state, memory, accounts, ended=True)
                    self.progress = replace(self.progress, accounts=accounts)
                if status == DONE:
                    self.files.gather()
        except InputError as full:
            status = FAILED
            error = error or full
        self.files.close()
        steps = self.progress.accounts[Solves].steps
        end = End(state, steps, is_whole=state.t >= self.problem.t_end)
        with self.watch.phase("output"):
            accounts = self.progress.accounts.finish(self.run, end)
        self._warn(accounts, warn)
        summary = self._summary(status, why, str(error) if error else None, accounts)
        place = place_in_words(state.t, self.problem.unit)
        words = f"{status} at {place} after {amount(steps, 'step')}"
        resumes: float | None = None  # without a restart file
        with suppress(InputError, MemoryError):
            resumes = restarts.find(self.folder.path).progress.state.t
        if status == INTERRUPTED and resumes is not None:
            words += f"; --resume goes on from {resumes:g}{self.problem.unit}"
        try:
            for line in (*accounts.words(), f"{words}: {error}" if error else words):
                self.folder.log(line)
            self._report(summary)
            self.folder.summary(summary)  # `--resume` writes all of this if it is missing
            self.files.remove_gathered()
        except InputError as full:
            status = FAILED
            error = error or full
        return self._result(status, summary, accounts, error, resumes)

    @property
    def doubts(self) -> tuple[Doubt, ...]:
        """All doubts of the run, first the doubts before the first step."""
        return (*self.foreseen, *self.progress.doubts)

    def _summary(self, status: str, why: str, failure: str | None, accounts: Accounts) -> dict:
        warnings = list(in_words(self.doubts))
        values = {
            "status": status,
            "error": failure,
            "warnings": warnings,
            "warning": next(iter(warnings), None),  # as older runs have it
            "doubts": [doubt.entry() for doubt in self.doubts],
            "t": self.progress.state.t,
            "t_end": self.problem.t_end,
            "unit": self.problem.unit,
            **outcome.count_sizes(self.problem.system),
            "method": str(self.problem.method),
            "frames": len(self.files.frames.times),
            "open": self.files.opens.name,
            "solver": why,
            "threads": self.problem.system.team.used,
            "seconds": self.watch.seconds | {"total": self.watch.total},
            "peak_memory_MB": peak_memory(),
            **self.problem.system.usage(),
            "versions": versions(),
            **accounts.summary(),
        }
        return {key: values[key] for key in ORDER if key in values} | values

    def _report(self, summary: dict) -> None:
        try:
            frame = self.files.shown_at(self.progress.state)
            write_report(self.folder.path, summary, frame, self.files.obstacles.last)
        except Exception as failure:  # of any kind: all else is written
            self.folder.log(f"warning: no report: {failure}")

    def _result(self, status: str, summary: dict, accounts: Accounts, error, resumes):
        files = (self.files.tables[name].path for name in ("energies", "observed"))
        energies, observed = (read_table(file, math.inf) for file in files)
        times = energies.pop("t", np.empty(0))
        observed.pop("t", None)
        return SceneResult(
            state=self.progress.state,
            times=times,
            energies=energies,
            observed=observed,
            seconds=summary["seconds"],
            solver=summary["solver"],
            method=self.problem.method,
            doubts=self.doubts,
            accounts=accounts,
            status=status,
            folder=self.folder.path,
            summary=summary,
            error=error,
            resumes=resumes,
        )
