"""The files of a running scene: each step is in all of them or in none."""

from __future__ import annotations

import math
import re
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Any

import numpy as np

from fecloth.errors import FeclothError, InputError, StepFailed
from fecloth.nonlinear.context import SolverContext
from fecloth.nonlinear.statistics import SUMMED, describe_newton_error, warn_of_round_off
from fecloth.output.atomic_files import WriteError, flush_to_disk
from fecloth.output.frame_arrays import fields
from fecloth.output.frame_reader import Frame
from fecloth.output.frames import Frames
from fecloth.output.obstacle_frames import ObstacleFrames
from fecloth.output.vtkhdf_writer import HdfFrames
from fecloth.runs import restart as restarts
from fecloth.runs.disk_space import MOST_FRAMES, check_space
from fecloth.runs.environment import peak_memory, versions
from fecloth.runs.folder import RunFolder
from fecloth.runs.outcome import (
    FAILED,
    INTERRUPTED,
    SceneResult,
    count_sizes,
    place_in_words,
    read_columns,
)
from fecloth.runs.restart import Restart
from fecloth.runs.shape_watch import ShapeWatch, last_count, shape_summary
from fecloth.runs.stopwatch import Watch
from fecloth.runs.strain_statistics import stretch_row
from fecloth.scene.problem import Problem
from fecloth.scene.time_table import MOST_STEPS
from fecloth.simulation.contact_words import describe_contact
from fecloth.simulation.energy_balance import Balance
from fecloth.simulation.march import StepInfo
from fecloth.simulation.record_steps import MOST_GROWTH, Record, record_steps
from fecloth.simulation.rest_stability import RestStability
from fecloth.simulation.time_error import TimeError, relative_error
from fecloth.simulation.time_error_words import describe_time_error, find_doubts
from fecloth.system.space_error import SpaceError, space_error
from fecloth.view.html_report import write_report
from fecloth.view.web_page import keep_shown

FRAMES = {"vtu": (Frames, "run"), "vtkhdf": (HdfFrames, "run.vtkhdf")}
_PCG = 'use linear = "pcg" in [solver], or a coarser mesh.'
_TABLES = ("steps", "energies", "observed", "strains")
_OBSERVED = ("energies", "observed")
_SO_FAR = ("state", "memory", "ledger", "balance", "time_error", "counted")


class Recorder:
    """The open files of a run, and its counts."""

    def __init__(
        self,
        folder: RunFolder,
        problem: Problem,
        watch: Watch,
        solver: SolverContext,
        scene: str,
        start: str,
        found: Restart | None = None,
        foreseen: Sequence[str] = (),
    ):
        self.folder, self.problem, self.watch, self.solver = folder, problem, watch, solver
        self.scene, self.start = scene, start
        self.state, self.memory = problem.state, problem.first_memory
        frames, name = FRAMES[problem.frame_format]
        self.frames = frames(folder.path / name, problem.cloth, problem.system)
        self.ledger = problem.ledger
        self.obstacles = ObstacleFrames(folder.path, problem.system, problem.state.x)
        self.shown: Frame | None = None  # the last frame written
        self.watched = ShapeWatch.bind(problem)
        self.seen: dict[str, float] = {}  # its row of strains.csv
        self.counted = -math.inf  # the step of the last count of intersections
        self.tables = {name: folder.table(f"{name}.csv") for name in _TABLES}
        self.balance = Balance.open(problem.ledger)
        self.time_error = TimeError.open(problem.state, 0, problem.ledger)
        self.foreseen = foreseen  # warnings before the first step
        self.raised: tuple[str, ...] = ()  # since
        self.counts: dict[str, Any] = dict.fromkeys(("steps", *SUMMED), 0)
        self.frames_on_disk = 0  # frames that would survive a power cut
        with watch.phase("output"):
            if found:
                self._resume(found)
            else:
                self._frame()
                check_space(folder.path, problem, self.frames.files(0)[0].stat().st_size)
                self._rows(problem.observer.row(None, None))
                if problem.restarts:
                    self.restart(regular=True)

    def _resume(self, found: Restart) -> None:
        """Take the state of an earlier run, and remove what it wrote later."""
        self.state, self.memory, self.ledger = found.state, found.memory, found.ledger
        self.balance, self.counts = found.balance, dict(found.counts)
        self.time_error = found.time_error
        self.raised = found.warnings
        self.frames.keep(self.tables["strains"].column("t"))
        self.frames_on_disk = len(self.frames.times)
        self.obstacles.keep(self.frames.times)
        self.counted = last_count(self.tables["strains"], self.tables["steps"])
        restarts.drop_later(self.folder.path, found)
        exactly = "" if found.exact else ", exact to the solver's tolerance only: a factor was lost"
        at = place_in_words(found.state.t, self.problem.unit)
        self.folder.log(f"goes on from step {found.memory.step} at {at}{exactly}")
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
            state=self.state,
            memory=self.memory,
            ledger=self.ledger,
            balance=self.balance,
            time_error=self.time_error,
            warnings=self.raised,
            counts=self.counts,
            frames=len(self.frames.times),
            tables={name: table.size for name, table in self.tables.items()},
            exact=regular or not self.solver.keeps_state,
            made_on=restarts.machine(),
        )
        frames = self.frames.files(self.frames_on_disk)
        flush_to_disk(*(table.path for table in self.tables.values()), *frames)
        # `write` flushes the folder of the run
        flush_to_disk(*{file.parent for file in frames} - {self.folder.path})
        restarts.write(self.folder.path, restart)
        self.frames_on_disk = len(self.frames.times)

    def march(self, report, warn, interrupted: threading.Event) -> FeclothError | None:
        """March, and return the error that ended it early; leave a restart file in any case."""
        try:
            self._march_to_end(report, warn, interrupted)
        except (StepFailed, InputError, MemoryError) as failure:  # InputError: also a full disk
            with suppress(InputError, MemoryError):
                self.restart()
            self.state = getattr(failure, "state", None) or self.state
            if isinstance(failure, MemoryError):
                return FeclothError(f"memory is full ({failure}). Close other programs, or {_PCG}")
            return failure
        except BaseException:  # the second Ctrl-C; errors of report or of a user's term
            with suppress(InputError):
                self.restart()
            raise
        return None

    def _march_to_end(self, report, warn, interrupted: threading.Event) -> None:
        """March until the end or until interrupted."""
        problem = self.problem
        if self.state.t >= problem.t_end:  # it was killed while it closed
            return
        steps = problem.march(self.solver, self.state, self.memory)
        start = problem.system, problem.method, self.ledger, problem.observer
        growth = math.inf if problem.is_static else MOST_GROWTH
        so_far = self.balance, self.time_error
        records = record_steps(
            steps, *start, *so_far, most_growth=growth, next_row=problem.next_row
        )
        for record in records:
            info = record.info
            if info.step > MOST_STEPS:
                allowed, remedy = f"must be at most {MOST_STEPS}", "Raise rtol, or lower t_end."
                raise InputError(f"step {info.step}", allowed, remedy=remedy)
            self.watch.add({"record": record.seconds})
            with self.watch.phase("output"):
                self.folder.check_in_place()
                with self._all_or_nothing():
                    self._take(record)
                    self._rows(record.observed, info)
                    if self._is_frame_due(info):
                        self._frame(ended=info.t >= problem.t_end)
                self._warn_once(self.balance.warning(self.ledger), warn)
                if self._is_frame_due(info):
                    self._warn_of_shape(warn)
                if regular := self._is_restart_due(info):
                    self.restart(regular)
            report(info)
            if interrupted.is_set():
                if not regular:
                    self.restart()
                return

    def _warn_of_shape(self, warn) -> None:
        """Warn of what the last frame shows."""
        for words in self.watched.warnings(self.seen) if self.seen else ():
            self._warn_once(words, warn)

    def _warn_once(self, words: str, warn) -> None:
        """Report the first warning of each kind; those of one kind differ only in numbers."""
        if not words or _kind(words) in map(_kind, self.raised):
            return
        self.raised += (words,)
        with suppress(WriteError):  # `warn` reports it; the next line fails the run
            self.folder.log(f"warning: {words}")
        warn(words)

    def _take(self, record: Record) -> None:
        self._count(record.info)
        self.state, self.memory = record.state, record.info.memory
        self.ledger, self.balance, self.time_error = (
            record.ledger,
            record.balance,
            record.time_error,
        )

    @contextmanager
    def _all_or_nothing(self) -> Iterator[None]:
        """Remove a step from all tables if writing it fails or is interrupted."""
        before = {name: getattr(self, name) for name in _SO_FAR}
        counts, frames = dict(self.counts), len(self.frames.times)
        sizes = {name: table.size for name, table in self.tables.items()}
        try:
            yield
        except BaseException:
            vars(self).update(before, counts=counts)
            del self.frames.times[frames:]
            for name, size in sizes.items():
                self.tables[name].cut(size)
            raise

    def _is_restart_due(self, info: StepInfo) -> bool:
        """Return whether a restart file is due after the step."""
        if not (every := self.problem.restarts):
            return False
        if isinstance(every, int):
            due = info.step % every == 0
        else:
            times = np.array([info.old.t, info.t]) - info.memory.start
            before, now = np.floor(times / every + 1e-9)
            due = now > before
        return due or info.t >= self.problem.t_end

    def _is_frame_due(self, info: StepInfo) -> bool:
        """Return whether the step ends at a frame."""
        problem = self.problem
        due = (
            info.t in problem.stops
            if problem.frame_steps is None
            else not info.step % problem.frame_steps
        )
        return due or info.t >= problem.t_end

    def _count(self, info: StepInfo) -> None:
        counts = info.counts
        self.watch.seconds.setdefault("to_first_step", self.watch.total)
        self.watch.add(counts.seconds)
        self.counts["steps"] = info.step
        for key in SUMMED:
            self.counts[key] += getattr(counts, key)

    def _rows(self, observed: dict, info: StepInfo | None = None) -> None:
        self.tables["energies"].add(self.ledger.row())
        self.tables["observed"].add(observed)
        if info:
            counts = info.counts
            row = {"step": info.step, "t": info.t, "dt": info.dt, "newton": counts.newton}
            row |= {key: getattr(counts, key) for key in SUMMED[1:]}
            row |= {"residual": counts.residual, "drift": self.drift}
            self.tables["steps"].add(row)

    @property
    def drift(self) -> float:
        """Remainder of the energy balance relative to the largest energy of deformation so far."""
        return self.ledger.remainder / self.balance.scale if self.balance.scale else 0.0

    def _frame(self, ended: bool = False) -> None:
        """Write the state as a frame, the extremes of its strain, and what else its shape shows."""
        self.folder.check_in_place()
        if len(self.frames.times) >= MOST_FRAMES:
            remedy = "Raise every, or lower frames, in [output]."
            raise InputError("one frame more", f"must be at most {MOST_FRAMES}", remedy=remedy)
        arrays = fields(self.problem.system, self.state, self.problem.error_density)
        self.obstacles.add(len(self.frames.times), self.state)
        self.frames.add(self.state, arrays)
        self.shown = keep_shown(
            Frame(self.state.t, self.state.x, self.problem.cloth.cells, *arrays)
        )
        row = stretch_row(self.state.t, arrays[1]["principal_stretches"])
        counts = self.watched.is_due(self.counts["steps"] - self.counted, ended)
        self.seen = row | self.watched.row(self.state, arrays[1], counts)
        self.tables["strains"].add(self.seen)
        self.counted = self.counts["steps"] if counts else self.counted

    def _report(self, summary: dict) -> None:
        """Write report.html; a failure to write it must not fail the run."""
        system, state, frame = self.problem.system, self.state, self.shown
        try:
            if frame is None or frame.points is not state.x:
                frame = Frame(state.t, state.x, system.cloth.cells, *fields(system, state))
            write_report(self.folder.path, summary, frame, self.obstacles.last)
        except Exception as failure:  # of any kind: all else is written
            self.folder.log(f"warning: no report: {failure}")

    @property
    def warnings(self) -> list[str]:
        """All warnings of the run, those before the first step first."""
        return [*self.foreseen, *self.raised]

    @property
    def mean_dt(self) -> float:
        """Mean size of the steps so far [s]; NaN before the first one."""
        steps = self.counts["steps"]
        return (self.state.t - self.problem.state.t) / steps if steps else math.nan

    def _doubts(self, warn) -> dict:
        """Return how wrong the run is, for the summary, and warn of what casts doubt on it."""
        self._warn_once(self.balance.warning(self.ledger, ended=True), warn)
        return self._rest(warn) if self.problem.is_static else self._time_error(warn)

    def _rest(self, warn) -> dict:
        """Return whether the equilibrium is stable, and warn if it is not."""
        if self.state.t < self.problem.t_end:
            return {"time_error": None, "time_error_in_words": "equilibrium: not reached"}
        rest = RestStability.of(self.problem.system, self.state)
        self._warn_once(rest.warning, warn)
        least = None if math.isnan(rest.least) else rest.least
        return {
            "time_error": None,
            "time_error_in_words": rest.words,
            "least_eigenvalue": least,
        }

    def _time_error(self, warn) -> dict:
        """Return the error in time, and warn if it is large."""
        problem, last = self.problem, (self.state, self.counts["steps"], self.ledger)
        error = relative_error(self.time_error, problem.system, problem.method, *last)
        run = problem.system, problem.method, self.mean_dt
        for words in find_doubts(error, *run, self.balance, self.ledger):
            self._warn_once(words, warn)
        return {
            "time_error": None if math.isnan(error) else error,
            "time_error_in_words": describe_time_error(error, problem.method, self.mean_dt),
        }

    def _summary(self, status: str, why: str, failure: str | None, doubts: dict) -> dict:
        """Return the content of summary.json; `doubts` say how wrong the run is."""
        return {
            "status": status,
            "error": failure,
            "warnings": self.warnings,
            "warning": next(iter(self.warnings), None),  # as older runs have it
            "t": self.state.t,
            "t_end": self.problem.t_end,
            "unit": self.problem.unit,
            **doubts,
            **count_sizes(self.problem.system),
            "method": str(self.problem.method),
            **self.counts,
            "newton_error_in_words": self._newton_error,
            **self._shape_summary(),
            "frames": len(self.frames.times),
            "open": self.frames.opens.name,
            "solver": why,
            "threads": self.problem.system.team.used,
            "seconds": self.watch.seconds | {"total": self.watch.total},
            "ledger": self.ledger.row(),
            "peak_memory_MB": peak_memory(),
            **self.problem.system.usage(),
            "versions": versions(),
        }

    def _contact(self) -> dict[str, str]:
        """Return the entry of the summary about contact, none without obstacles."""
        system, start = self.problem.system, self.problem.observer.start
        words = describe_contact(system, start, self.state)
        return {"contact_in_words": words} if words else {}

    @property
    def _newton_error(self) -> str:
        names = ("steps", "estimated", "newton_error", "step_error")
        return describe_newton_error(*(self.counts[name] for name in names))

    def _shape_summary(self) -> dict:
        """Return what strains.csv says; nothing if its folder has moved."""
        with suppress(WriteError):
            return shape_summary(self.tables["strains"])
        return {}

    def _resume_time(self) -> float | None:
        """Return the time from which `--resume` goes on [s]; None without a restart file."""
        with suppress(InputError, MemoryError):
            return restarts.find(self.folder.path).state.t
        return None

    def close(self, status: str, why: str, error: FeclothError | None, warn) -> SceneResult:
        """Write the last good state as a frame, the summary, the last line of the log."""
        try:
            with self.watch.phase("output"):
                if self.state.t > self.frames.times[-1] and not isinstance(error, WriteError):
                    self._frame(ended=True)
        except InputError as full:
            status, error = FAILED, error or full
        for table in self.tables.values():
            table.close()
        doubts = self._doubts(warn)
        self._warn_once(warn_of_round_off(self.counts["limited"]), warn)
        self._warn_of_shape(warn)
        with self.watch.phase("output"):
            space = space_error(self.problem.system, self.state)
        doubts["space_error"] = None if math.isnan(space.relative) else space.relative
        doubts["space_error_in_words"] = str(space)
        doubts |= self._contact()
        summary = self._summary(status, why, str(error) if error else None, doubts)
        place = place_in_words(self.state.t, self.problem.unit)
        words = f"{status} at {place} after {self.counts['steps']} steps"
        resumes = self._resume_time()
        if status == INTERRUPTED and resumes is not None:
            words += f"; --resume goes on from {resumes:g}{self.problem.unit}"
        try:
            self.folder.log(summary["time_error_in_words"])
            self.folder.log(summary["space_error_in_words"])
            for name in ("newton_error_in_words", "contact_in_words"):
                if summary.get(name):
                    self.folder.log(summary[name])
            self.folder.log(f"{words}: {error}" if error else words)
            self._report(summary)
            self.folder.summary(summary)  # last: `--resume` writes all of this if it is missing
        except InputError as full:
            status, error = FAILED, error or full
        return self._result(status, summary, space, error, resumes)

    def _result(self, status: str, summary: dict, space: SpaceError, error, resumes) -> SceneResult:
        energies, observed = (read_columns(self.tables[name].path) for name in _OBSERVED)
        times = energies.pop("t", np.empty(0))
        observed.pop("t", None)
        return SceneResult(
            state=self.state,
            times=times,
            energies=energies,
            observed=observed,
            seconds=summary["seconds"],
            newton=self.counts["newton"],
            linear=self.counts["linear"],
            solver=summary["solver"],
            method=self.problem.method,
            shape=self.watched.shape(self.state, self.seen),
            warnings=tuple(self.warnings),
            time_error=math.nan if summary["time_error"] is None else summary["time_error"],
            space_error=space.relative,
            space_error_reason=space.reason,
            steps=self.counts["steps"],
            contact_in_words=summary.get("contact_in_words", ""),
            status=status,
            folder=self.folder.path,
            summary=summary,
            ledger=self.ledger,
            error=error,
            resumes=resumes,
        )


def _kind(words: str) -> str:
    """Return the first words of a warning, without numbers."""
    return re.sub(r"[-+.\de]*\d", "", words)[:50]
