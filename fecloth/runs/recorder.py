"""The recording of a running scene: each step is in all of its files or in none."""

import threading
from collections.abc import Mapping, Sequence
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
from fecloth.simulation.answer import Answer, answer_quantities, list_answers, refining_command
from fecloth.simulation.doubts.doubt import CHECK, Doubt, warnings_of
from fecloth.simulation.energy_balance import MOST_GROWTH
from fecloth.simulation.record_steps import Record, record_steps
from fecloth.simulation.run import list_accounts, record_of
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


class Recorder:
    """The files and the progress of a run.

    A new run gets its first frame and its first rows when the recorder is made, and a continued
    run loses what was written after its restart file. `march` then takes and records the steps,
    and `close` writes what belongs to the end.

    Parameters
    ----------
    folder
        The folder of the run.
    problem
        The objects of the scene.
    watch
        Counts the wall seconds of the run.
    solver
        The solvers that the steps share.
    scene, start
        The resolved scene, and the `digest` of the mesh and the start, for restart files.
    earlier
        The restart from which a run continues; None for a new run.
    doubts_before_run
        The doubts that were found before the first step.
    refining
        The words of the command that refines the scene; see `Scene.refining`.
    """

    def __init__(
        self,
        folder: RunFolder,
        problem: Problem,
        watch: Watch,
        solver: SolverContext,
        scene: str,
        start: str,
        earlier: Restart | None = None,
        doubts_before_run: Sequence[Doubt] = (),
        refining: tuple[str, ...] = (),
    ):
        self.folder = folder
        self.problem = problem
        self.watch = watch
        self.solver = solver
        self.scene = scene
        self.start = start
        self.doubts_before_run = doubts_before_run
        self.refining = refining
        self.run = Run(
            system=problem.system,
            method=problem.method,
            start=problem.observer.start,
            step=0,
            most_growth=MOST_GROWTH,
            t_end=problem.t_end,
            error_in_time=problem.error_in_time,
        )
        self.files = RunFiles(folder, problem)
        with watch.phase("output"):
            if earlier:
                self.progress = earlier.progress
                self._resume(earlier)
            else:
                self.progress = self._begin()
                if problem.output.restarts:
                    self.restart(is_asked=True)

    def _begin(self) -> Progress:
        """Write the first frame and the first rows of a new run; return its progress.

        Raise `InputError` if the frames of the whole run would not fit on the disk. That is
        known only now, because the first frame tells the size of the others.
        """
        problem = self.problem
        memory = Memory(step=0, start=problem.start.t, method_memory=None)
        kinds = (kind for kind in list_accounts(problem.is_static) if kind not in LAST)
        accounts = Accounts.begin((*kinds, *LAST), self.run, problem.ledger)
        accounts = self._write_frame(problem.start, memory, accounts)
        first_frame = self.files.frames.files(0)[0]
        check_space(self.folder.path, problem, size=first_frame.stat().st_size)
        rows = accounts.rows(problem.observer.row(None, None))
        self.files.add_rows({name: rows[name] for name in ("energies", "observed")})
        return self._progress(problem.start, memory, accounts)

    def _progress(self, state, memory, accounts: Accounts, doubts=(), wanted=None) -> Progress:
        """Return the progress after a step, with the sizes that the tables have now."""
        return Progress(state, memory, accounts, doubts, wanted, tables=self.files.sizes)

    def _resume(self, earlier: Restart) -> None:
        """Remove what the run wrote after its restart file; log from where it goes on."""
        self.files.cut(self.progress)
        at = place_in_words(self.progress.state.t, self.problem.unit)
        self.folder.log(f"goes on from step {self.progress.memory.step} at {at}")
        if differences := restarts.differences(earlier):
            self.folder.log(f"the last bits may differ: {differences}")

    def restart(self, is_asked: bool = False) -> None:
        """Write a restart file.

        One that the scene asks for first drops the factor that the solver holds. So the unbroken
        run goes on without it, as a continued run does, and both agree bit for bit. Any other
        one would not be exact while the solver holds a factor. Then it is written only if the
        scene asks for none, so that there is no exact one to continue from.
        """
        if is_asked:
            self.solver.drop()
        elif self.problem.output.restarts and self.solver.keeps_state:
            return
        self.files.commit(
            Restart(
                scene=self.scene,
                start=self.start,
                method=str(self.problem.method),
                progress=self.progress,
                made_on=restarts.machine(),
            )
        )

    def march(self, report, warn, interrupted: threading.Event) -> FeclothError | None:
        """Take and record all steps; return the error that ended them early, or None.

        `report` is called with the `StepInfo` of each step, `warn` with each new doubt, and
        the steps end where `interrupted` is set. After an error a restart file is written, if
        that is possible. Errors of `report`, and a second signal, pass on.
        """
        try:
            self._march_to_end(report, warn, interrupted)
        except (StepFailed, InputError, MemoryError) as failure:  # InputError: also a full disk
            with suppress(InputError, MemoryError):
                self.restart()
            # The state of a failure goes into the last frame; no restart begins from it.
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
        """Take and record the steps to the end, or until `interrupted` is set.

        Raise `InputError` after `MOST_STEPS` steps, and the errors of a step or a file.
        """
        problem = self.problem
        begin = self.progress
        if begin.state.t >= problem.t_end:  # the run was killed while it wrote its end
            return
        steps = problem.march(self.solver, begin.state, begin.memory, begin.wanted)
        accounts = begin.accounts
        next_row = problem.next_row
        for record in record_steps(steps, self.run, problem.observer, accounts, next_row):
            info = record.info
            if info.step > MOST_STEPS:
                allowed = f"must be at most {MOST_STEPS}"
                remedy = "Raise rtol, or lower t_end."
                raise InputError(f"step {info.step}", allowed, remedy=remedy)
            self.watch.add({"record": record.seconds})
            self.run = record.run
            with self.watch.phase("output"):
                self.folder.check_in_place()
                self._record_step(record)
                self._warn(self.progress.accounts, warn)
                if is_restart_due := self._is_restart_due(info):
                    self.restart(is_asked=True)
            report(info)
            if interrupted.is_set():
                if not is_restart_due:  # else this step has its restart file already
                    self.restart()
                return

    def _record_step(self, record: Record) -> None:
        """Write a step to all files and replace `progress`.

        If a file cannot be written, or a signal comes, remove the step from all files again and
        raise the error.
        """
        info = record.info
        before = self.progress
        self.watch.seconds.setdefault("to_first_step", self.watch.total)
        self.watch.add(info.counts.seconds)
        accounts = record.accounts.with_record(before.accounts[Shapes])
        try:
            if not info.is_part:  # a part of a step has a frame at most, and no rows
                counts = info.counts
                row = {"step": info.step, "t": info.t, "dt": info.dt, "newton": counts.newton}
                row |= {key: getattr(counts, key) for key in SUMMED[1:]}
                steps = {**row, "residual": counts.residual, **record.rows["steps"]}
                self.files.add_rows({**record.rows, "steps": steps})
            elif info.counts.rejected:
                self.folder.log(
                    f"step {info.step} to {info.t:.6g} s is repeated with {info.dt:.3g} s, after "
                    f"{amount(info.counts.rejected, 'longer attempt')} without a solution"
                )
            if self._is_frame_due(info):
                ended = info.t >= self.problem.t_end
                accounts = self._write_frame(record.state, info.memory, accounts, ended)
            self.progress = self._progress(
                record.state, info.memory, accounts, doubts=before.doubts, wanted=record.wanted
            )
        except BaseException:
            self.progress = before
            with suppress(InputError):  # the first error is the one to report
                self.files.cut(before)
            raise

    def _write_frame(
        self, state: State, memory: Memory | None, accounts: Accounts, ended: bool = False
    ) -> Accounts:
        """Write a frame with its row of strains.csv, and return the accounts after it.

        Intersections are counted if the scene asks for it and the last count was long enough
        ago, or if the run has `ended`.
        """
        cells = self.files.add_frame(state, memory)
        shape = accounts[Shapes]
        step = accounts[Solves].steps
        steps_between_counts = STEPS_BETWEEN_COUNTS[self.problem.method.traits.explicit]
        is_count_due = ended or step - shape.counted >= steps_between_counts
        counts_now = self.problem.output.intersections and is_count_due
        shape, row = shape.at_frame(self.run, state, cells, step, counts_now)
        self.files.add_rows({"strains": row})
        return accounts.with_record(shape)

    def _warn(self, accounts: Accounts, warn) -> None:
        """Add the new doubts of the accounts to the progress; log them and call `warn`."""
        for doubt in accounts.new_doubts(self.progress.doubts):
            self.progress = replace(self.progress, doubts=(*self.progress.doubts, doubt))
            with suppress(WriteError):  # `warn` reports it; the next line fails the run
                self.folder.log(doubt.line)
            warn(doubt)

    def _is_restart_due(self, info: StepInfo) -> bool:
        """Whether the scene asks for a restart file after this step.

        It is due at each interval and at the end of the run.
        """
        interval = self.problem.output.restarts
        if not interval:
            return False
        if isinstance(interval, int):  # steps
            is_due = info.step % interval == 0
        else:  # seconds: the step has passed a multiple of them, up to round-off
            times = np.array([info.old.t, info.t]) - info.memory.start
            intervals_before, intervals_now = np.floor(times / interval + 1e-9)
            is_due = intervals_now > intervals_before
        return is_due or info.t >= self.problem.t_end

    def _is_frame_due(self, info: StepInfo) -> bool:
        """Whether the scene asks for a frame after this step, or the run has reached its end."""
        if info.t >= self.problem.t_end:
            return True
        steps_between_frames = self.problem.frame_steps
        if steps_between_frames is None:
            return info.t in self.problem.stops
        return info.step % steps_between_frames == 0

    def close(self, status: str, why: str, error: FeclothError | None, warn) -> SceneResult:
        """Write what belongs to the end of a run, and return its result.

        That is a frame of the last good state, summary.json, the report and the last lines of
        the log. `status` is how the run ended, `why` the reason for the choice of its solver,
        `error` the failure of its steps, and `warn` is called with each new doubt. If a file
        cannot be written, the status becomes "failed", with that error if there is no other.
        """
        state = self.progress.state
        try:
            with self.watch.phase("output"):
                has_frame = state.t <= self.files.frames.times[-1]
                if not has_frame and not isinstance(error, WriteError):
                    memory = self.progress.memory
                    accounts = self.progress.accounts
                    accounts = self._write_frame(state, memory, accounts, ended=True)
                    self.progress = replace(self.progress, accounts=accounts)
                if status == DONE:
                    self.files.gather()
        except InputError as disk_error:
            status = FAILED
            error = error or disk_error
        self.files.close()
        steps = self.progress.accounts[Solves].steps
        end = End(state, steps, is_whole=state.t >= self.problem.t_end)
        with self.watch.phase("output"):
            accounts = self.progress.accounts.finish(self.run, end)
        self._warn(accounts, warn)
        tables = {name: read_table(table.path) for name, table in self.files.tables.items()}
        answers = self._answer(status, tables, accounts)
        summary = self._summarise(status, why, str(error) if error else None, accounts, answers)
        place = place_in_words(state.t, self.problem.unit)
        words = f"{status} at {place} after {amount(steps, 'step')}"
        resumes: float | None = None  # without a restart file
        with suppress(InputError, MemoryError):
            resumes = restarts.find(self.folder.path).progress.state.t
        if status == INTERRUPTED and resumes is not None:
            words += f"; --resume goes on from {resumes:g}{self.problem.unit}"
        try:
            details = outcome.list_details(accounts, summary)
            lines = [*details, *list_answers(answers, self.refining)]
            for line in (*lines, f"{words}: {error}" if error else words):
                self.folder.log(line)
            self._report(summary, tables, answers)
            self.folder.summary(summary)
        except InputError as disk_error:
            status = FAILED
            error = error or disk_error
        return self._make_result(status, summary, tables, accounts, answers, error, resumes)

    @property
    def doubts(self) -> tuple[Doubt, ...]:
        """All doubts of the run, first the doubts before the first step."""
        return (*self.doubts_before_run, *self.progress.doubts)

    def _answer(self, status: str, tables: Mapping, accounts: Accounts) -> dict[str, Answer]:
        """Return the answers to the quantities of the scene; {} of a run that ended early."""
        if status != DONE:
            return {}
        observer = self.problem.observer
        energies, observed = columns_of(tables)
        times = tables["energies"]["t"]
        record = record_of(observer, self.progress.state, times, energies, observed)
        return answer_quantities(self.problem.asked, record, accounts, self.problem.measured)

    def _summarise(
        self,
        status: str,
        why: str,
        failure: str | None,
        accounts: Accounts,
        answers: Mapping[str, Answer],
    ) -> dict:
        """Return the content of summary.json.

        `failure` is the message of the error that ended the run; `why` is the reason for the
        choice of the solver.
        """
        warnings = list(warnings_of(self.doubts))
        return {
            "status": status,
            "error": failure,
            "quantities": {name: answer.entry() for name, answer in answers.items()},
            "warnings": warnings,
            "warning": next(iter(warnings), None),  # as older runs have it
            "doubts": [doubt.entry() for doubt in self.doubts],
            "t": self.progress.state.t,
            "t_end": self.problem.t_end,
            "unit": self.problem.unit,
            **accounts.summary(),
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
        }

    def _report(self, summary: dict, tables: dict, answers: Mapping[str, Answer]) -> None:
        """Write report.html; if that fails, log why."""
        tiles = {}
        for name, answer in answers.items():
            command = refining_command(name, answer, self.refining)
            tiles[name] = (answer.in_words(), command, answer.measured_in_words)
        doubts = map(Doubt.of_entry, summary["doubts"])
        checks = [doubt.line for doubt in doubts if doubt.kind.label == CHECK]
        try:
            frame = self.files.frame(self.progress.state, self.progress.memory)
            obstacles = self.files.obstacles.last
            write_report(self.folder.path, summary, tables, frame, obstacles, tiles, checks)
        except Exception as failure:  # no error of a page may lose the result
            self.folder.log(f"warning: no report: {failure}")

    def _make_result(
        self, status: str, summary: dict, tables: dict, accounts: Accounts, answers, error, resumes
    ):
        """Return the `SceneResult`, with the energies and observed columns of the tables."""
        energies, observed = columns_of(tables)
        return SceneResult(
            state=self.progress.state,
            times=tables["energies"].get("t", np.empty(0)),
            energies=energies,
            observed=observed,
            seconds=summary["seconds"],
            solver=summary["solver"],
            method=self.problem.method,
            doubts=self.doubts,
            accounts=accounts,
            quantities=answers,
            status=status,
            folder=self.folder.path,
            summary=summary,
            error=error,
            resumes=resumes,
            refining=self.refining,
        )


def columns_of(tables: Mapping[str, Mapping]) -> tuple[dict, dict]:
    """Return the columns of the energies and of what was observed, without the times."""
    energies, observed = (
        {name: column for name, column in tables[table].items() if name != "t"}
        for table in ("energies", "observed")
    )
    return energies, observed
