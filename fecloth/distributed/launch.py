"""`mpiexec -n P fecloth run SCENE`: the first process runs the scene, the others work for it."""

from __future__ import annotations

import signal
from collections.abc import Callable
from functools import partial

from fecloth.distributed.distributed_system import DistributedSystem
from fecloth.distributed.mpi_link import MpiLink, abort, load, work
from fecloth.errors import FeclothError

MakeSystem = Callable[..., DistributedSystem]


def run_on_all(run: Callable[[MakeSystem], int]) -> int:
    """Return the exit status of run(make_system) on the first process, and 0 on the others.

    What is no error of fecloth ends all processes with status 3.

    Raises
    ------
    InputError
        Without mpi4py or petsc4py.
    """
    comm = load()
    if comm.rank:
        for number in (signal.SIGINT, signal.SIGTERM):  # the first process ends between two steps
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
