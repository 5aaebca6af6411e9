"""Ctrl-C and other signals: they stop a run between two steps, and all else at once."""

import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager


def set_handler(handler: Callable | signal.Handlers) -> dict[int, Callable | int | None]:
    """Handle Ctrl-C, SIGTERM and, unless it is ignored (nohup), the end of the terminal.

    Returns the earlier handlers by signal; empty outside the main thread, where Python allows
    none.
    """
    if threading.current_thread() is not threading.main_thread():
        return {}
    numbers = [signal.SIGINT, signal.SIGTERM]
    hangup = getattr(signal, "SIGHUP", None)
    if hangup and signal.getsignal(hangup) != signal.SIG_IGN:
        numbers.append(hangup)
    return {number: signal.signal(number, handler) for number in numbers}


class Interrupted(KeyboardInterrupt):
    """A signal that stops at once; after a plain KeyboardInterrupt Python may end by SIGINT."""


def stop_at_once(number: int, frame: object) -> None:
    """Handle a signal by raising `Interrupted`."""
    sys.unraisablehook = lambda unraisable: None  # destructors of what it finds half made
    raise Interrupted


@contextmanager
def interruptible() -> Iterator[threading.Event]:
    """Yield an event that a signal sets, so that a run can stop between two steps.

    A second signal raises `Interrupted` at once. At the end the handlers of before are set
    again, unless another one was set in between.
    """
    stop_requested = threading.Event()

    def request_stop(number, frame):
        if stop_requested.is_set():
            raise Interrupted("at once; --resume goes on from what it left")
        stop_requested.set()

    handlers_before = set_handler(request_stop)
    try:
        yield stop_requested
    finally:
        for number, handler in handlers_before.items():
            if signal.getsignal(number) is request_stop:
                signal.signal(number, handler)
