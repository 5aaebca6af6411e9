"""Ctrl-C and other signals stop a run between two steps."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def interruptible() -> Iterator[threading.Event]:
    """Yield an event that Ctrl-C sets, to stop between two steps; a second Ctrl-C stops at once.

    SIGTERM does the same and, unless it is ignored (nohup), the end of the terminal.
    """
    requested = threading.Event()

    def request(number, frame):
        if requested.is_set():
            raise KeyboardInterrupt("at once; --resume goes on from what it left")
        requested.set()

    if threading.current_thread() is not threading.main_thread():
        yield requested
        return
    numbers = [signal.SIGINT, signal.SIGTERM]
    hangup = getattr(signal, "SIGHUP", None)
    if hangup and signal.getsignal(hangup) != signal.SIG_IGN:
        numbers.append(hangup)
    before = {number: signal.signal(number, request) for number in numbers}
    try:
        yield requested
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
