"""The files of a run while it marches: each step is in all of them or in none."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress

import numpy as np

from fecloth.errors import FeclothError, InputError, StepFailed
from fecloth.nonlinear.context import SolverContext
from fecloth.output.atomic_files import WriteError, on_disk
from fecloth.output.frame_reader import Frame
from fecloth.output.frames import Frames, fields
from fecloth.output.vtkhdf_writer import HdfFrames
from fecloth.runs import restart as restarts
from fecloth.runs.folder import RunFolder, peak_memory, versions
from fecloth.runs.outcome import FAILED, INTERRUPTED, Outcome, sizes_of
from fecloth.runs.restart import Restart
from fecloth.runs.stopwatch import Watch
from fecloth.scene.problem import Built
from fecloth.simulation.energy_ledger import Ledger, doubt
from fecloth.simulation.march import Memory, StepInfo, march
from fecloth.simulation.probes import Observer
from fecloth.simulation.run import balanced
from fecloth.terms.kinematics import principal_stretches
from fecloth.view.html_report import stretch_row, write_report

FRAMES = {"vtu": (Frames, "run"), "vtkhdf": (HdfFrames, "run.vtkhdf")}
_PCG = 'take linear = "pcg" in [solver], or a coarser mesh.'
_TABLES = ("steps", "energies", "observed", "strains")
_COUNTED = ("newton", "linear", "modified", "factorisations", "rejected")


class Recorder:
    """The open files of a run and what it has counted."""

    def __init__(
        self,
        folder: RunFolder,
        built: Built,
        watch: Watch,
        solver: SolverContext,
        scene: str,
        start: str,
        found: Restart | None = None,
    ):
        self.folder, self.built, self.watch, self.solver = folder, built, watch, solver
        self.scene, self.start = scene, start
        self.state, self.memory = built.state, Memory(0, built.state.t, None)
        frames, name = FRAMES[built.frame_format]
        self.frames = frames(folder.path / name, built.cloth, built.system)
        self.ledger = Ledger.open(built.system, built.state)
        self.observer = Observer.bind(built.system, built.state, built.probes)
        self.tables = {name: folder.table(f"{name}.csv") for name in _TABLES}
        self.turnover, self.doubted = 0.0, False
        self.counts = dict.fromkeys(("steps", *_COUNTED), 0)
        self.safe = 0  # frames that a power cut would leave
        with watch.phase("output"):
            if found:
                self._go_on(found)
            else:
                self._frame()
                self._rows(self.observer.row(None, None))
                if built.restarts:
                    self.restart(regular=True)

    def _go_on(self, found: Restart) -> None:
        """Where that run was, and no file of what it did later."""
        self.state, self.memory, self.ledger = found.state, found.memory, found.ledger
        self.turnover, self.counts = found.turnover, dict(found.counts)
        self.doubted = bool(self.doubt())  # and told
        self.frames.keep(self.tables["strains"].column("t"))
        self.safe = len(self.frames.times)
        restarts.drop_later(self.folder.path, found)
        exactly = "" if found.exact else ", to the solver's tolerance: it had kept a factor"
        self.folder.log(f"goes on from step {found.memory.step} at {found.state.t:g} s{exactly}")
        if changed := restarts.differences(found):
            self.folder.log(f"the last bits may differ: {changed}")

    def restart(self, regular: bool = False) -> None:
        """Write a restart file; a regular one drops what the solver has kept."""
        if regular:
            self.solver.drop()
        restart = Restart(
            scene=self.scene,
            start=self.start,
            method=str(self.built.method),
            state=self.state,
            memory=self.memory,
            ledger=self.ledger,
            turnover=self.turnover,
            counts=self.counts,
            frames=len(self.frames.times),
            tables={name: table.size for name, table in self.tables.items()},
            exact=regular or not self.solver.keeps_state,
            made_on=restarts.machine(),
        )
        frames = self.frames.files(self.safe)
        on_disk(*(table.path for table in self.tables.values()), *frames)
        on_disk(*{file.parent for file in frames} - {self.folder.path})  # that one is, by `write`
        restarts.write(self.folder.path, restart)
        self.safe = len(self.frames.times)

    def marched(self, report, warn, interrupted: threading.Event) -> FeclothError | None:
        """March, and return what ended it before its end; a restart file is left in any case."""
        try:
            self.to_end(report, warn, interrupted)
        except (StepFailed, InputError, MemoryError) as failure:  # a user's function, a full disk
            with suppress(InputError, MemoryError):
                self.restart()
            self.state = getattr(failure, "state", None) or self.state
            if isinstance(failure, MemoryError):
                return FeclothError(f"memory is full ({failure}). Close other programs, or {_PCG}")
            return failure
        except BaseException:  # the second Ctrl-C; what report, or a user's term, raises
            with suppress(InputError):
                self.restart()
            raise
        return None

    def to_end(self, report, warn, interrupted: threading.Event) -> None:
        """March until the end or until interrupted."""
        built = self.built
        if self.state.t >= built.t_end:  # it was killed while it closed
            return
        run_ = built.system, built.method, self.state, built.dt, built.t_end
        options = {"stops": built.stops, "solver": self.solver}
        memory = self.memory if self.memory.step else None
        steps = march(*run_, **options, memory=memory)
        for state, info in steps:
            with self.watch.phase("record"):
                ledger = balanced(built.system, built.method, self.ledger, info)
                observed = self.observer.row(info.old, info.result)
            with self.watch.phase("output"):
                with self._whole_or_not():
                    self._take(state, info, ledger)
                    self._rows(observed, info)
                    if self._due(info):
                        self._frame()
                self._tell_doubt(info, warn)
                if regular := self._restarts(info):
                    self.restart(regular)
            report(info)
            if interrupted.is_set():
                if not regular:
                    self.restart()
                return

    def _tell_doubt(self, info: StepInfo, warn) -> None:
        """Tell of the first step at which the energy balance no longer closes."""
        if self.doubted or not (words := self.doubt()):
            return
        self.doubted = True
        words = f"step {info.step}, at t = {info.t:g} s: {words}"
        self.folder.log(f"warning: {words}")
        warn(words)

    def _take(self, state, info: StepInfo, ledger: Ledger) -> None:
        self._count(info)
        self.state, self.memory, self.ledger = state, info.memory, ledger
        self.turnover = max(self.turnover, ledger.turnover)

    @contextmanager
    def _whole_or_not(self) -> Iterator[None]:
        """A step that cannot be written, or is broken off there, is taken back from all tables."""
        kept = {name: getattr(self, name) for name in ("state", "memory", "ledger", "turnover")}
        counts, frames = dict(self.counts), len(self.frames.times)
        sizes = {name: table.size for name, table in self.tables.items()}
        try:
            yield
        except BaseException:
            vars(self).update(kept, counts=counts)
            del self.frames.times[frames:]
            for name, size in sizes.items():
                self.tables[name].cut(size)
            raise

    def _restarts(self, info: StepInfo) -> bool:
        """Whether a restart file is due after the step."""
        if not (every := self.built.restarts):
            return False
        if isinstance(every, int):
            due = info.step % every == 0
        else:
            times = np.array([info.old.t, info.t]) - info.memory.start
            before, now = np.floor(times / every + 1e-9)
            due = now > before
        return due or info.t >= self.built.t_end

    def _due(self, info: StepInfo) -> bool:
        """Whether the step ends at a frame."""
        built = self.built
        due = (
            info.t in built.stops
            if built.frame_steps is None
            else not info.step % built.frame_steps
        )
        return due or info.t >= built.t_end

    def _count(self, info: StepInfo) -> None:
        counts = info.counts
        self.watch.seconds.setdefault("to_first_step", self.watch.total)
        self.watch.add(counts.seconds)
        self.counts["steps"] = info.step
        for key in _COUNTED:
            self.counts[key] += getattr(counts, key)

    def _rows(self, observed: dict, info: StepInfo | None = None) -> None:
        self.tables["energies"].add(self.ledger.row())
        self.tables["observed"].add(observed)
        if info:
            counts = info.counts
            row = {"step": info.step, "t": info.t, "dt": info.dt, "newton": counts.newton}
            row |= {key: getattr(counts, key) for key in _COUNTED[1:]}
            row |= {"residual": counts.residual, "drift": self.drift}
            self.tables["steps"].add(row)

    @property
    def drift(self) -> float:
        """What the energy balance is off by, relative to what has moved so far."""
        return self.ledger.remainder / self.turnover if self.turnover else 0.0

    def _frame(self) -> None:
        """The state as a frame, and the extremes of its strain."""
        self.frames.add(self.state)
        stretches = principal_stretches(self.built.cloth, self.state.x)
        self.tables["strains"].add(stretch_row(self.state.t, stretches))

    def _report(self, summary: dict) -> None:
        """report.html; a run is none the worse for a page that cannot be made."""
        system, state = self.built.system, self.state
        try:
            frame = Frame(state.t, state.x, system.cloth.cells, *fields(system, state))
            write_report(self.folder.path, summary, frame)
        except Exception as failure:  # whatever it is, how the run ended is told already
            self.folder.log(f"warning: no report: {failure}")

    def doubt(self) -> str:
        """A sentence if the energy balance does not close."""
        return doubt(self.built.system, self.ledger, self.turnover, self.built.state.t)

    def _summary(self, status: str, why: str, error: str | None, warning: str | None) -> dict:
        """What summary.json says."""
        return {
            "status": status,
            "error": error,
            "warning": warning,
            "t": self.state.t,
            "t_end": self.built.t_end,
            **sizes_of(self.built.system),
            "method": str(self.built.method),
            **self.counts,
            "frames": len(self.frames.times),
            "open": self.frames.opens.name,
            "solver": why,
            "seconds": self.watch.seconds | {"total": self.watch.total},
            "ledger": self.ledger.row(),
            "peak_memory_MB": peak_memory(),
            "versions": versions(),
        }

    def _resumes(self) -> float | None:
        """From where a run that ends here goes on [s]: earlier if its solver kept a factor."""
        with suppress(InputError, MemoryError):
            return restarts.find(self.folder.path).state.t
        return None

    def close(self, status: str, why: str, error: FeclothError | None) -> Outcome:
        """The last good state as a frame, the summary, the last line of the log."""
        try:
            with self.watch.phase("output"):
                if self.state.t > self.frames.times[-1] and not isinstance(error, WriteError):
                    self._frame()
        except InputError as full:
            status, error = FAILED, error or full
        for table in self.tables.values():
            table.close()
        warning = self.doubt()
        summary = self._summary(status, why, str(error) if error else None, warning or None)
        words = f"{status} at t = {self.state.t:g} s after {self.counts['steps']} steps"
        resumes = self._resumes()
        if status == INTERRUPTED and resumes is not None:
            words += f"; --resume goes on from {resumes:g} s"
        try:
            self.folder.summary(summary)
            self.folder.log(f"{words}: {error}" if error else words)
            if warning:
                self.folder.log(f"warning: {warning}")
            self._report(summary)
        except InputError as full:
            status, error = FAILED, error or full
        ends = self.ledger, error, warning, resumes
        return Outcome(status, self.folder.path, summary, *ends)
