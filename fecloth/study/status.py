"""What the row of a case says: its status, the cause of a failure, measured seconds."""

import sys
import threading
import time
import traceback

from fecloth.errors import FeclothError, InputError

OK = "ok"
FAILED = "failed"  # a step, a linear solve or an equilibrium
REFUSED = "refused"  # the settings are invalid
LATE = "time limit"
MEMORY = "memory"
NO_VALUE = "no value"  # it ran to its end, but a quantity has no value, as a period
KILLED = "killed"  # the process of the case ended
ERROR = "error"  # any other exception: a mistake in the study or in fecloth
REPRODUCIBLE = (OK, FAILED, REFUSED, LATE)  # a second run would end the same way

# The part of its limit of CPU time that a run takes before its steps tell whether it will end.
FIRST_PART = 0.1

_current_case = threading.local()


class TimeLimit(FeclothError):
    """A case took more CPU time than its time limit."""


def check_time_limit(*_: object) -> None:
    """Raise `TimeLimit` if the case is over its CPU time; fits as a `report` callback."""
    limit = getattr(_current_case, "limit", None)
    end = getattr(_current_case, "end", None)
    if end is not None and limit is not None and time.process_time() > end:
        raise TimeLimit(describe_time_limit(limit))


def check_progress(begin: float, part_done: float) -> None:
    """Raise `TimeLimit` if the case will be over its CPU time, as its first steps tell.

    `begin` is the CPU time of this process when the run began [s], `part_done` the part of the
    run that is done.
    """
    limit = getattr(_current_case, "limit", None)
    end = getattr(_current_case, "end", None)
    if limit is None or end is None:
        return
    now = time.process_time()
    is_telling = now - begin > FIRST_PART * limit
    if is_telling and begin + (now - begin) / max(part_done, 1e-9) > end:
        raise TimeLimit(f"{describe_time_limit(limit)}, as its first steps tell")


def describe_time_limit(limit: float) -> str:
    """Return the cause that stands in the row of a late case."""
    return f"cut off: more than {limit:.3g} CPU s"


def failure(status: str, cause: object) -> dict:
    """Return the cells of a row that has no value, with the first line of the cause."""
    return {"status": status, "cause": (str(cause).splitlines() or [""])[0]}


def attempt(function, settings: dict, time_limit: float | None = None) -> dict:
    """Return the result of `function(**settings)` as a row, with its `status` and `cause`.

    An exception is not raised: then the row has only its status and, as the cause, its text.
    After a mistake in the study or in fecloth ("error") the traceback is printed, too. The time
    limit [CPU s] works only where the function calls `check_time_limit`.
    """
    _current_case.limit = time_limit
    if time_limit is None:
        _current_case.end = None
    else:
        _current_case.end = time.process_time() + time_limit
    try:
        return {**function(**settings), "status": OK, "cause": ""}
    except Exception as error:
        status = _status_of(error)
        cause = str(error)
        if status in (FAILED, ERROR):  # the text alone may not say what kind of error it is
            cause = f"{type(error).__name__}: {cause}"
        if status == ERROR:
            traceback.print_exc(file=sys.stderr)
        return {"status": status, "cause": cause.strip()}
    finally:
        _current_case.end = None


def _status_of(error: Exception) -> str:
    """Return the status of a case that ended with an error; the first kind that fits counts."""
    kinds = {TimeLimit: LATE, InputError: REFUSED, FeclothError: FAILED, MemoryError: MEMORY}
    for kind, status in kinds.items():
        if isinstance(error, kind):
            return status
    return ERROR
