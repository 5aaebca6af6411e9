"""A parent for each process of a run, so that one that is killed ends all with fecloth's status.

mpiexec starts the parent. The parent starts the process proper, waits for it, and returns its exit
status. If a signal killed the process, as a system out of memory does, the status is 3, and the
parent asks mpiexec to end the other processes.
"""

from __future__ import annotations

import ctypes
import os
import signal
import sys
import time
from contextlib import suppress

FAILED = 3  # exit status
DIES_WITH_PARENT = 1  # PR_SET_PDEATHSIG of prctl(2)
LONGEST_END = 10.0  # [s] that mpiexec gets to end this process


def start_guarded() -> None:
    """Return in a new process; the present one ends with its exit status.

    Call it before MPI or threads are started. Where processes cannot fork, it does nothing.
    """
    if not sys.platform.startswith("linux"):
        return
    child = os.fork()
    if not child:
        os.setpgid(0, 0)  # signals come from the parent alone
        ctypes.CDLL(None).prctl(DIES_WITH_PARENT, signal.SIGKILL)
        return
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda received, frame: _forward(child, received))
    _, status = os.waitpid(child, 0)
    if os.WIFEXITED(status):
        os._exit(os.WEXITSTATUS(status))
    print(f"failed: a process was killed by signal {os.WTERMSIG(status)}", file=sys.stderr)
    sys.stderr.flush()
    _end_all()
    os._exit(FAILED)


def _forward(child: int, number: int) -> None:
    with suppress(ProcessLookupError):
        os.kill(child, number)


def _end_all() -> None:
    """Ask MPICH's mpiexec to end all; that of Open MPI does so when this process ends."""
    if (pipe := os.environ.get("PMI_FD", "")).isdigit():
        with suppress(OSError):
            os.write(int(pipe), f"cmd=abort exitcode={FAILED}\n".encode())
            time.sleep(LONGEST_END)
