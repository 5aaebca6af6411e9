"""PARDISO of the Intel MKL, called through the library that pypardiso finds."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Callable
from functools import cache

import numpy as np

CBWR_AUTO = 2  # MKL_CBWR_AUTO of mkl_service.h: the best instructions, always the same ones

ERRORS = {
    -2: "not enough memory for the factor",
    -3: "the reordering failed",
    -4: "zero pivot, A is singular",
    -8: "the factor has more entries than 32-bit integers can count",
}


def parameters() -> np.ndarray:
    """The 64 switches, numbered from 1 in the MKL's documentation."""
    iparm = np.zeros(65, np.int32)
    iparm[1] = 1  # these values, not the defaults
    iparm[2] = 2  # nested dissection (METIS): 0.75 of the factor time of minimum degree
    iparm[8] = 0  # no refinement of its own; the default takes two steps and thrice the time
    iparm[10] = 13  # a pivot below 1e-13 of the largest entry is replaced (general matrices)
    # No scaling or matching (11, 13): both would make the analysis depend on the values of the
    # first matrix, and a run continued from a restart file differ from the uninterrupted one.
    iparm[35] = 1  # rows and columns count from 0
    return iparm[1:].copy()


def pardiso(phase, mtype, handle, rows, iparm, b, x) -> int:
    """One call of MKL's ``pardiso``; returns its error code."""

    def number(value):
        return ctypes.byref(ctypes.c_int32(value))

    def array(a, kind=ctypes.c_int32):
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
def routine() -> Callable:
    """The C routine; loads the MKL (0.4 s) on the first call.

    Raises
    ------
    ImportError, OSError
        Where pypardiso or the MKL is missing.
    """
    import pypardiso

    # Taken from its module-wide solver: every further PyPardisoSolver() searches the disk anew.
    _make_reproducible(pypardiso.ps.libmkl)
    return pypardiso.ps._mkl_pardiso


def _make_reproducible(library) -> None:
    """The MKL's mode in which equal calls on equally many threads give equal bits.

    Otherwise sums depend on where arrays happen to lie, and the number of threads on how busy the
    machine is (oneMKL Developer Guide, Obtaining Numerically Reproducible Results). Refused, the
    MKL stays as the user, by MKL_CBWR, or another package has set it.
    """
    if "MKL_CBWR" not in os.environ:
        library.MKL_CBWR_Set(ctypes.c_int(CBWR_AUTO))
    library.MKL_Set_Dynamic(ctypes.c_int(0))


def threads() -> int | None:
    """Threads that PARDISO takes; None where the MKL is not loaded."""
    if not routine.cache_info().currsize:
        return None
    import pypardiso

    return pypardiso.ps.libmkl.MKL_Get_Max_Threads()
