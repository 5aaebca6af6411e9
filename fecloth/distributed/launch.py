"""`mpiexec -n P fecloth run SCENE`: the first process runs the scene, the others work for it."""

import signal
import sys
import time
import traceback
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from typing import Any

from fecloth.distributed.distributed_system import DistributedSystem
from fecloth.distributed.partition import PartDescription
from fecloth.distributed.worker import Worker
from fecloth.errors import FAILED, FeclothError, InputError

MakeSystem = Callable[..., DistributedSystem]
LONGEST_NAP = 1e-3  # [s] between two looks for a call: a process that waits leaves its core


def run_on_all(run: Callable[[MakeSystem], int]) -> int:
    """Call run(make_system) on the first process, and let the others work for it.

    Return its exit status on the first process, and 0 on the others when it has ended. Errors of
    fecloth and Ctrl-C end the other processes and pass on; any other error ends all processes
    with status 3. Raise `InputError` where mpi4py or petsc4py is missing.
    """
    comm = load()
    if comm.rank:  # not the first process
        # The first process alone hears the signals: it ends between two steps.
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_IGN)
        work(comm)
        return 0
    link = MpiLink(comm)
    try:
        status = run(partial(DistributedSystem, link=link))
    except (FeclothError, KeyboardInterrupt):
        link.end()
        raise
    except BaseException as error:
        abort(comm, error)
        raise
    link.end()
    return status


def load() -> Any:
    """The communicator of all processes, for Python objects with large arrays.

    Raise `InputError` if mpi4py or petsc4py is not installed.
    """
    try:
        with suppress(ImportError):
            import dolfinx_solver  # noqa: F401  # this wheel's libraries must be loaded first
        import petsc4py  # noqa: F401
        from mpi4py import MPI
        from mpi4py.util import pkl5
    except ImportError as error:
        what = f"a run on several processes: {error}"
        allowed = "needs mpi4py and petsc4py"
        remedy = "fecloth/distributed/README.md says how to install them."
        raise InputError(what, allowed, "mpiexec", remedy) from error
    return pkl5.Intracomm(MPI.COMM_WORLD)


class MpiLink:
    """A `Link` from the first process of a communicator."""

    def __init__(self, comm: Any):
        self.comm = comm
        self.size = comm.size
        self.here: Worker | None = None

    def begin(self, descriptions: Sequence[PartDescription]) -> Worker:
        """Make one worker of each description, and return the worker of this process."""
        self.call_each("", [(description,) for description in descriptions])
        assert self.here is not None
        return self.here

    def call_each(self, name: str, arguments: Sequence[tuple]) -> list:
        """What the function `name` of each worker returns for its own arguments.

        The name "" makes new workers. An error of fecloth in a process is raised here, when all
        have replied: so none is left with a reply that nobody takes.
        """
        for rank in range(1, self.size):
            self.comm.send((name, arguments[rank]), dest=rank)
        self.here, own_reply = _perform(self.comm, self.here, name, arguments[0])
        replies = [own_reply, *(self.comm.recv(source=rank) for rank in range(1, self.size))]
        error = next((reply for reply in replies if isinstance(reply, FeclothError)), None)
        if error is None:
            return replies
        del replies, own_reply  # the traceback of the error has this frame, and would keep them
        try:
            raise error
        finally:
            del error

    def end(self) -> None:
        """Let the other processes end."""
        for rank in range(1, self.size):
            self.comm.send(("end", ()), dest=rank)


def work(comm: Any) -> None:
    """Do what the first process asks, and reply to it, until it says "end"."""
    worker: Worker | None = None
    while True:
        # While `recv` waits, it keeps the core busy, so sleep until there is a call. The first
        # naps [s] are short, so that a call that comes soon is not delayed.
        nap = 1e-6
        while not comm.iprobe(source=0):
            time.sleep(nap)
            nap = min(2 * nap, LONGEST_NAP)
        name, arguments = comm.recv(source=0)
        if name == "end":
            return
        worker, reply = _perform(comm, worker, name, arguments)
        comm.send(reply, dest=0)


def _perform(comm: Any, worker: Worker | None, name: str, arguments: tuple) -> tuple:
    """Call the function `name` of the worker; return the worker and its reply.

    For the name "" a new worker is made in place of the old one, from its description. The
    reply is the value, or an error of fecloth. Any other error ends all processes, as they
    would wait for this one for ever.
    """
    try:
        if not name:
            if worker:
                worker.close()
            return Worker(*arguments), None
        return worker, getattr(worker, name)(*arguments)
    except FeclothError as failure:
        return worker, failure
    except BaseException as error:
        abort(comm, error)
        raise


def abort(comm: Any, error: BaseException) -> None:
    """Print an error, and end all processes with status 3."""
    traceback.print_exception(error)
    print(f"failed: process {comm.rank} ended all: {error!r}", file=sys.stderr, flush=True)
    comm.Abort(FAILED)
