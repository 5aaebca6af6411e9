"""Functions of a study's cases, at the top level so that other processes can import them."""

import os
import signal
import time
from pathlib import Path

import numpy as np

import fecloth as fc
from fecloth import study
from fecloth.errors import SolveFailed, StepFailed


def square(x: float, log: str) -> dict:
    with open(log, "a") as stream:
        stream.write(f"{x:g}\n")
    if Path(log).with_suffix(".stop").exists() and x == 2.0:
        raise KeyboardInterrupt
    return {"square": np.float64(x * x), "path": np.arange(2) * x}


def fail_or_return(how: str) -> dict:
    if how == "step":
        raise StepFailed("not finite", step=3, t=0.1, dt=0.01, remedy="Take a smaller dt.")
    if how == "solve":
        raise SolveFailed("missed", 1e-2, 1e-6)
    if how == "input":
        fc.Fabric(areal_density=-1.0, tensile_stiffness=1.0)
    if how == "memory":
        raise MemoryError
    if how == "bug":
        raise TypeError("odd")
    if how == "killed":
        os.kill(os.getpid(), signal.SIGKILL)
    if how == "waiting":  # takes no CPU time
        time.sleep(0.3)
        study.check_time_limit()
    if how == "hanging":
        time.sleep(3600)
    if how == "busy":  # without a look at its limit
        while True:
            pass
    if how == "ticking":
        while True:
            study.check_time_limit()
    return {"value": 1.0}


def read_thread_limits(name: str) -> dict:
    import numba

    return {"threads": os.environ.get(name, ""), "numba": numba.config.NUMBA_NUM_THREADS}


def return_setting(how: str) -> dict:
    return {"how": how}


def four_cases(log):
    return [{"x": float(x), "log": str(log)} for x in (3, 1, 2, 4)]
