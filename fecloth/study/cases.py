"""Run the cases of a study, store each result on disk, and continue an interrupted study."""

import hashlib
import inspect
import json
import math
import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from fecloth import __version__
from fecloth.errors import InputError
from fecloth.output.atomic_files import replace_file
from fecloth.study import status
from fecloth.study.fingerprint import source_hash
from fecloth.study.processes import run_in_processes, run_on_cluster
from fecloth.study.work import ANYWAY, in_words

LONGEST_CAUSE = 100  # characters of a cause in a progress line: one line of a wide terminal


class Progress:
    """Prints a line for each finished case, with the time left by what the cases took.

    Parameters
    ----------
    costs
        Estimated costs of the cases to run, in any unit.
    stored
        Number of cases that an earlier run has finished.
    at_once
        Number of cases that run side by side.
    most_seconds
        Time left after the first case above which the study stops [s]; None for no limit.
    quiet
        Whether nothing is printed.
    clock
        Returns the seconds since any fixed time.
    """

    def __init__(
        self,
        costs: Sequence[float],
        stored: int = 0,
        at_once: int = 1,
        most_seconds: float | None = None,
        quiet: bool = False,
        clock: Callable[[], float] = time.perf_counter,
    ):
        self.count = len(costs)
        self.cost = sum(costs)
        self.at_once = at_once
        self.most_seconds = most_seconds
        self.clock = clock
        self.quiet = quiet
        self.done = 0
        self.spent = 0.0  # estimated cost of the finished cases
        self.measured = 0.0  # estimated cost of those which measured their seconds
        self.seconds = 0.0  # what these took, without imports and machine code
        self.begin = clock()
        self.stored = stored
        self.told = 0  # stored cases that a line has counted
        self.tell_stored()

    def leave_out(self, costs: Sequence[float]) -> None:
        """Leave out cases of these costs: their results are stored."""
        self.count -= len(costs)
        self.cost -= sum(costs)
        self.stored += len(costs)

    def tell_stored(self) -> None:
        """Print how many results are stored, if no line has counted all of them."""
        if self.stored > self.told and not self.quiet:
            words = f"cases already stored: {self.stored} of {self.stored + self.count}"
            print(words, file=sys.stderr)
        self.told = self.stored

    @property
    def elapsed(self) -> float:
        """Time by the clock since the begin [s]."""
        return self.clock() - self.begin

    def add(self, cost: float, seconds: float | None = None) -> None:
        """Count a finished case of an estimated cost that took so many seconds.

        A case without seconds, as one that failed before its end, tells nothing about others.
        """
        self.done += 1
        self.spent += cost
        if seconds is not None:
            self.measured += cost
            self.seconds += seconds

    @property
    def seconds_left(self) -> float:
        """Time left [s]: what the finished cases took, in proportion to the costs left.

        Without a case that measured its seconds, they took the time by the clock.
        """
        left = self.cost - self.spent
        if self.measured:
            return left * self.seconds / self.measured / self.at_once
        return left * self.elapsed / self.spent

    def print(self, words: str, result: dict, cost: float) -> None:
        """Count a finished case, and print a line that says which case it was and how it ended.

        `words` describe the case, `result` is its row with `status` and `cause`, and `cost` its
        estimated cost. With `quiet` the case is counted, but nothing is printed. Raise
        `InputError` if the other cases will take longer than `most_seconds`.
        """
        self.tell_stored()
        self.add(cost, result.get("case_seconds"))
        if self.quiet:
            return
        times = f"{self.elapsed:.0f} s"
        if self.done < self.count:
            times += f", about {in_words(self.seconds_left)} left"
        line = f"[{self.done}/{self.count}, {times}] {words}: {_describe(result)}"
        print(line, file=sys.stderr, flush=True)
        limit = math.inf if self.most_seconds is None else self.most_seconds
        if self.done == 1 and self.seconds_left > limit:
            what = (
                f"after the first of {self.count} cases, about {in_words(self.seconds_left)} left"
            )
            allowed = f"must be at most {limit:,.0f} s"
            raise InputError(what, allowed, remedy=f"Take fewer or smaller cases; {ANYWAY}")


def _describe(result: dict) -> str:
    """Return the status, and the first words of the cause of a failure."""
    if not result["cause"]:
        return result["status"]
    cause = result["cause"].splitlines()[0]
    if len(cause) > LONGEST_CAUSE:
        cause = f"{cause[:LONGEST_CAUSE].rpartition(' ')[0]} …"
    return f"{result['status']}: {cause}"


Number = float | int | str | bool | None


INTERRUPTED = "with cases to run; run it again to go on: finished cases are stored"
HIDDEN = ("path", "digest", "content", "text", "tables")  # settings that say nothing to a reader


def describe_settings(settings: Mapping) -> str:
    """Return settings in words, without paths, hashes, contents of files and None.

    A value is shortened to 40 characters.
    """
    shown = {key: value for key, value in settings.items() if key not in HIDDEN}
    words = {key.replace("_", " "): value for key, value in shown.items() if value is not None}
    return ", ".join(f"{key} {' '.join(str(v).split())[:40]}" for key, v in words.items())


@dataclass(frozen=True)
class Case:
    """Settings and the function that runs them, identified by file and name.

    Attributes
    ----------
    settings
        Keyword arguments of the function, in JSON's types.
    file
        The file that defines the function; other processes import it from there.
    name
        The name of the function.
    source
        Hash of the sources on which the result depends, from `source_hash`.
    """

    settings: Mapping[str, object]
    file: str
    name: str
    source: str = field(default="", repr=False)

    @classmethod
    def of(cls, function: Callable[..., dict], settings: Mapping[str, object]) -> "Case":
        """Return the case of a module-level function with these settings.

        Raises `InputError` for a function that is not at the top level of its module, and for
        settings that JSON cannot write, or reads back as something else, such as a tuple.
        """
        file = inspect.getsourcefile(function) or ""
        # "<" is in the name of a lambda or of a function in a function, "." in that of a method
        if "<" in function.__qualname__ or "." in function.__qualname__:
            what = f"function = {function.__qualname__}"
            remedy = "Define it at the top level of a file, so that other processes can import it."
            raise InputError(what, "must be a module-level function", "run_cases", remedy)
        path = str(Path(file).resolve())
        case = cls(
            settings=dict(settings),
            file=path,
            name=function.__name__,
            source=source_hash(file),
        )
        if json.loads(case.text) != case.settings:
            what = f"settings = {case.settings}"
            raise InputError(what, "must be what JSON reads back: lists, no tuples", "run_cases")
        return case

    @property
    def text(self) -> str:
        """Settings as JSON with sorted keys."""
        try:
            return json.dumps(self.settings, sort_keys=True)
        except TypeError as error:
            what = f"settings = {dict(self.settings)}"
            raise InputError(what, f"must be JSON-able: {error}", "run_cases") from error

    @property
    def key(self) -> str:
        """Hash of everything on which the result depends."""
        parts = (self.text, Path(self.file).name, self.name, __version__, self.source)
        return hashlib.sha256("\n".join(parts).encode()).hexdigest()[:24]


def run_cases(
    cases: Iterable[Mapping[str, object]],
    function: Callable[..., dict[str, Number]],
    out: str | Path | None,
    jobs: int = 1,
    scheduler: str | None = None,
    time_limit: float | None = None,
    fresh: bool = False,
    label: Callable[[Mapping], str] = describe_settings,
    costs: Sequence[float] | None = None,
    most_seconds: float | None = None,
    quiet: bool = False,
    progress: Progress | None = None,
) -> list[dict[str, object]]:
    """Run `function(**settings)` for the settings of each case; rows in the order of the cases.

    A row holds the settings, the returned numbers and strings, `status` and `cause`. The
    function may also return lists of numbers, for figures; results.csv omits them. The row of
    a failed case has no results.

    Each result is written to OUT/cache at once, and is read from there the next time, unless the
    settings, fecloth, the study's file, its imports or its scenes have changed. If a case reads
    any other file, put the contents of the file into its settings. Raises `InputError` if the
    function is not at the top level of a file, or if the settings cannot be written as JSON.

    Parameters
    ----------
    out
        Folder of the results; None stores and reads none.
    jobs
        Number of processes, each with one thread; 1 runs the cases in this process.
    scheduler
        Address of a Dask scheduler whose workers see the same files under the same paths; None
        for this machine.
    time_limit
        Largest CPU time of a case [s]. Processes are ended; in this process and on a cluster the
        limit works only where the function calls `check_time_limit`.
    fresh
        Run every case, even if its result is on disk.
    label
        Function that describes the settings of a case in the progress lines.
    costs
        Estimated cost of each case in any unit, for the time left; equal by default.
    most_seconds
        Time left after the first case above which the study stops [s]; None for no limit.
    quiet
        Print no progress lines.
    progress
        What prints them, for cases that are a part of a study; by default one for these cases.
        With it the two arguments before have no effect.
    """
    all_cases = [Case.of(function, settings) for settings in cases]
    keys = [case.key for case in all_cases]
    cost_of = dict(zip(keys, costs or [1.0] * len(keys), strict=True))
    results: dict[str, dict] = {}
    if out is not None and not fresh:
        results = _read_results(all_cases, Path(out), time_limit)
    # a dict, because cases with the same settings have the same key and run only once
    missing = list({case.key: case for case in all_cases if case.key not in results}.values())
    at_once = min(jobs, len(missing)) or 1
    if scheduler and missing:
        finished_cases = run_on_cluster(missing, scheduler, time_limit)
    elif jobs > 1 and missing:
        finished_cases = run_in_processes(missing, at_once, time_limit)
    else:
        finished_cases = _run_here(missing, function, time_limit)
    if progress is None:
        costs_to_run = [cost_of[case.key] for case in missing]
        progress = Progress(costs_to_run, len(results), at_once, most_seconds, quiet)
    else:
        progress.at_once = at_once
        stored = list(keys)
        for case in missing:
            stored.remove(case.key)
        progress.leave_out([cost_of[key] for key in stored])
    try:
        for case, result in finished_cases:  # they run while this loop waits for the next one
            _write_result(case, result, out, time_limit)
            results[case.key] = result
            progress.print(label(case.settings), result, cost_of[case.key])
    except KeyboardInterrupt:
        if out is None:
            raise
        raise KeyboardInterrupt(INTERRUPTED) from None  # finished cases are stored
    return [{**case.settings, **results[case.key]} for case in all_cases]


def _run_here(cases, function, time_limit):
    """Yield (case, result) of cases that run one after the other in this process."""
    for case in cases:
        yield case, status.attempt(function, dict(case.settings), time_limit)


def _path(case: Case, out: Path) -> Path:
    """Return the file of a case in the folder of results."""
    return out / "cache" / f"{case.key}.json"


def _write_result(
    case: Case, result: dict, out: str | Path | None, time_limit: float | None
) -> None:
    """Write a result to the folder `out`, if there is one and a second run would end the same.

    Raises `InputError` if the result has a column with the name of a setting: both would be the
    same column of a row.
    """
    doubled_names = sorted(set(case.settings) & set(result))
    if doubled_names:
        what = f"{case.name} returned {', '.join(doubled_names)}"
        raise InputError(what, "a setting has that name already", case.file)
    if out is not None and result["status"] in status.REPRODUCIBLE:
        entry = {"settings": case.settings, "time_limit": time_limit, "result": result}
        text = json.dumps(entry, default=lambda value: value.tolist())  # of NumPy's arrays
        replace_file(_path(case, Path(out)), (text + "\n").encode())


def _read_results(cases: list[Case], out: Path, time_limit: float | None) -> dict[str, dict]:
    """Return the stored results by the key of the case.

    A result that was cut off at its time limit counts only if the limit of today, `time_limit`
    [s], is not longer. None is no limit.
    """
    results = {}
    for case in cases:
        entry = _read_entry(_path(case, out))
        if entry is None:
            continue
        was_late = entry["result"]["status"] == status.LATE
        if was_late and (time_limit or math.inf) > (entry["time_limit"] or math.inf):
            continue  # the longer limit may be enough
        results[case.key] = entry["result"]
    return results


def _read_entry(path: Path) -> dict | None:
    """Return the entry that `_write_result` wrote to the path.

    Return None for a file that is missing, cannot be read, or has other content, as after an
    interrupted copy: then the case runs again.
    """
    try:
        entry = json.loads(path.read_text(encoding="utf-8"))
        limit = entry["time_limit"]
        result = entry["result"]
        is_complete = isinstance(limit, int | float | None) and isinstance(result["cause"], str)
        if is_complete and result["status"] in status.REPRODUCIBLE:
            return entry
        return None
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None
