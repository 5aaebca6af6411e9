"""Calls of PARDISO in the Intel MKL, through the library that pypardiso finds."""

import ctypes
import os
import sys
from collections.abc import Callable
from functools import cache
from glob import glob
from typing import Any

import numpy as np

CBWR_AUTO = 2  # MKL_CBWR_AUTO of mkl_service.h: the best instructions, the same in each call

ERRORS = {
    -2: "not enough memory for the factor",
    -3: "the reordering failed",
    -4: "zero pivot, A is singular",
    -8: "the factor has more entries than 32-bit integers can count",
}


def parameters() -> np.ndarray:
    """The 64 parameters ``iparm``, which the MKL's documentation numbers from 1."""
    iparm = np.zeros(65, np.int32)
    iparm[1] = 1  # use these values instead of the defaults
    iparm[2] = 2  # nested dissection (METIS): 0.75 of the factor time of minimum degree
    iparm[8] = 0  # no refinement by PARDISO; the default takes two steps and three times the time
    iparm[10] = 13  # a pivot below 1e-13 of the largest entry is replaced (general matrices)
    # No scaling or matching (11, 13). Both make the analysis depend on the values of the first
    # matrix. Then a run continued from a restart file would differ from an uninterrupted run.
    iparm[35] = 1  # rows and columns are numbered from 0
    return iparm[1:].copy()


def pardiso(
    phase: int,
    mtype: int,
    handle: np.ndarray,
    rows: tuple[np.ndarray, np.ndarray, np.ndarray],
    iparm: np.ndarray,
    b: np.ndarray,
    x: np.ndarray,
) -> int:
    """Call the MKL's ``pardiso`` and return its error code."""

    def number(value: int) -> Any:
        return ctypes.byref(ctypes.c_int32(value))

    def array(a: np.ndarray, kind: type = ctypes.c_int32) -> Any:
        return a.ctypes.data_as(ctypes.POINTER(kind))

    data, columns, starts = rows
    error = ctypes.c_int32(0)
    real = ctypes.c_double
    routine()(
        *(array(handle, ctypes.c_int64), number(1), number(1), number(mtype), number(phase)),
        *(number(len(starts) - 1), array(data, real), array(starts), array(columns)),
        *(None, number(1), array(iparm), number(0), array(b, real), array(x, real)),
        ctypes.byref(error),
    )
    return error.value


@cache
def routine() -> Callable[..., None]:
    """The C function ``pardiso``; the first call loads the MKL (0.1 s)."""
    for library in glob(f"{sys.prefix}/lib/libmkl_rt.so*"):  # else pypardiso searches it all: 0.3 s
        os.environ.setdefault("PYPARDISO_MKL_RT", library)
    import pypardiso

    solver = pypardiso.ps  # of the module: a new one would search again
    # Equal calls with equal numbers of threads are to give equal bits. In the default mode
    # sums depend on the addresses of arrays (oneMKL Developer Guide, Obtaining Numerically
    # Reproducible Results). The mode stays if another package has used the MKL, which then
    # rejects the call.
    if "MKL_CBWR" not in os.environ:
        solver.libmkl.MKL_CBWR_Set(ctypes.c_int(CBWR_AUTO))
    solver.libmkl.MKL_Set_Dynamic(ctypes.c_int(0))  # threads do not depend on the load
    call: Callable[..., None] = solver._mkl_pardiso
    return call


def threads() -> int | None:
    """Number of threads of PARDISO; None if the MKL is not loaded."""
    if not routine.cache_info().currsize:
        return None
    import pypardiso

    return int(pypardiso.ps.libmkl.MKL_Get_Max_Threads())
