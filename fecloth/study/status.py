"""A case that fails is a row with its status and its cause."""

from __future__ import annotations

import sys
import threading
import time
import traceback

from fecloth.errors import FeclothError, InputError

OK = "ok"
FAILED = "failed"  # a step, a solve, an equilibrium
REFUSED = "refused"  # the settings themselves
LATE = "time limit"
MEMORY = "memory"
KILLED = "killed"  # its process ended
ERROR = "error"  # anything else: look at it
KEPT = (OK, FAILED, REFUSED, LATE)  # would come out the same again

_running = threading.local()


class TimeLimit(FeclothError):
    """A case took more than its seconds."""


def tick(*_: object) -> None:
    """Raise `TimeLimit` if the case that runs here is late; a `report` callback of fecloth's.

    Examples
    --------
    >>> from fecloth.study.status import attempt
    >>> attempt(lambda: tick() or {}, {}, time_limit=-1.0)
    {'status': 'time limit', 'cause': 'more than -1 s'}
    """
    limit, end = getattr(_running, "limit", None), getattr(_running, "end", None)
    if end is not None and time.perf_counter() > end:
        raise TimeLimit(late(limit))


def late(limit: float) -> str:
    return f"more than {limit:g} s"


def attempt(function, settings: dict, time_limit: float | None = None) -> dict:
    """What `function(**settings)` returns, with status "ok", or the status and cause of its end.

    The limit holds where the function calls `tick`.
    """
    _running.limit = time_limit
    _running.end = None if time_limit is None else time.perf_counter() + time_limit
    try:
        return {**function(**settings), "status": OK, "cause": ""}
    except Exception as error:
        status = status_of(error)
        if status == ERROR:
            traceback.print_exc(file=sys.stderr)
        named = f"{type(error).__name__}: " if status in (FAILED, ERROR) else ""
        return {"status": status, "cause": f"{named}{error}".strip()}
    finally:
        _running.end = None


def status_of(error: BaseException) -> str:
    """The word for an error in the column `status`."""
    kinds = {TimeLimit: LATE, InputError: REFUSED, FeclothError: FAILED, MemoryError: MEMORY}
    return next((word for kind, word in kinds.items() if isinstance(error, kind)), ERROR)
