"""Calls of PARDISO in the Intel MKL, through the library that pypardiso finds."""

import ctypes
import os
import sys
from collections.abc import Callable
from enum import IntEnum
from functools import cache
from glob import glob
from typing import Any

import numpy as np


class Phase(IntEnum):
    """What a call of PARDISO does, as the documentation of the MKL numbers its phases."""

    ANALYSE = 11
    FACTORISE = 22
    SOLVE = 33
    RELEASE = -1


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
    iparm[8] = 0  # no refinement; the default takes two steps and three times the time
    iparm[10] = 13  # a pivot below 1e-13 of the largest entry is replaced (general matrices)
    # No scaling or matching (11, 13). Both make the analysis depend on the values of the first
    # matrix. Then a run continued from a restart file would differ from an uninterrupted run.
    iparm[18] = -1  # report the entries of the factor
    iparm[35] = 1  # rows and columns are numbered from 0
    return iparm[1:].copy()


def entries(iparm: np.ndarray) -> int:
    """The number of entries of the factor, which the analysis has written to ``iparm``."""
    return int(iparm[17])


def pardiso(
    phase: Phase,
    mtype: int,
    handle: np.ndarray,
    rows: tuple[np.ndarray, np.ndarray, np.ndarray],
    iparm: np.ndarray,
    b: np.ndarray,
    x: np.ndarray,
) -> int:
    """Call the MKL's ``pardiso`` and return its error code.

    Parameters
    ----------
    phase
        What to do.
    mtype
        The matrix type: 2 for a positive definite matrix, 11 for a general one.
    handle
        (64,) int64, in which PARDISO keeps the addresses of its factor.
    rows
        The numbers of the matrix, their columns, and the first number of each row.
    iparm
        The `parameters`.
    b, x
        (n, 3) the right side, and the solution that is written.
    """

    def number(value: int) -> Any:
        return ctypes.byref(ctypes.c_int32(value))

    def array(a: np.ndarray, kind: type = ctypes.c_int32) -> Any:
        return a.ctypes.data_as(ctypes.POINTER(kind))

    data, columns, starts = rows
    error = ctypes.c_int32(0)
    routine()(
        array(handle, ctypes.c_int64),
        number(1),  # maxfct: factors in memory
        number(1),  # mnum: number of the factor
        number(mtype),
        number(phase),
        number(len(starts) - 1),
        array(data, ctypes.c_double),
        array(starts),
        array(columns),
        None,  # perm: PARDISO chooses the order
        number(1),  # nrhs: right sides
        array(iparm),
        number(0),  # msglvl: print nothing
        array(b, ctypes.c_double),
        array(x, ctypes.c_double),
        ctypes.byref(error),
    )
    return error.value


@cache
def routine() -> Callable[..., None]:
    """Return the C function ``pardiso``; the first call loads the MKL (0.1 s).

    It also sets environment variables of the MKL that the user has not set, and makes the number
    of its threads independent of the load. Raises `ImportError` or `OSError` if the MKL cannot
    be loaded.
    """
    # Without this name pypardiso searches all folders below the prefix, which takes 0.3 s.
    for library in glob(f"{sys.prefix}/lib/libmkl_rt.so*"):
        os.environ.setdefault("PYPARDISO_MKL_RT", library)
    # Equal calls with equal numbers of threads are to give equal bits. In the default mode
    # sums depend on the addresses of arrays (oneMKL Developer Guide, Obtaining Numerically
    # Reproducible Results). The MKL reads this mode once: nothing changes where another package
    # has used the MKL before.
    os.environ.setdefault("MKL_CBWR", "AUTO")
    import pypardiso

    solver = pypardiso.ps  # the solver of the module: a new one would search again
    solver.libmkl.MKL_Set_Dynamic(ctypes.c_int(0))  # threads do not depend on the load
    call: Callable[..., None] = solver._mkl_pardiso
    return call


def threads() -> int | None:
    """Number of threads of PARDISO; None if the MKL is not loaded."""
    if not routine.cache_info().currsize:
        return None
    import pypardiso

    return int(pypardiso.ps.libmkl.MKL_Get_Max_Threads())
