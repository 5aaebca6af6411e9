"""Cases that are run once and kept: an interrupted study goes on where it was."""

from __future__ import annotations

import hashlib
import inspect
import json
import math
import sys
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

from fecloth.errors import InputError
from fecloth.output.atomic_files import replace_file
from fecloth.runs.folder import versions
from fecloth.study import processes, status
from fecloth.study.fingerprint import source_of

Number = float | int | str | bool | None


@dataclass(frozen=True)
class Case:
    """Settings, and the function that runs them, by file and name.

    Attributes
    ----------
    settings
        The function's keyword arguments, in JSON's types.
    file, name
        Where the function stands; another process imports it from there.
    source
        Hash of fecloth and of what the function's file imports from its own folder.
    """

    settings: Mapping[str, object]
    file: str
    name: str
    source: str = field(default="", repr=False)

    @classmethod
    def of(cls, function: Callable[..., dict], settings: Mapping[str, object]) -> Case:
        """The case of a module-level function."""
        file = inspect.getsourcefile(function) or ""
        if "<" in function.__qualname__ or "." in function.__qualname__:
            what = f"function = {function.__qualname__}"
            remedy = "Define it at the top level of a file, so that other processes find it."
            raise InputError(what, "must be a module-level function", "run_cases", remedy)
        case = cls(dict(settings), str(Path(file).resolve()), function.__name__, source_of(file))
        if json.loads(case.text) != case.settings:
            what = f"settings = {case.settings}"
            raise InputError(what, "must be what JSON reads back: lists, no tuples", "run_cases")
        return case

    @property
    def text(self) -> str:
        """The settings as JSON with sorted keys."""
        try:
            return json.dumps(self.settings, sort_keys=True)
        except TypeError as error:
            what = f"settings = {dict(self.settings)}"
            raise InputError(what, f"must be JSON-able: {error}", "run_cases") from error

    @property
    def key(self) -> str:
        """Hash of all that the outcome depends on."""
        parts = (self.text, Path(self.file).name, self.name, version(), self.source)
        return hashlib.sha256("\n".join(parts).encode()).hexdigest()[:24]


def run_cases(
    cases: Iterable[Mapping[str, object]],
    function: Callable[..., dict[str, Number]],
    out: str | Path,
    jobs: int = 1,
    scheduler: str | None = None,
    time_limit: float | None = None,
    fresh: bool = False,
) -> list[dict[str, object]]:
    """Run `function(**settings)` for the settings of each case; rows in the order of the cases.

    A row holds the settings, what the function returned (numbers and strings; lists of numbers
    for a figure are left out of results.csv), `status` and `cause`. A case that fails is a row
    without numbers. A finished case is on disk at once, in OUT/cache, and is not run again
    unless its settings, fecloth, the study's file, what that imports beside it or the scenes
    there have changed; the text of any other file that a case reads belongs in its settings.

    Parameters
    ----------
    jobs
        Processes, each with one thread; with 1 the cases run in this process.
    scheduler
        Address of a Dask scheduler whose workers see these files under the same paths; None for
        this machine.
    time_limit
        Seconds a case may take. Processes are killed; in this process and on a cluster the limit
        holds where the function calls `tick`.
    fresh
        Run every case, whatever is kept.

    Raises
    ------
    InputError
        If the function is no module-level one, or the settings are not JSON-able.
    """
    listed = [Case.of(function, settings) for settings in cases]
    kept = {} if fresh else _kept(listed, Path(out), time_limit)
    missing = list({case.key: case for case in listed if case.key not in kept}.values())
    if scheduler:
        finished = processes.on_cluster(missing, scheduler, time_limit)
    elif jobs > 1 and missing:
        finished = processes.in_processes(missing, min(jobs, len(missing)), time_limit)
    else:
        finished = _here(missing, function, time_limit)
    begin = time.perf_counter()
    for number, (case, result) in enumerate(finished, 1):
        _keep(case, result, Path(out), time_limit)
        kept[case.key] = result
        seconds = time.perf_counter() - begin
        _tell(f"[{number}/{len(missing)}, {seconds:.0f} s] {_words(case)}: {_short(result)}")
    return [{**case.settings, **kept[case.key]} for case in listed]


def _here(cases, function, time_limit):
    for case in cases:
        yield case, status.attempt(function, dict(case.settings), time_limit)


def _path(case: Case, out: Path) -> Path:
    return out / "cache" / f"{case.key}.json"


def _keep(case: Case, result: dict, out: Path, time_limit: float | None) -> None:
    """Put a finished case on disk, unless it may go otherwise another time."""
    clash = sorted(set(case.settings) & set(result))
    if clash:
        what = f"{case.name} returned {', '.join(clash)}"
        raise InputError(what, "a setting has that name already", case.file)
    if result["status"] in status.KEPT:
        kept = {"settings": case.settings, "time_limit": time_limit, "result": result}
        replace_file(_path(case, out), (json.dumps(kept, default=_plain) + "\n").encode())


def _kept(cases: list[Case], out: Path, time_limit: float | None) -> dict[str, dict]:
    """The results that are on disk, by key."""
    found = {}
    for case in cases:
        path = _path(case, out)
        if not path.exists():
            continue
        kept = json.loads(path.read_text(encoding="utf-8"))
        late = kept["result"]["status"] == status.LATE
        if late and (time_limit or math.inf) > (kept["time_limit"] or math.inf):
            continue  # it may make it now
        found[case.key] = kept["result"]
    return found


def _plain(value):
    """NumPy's numbers and arrays in JSON's types."""
    return value.tolist()


def _words(case: Case) -> str:
    """The settings on one line; a text of many lines by its first characters."""
    return " ".join(f"{k}={' '.join(str(v).split())[:40]}" for k, v in case.settings.items())


def _short(result: dict) -> str:
    return f"{result['status']} {result['cause'].splitlines()[0] if result['cause'] else ''}"


def _tell(line: str) -> None:
    print(line.rstrip(), file=sys.stderr, flush=True)


@cache
def version() -> str:
    """fecloth's version; asking for it takes 4 ms, which thousands of cases would feel."""
    return versions()["fecloth"]
