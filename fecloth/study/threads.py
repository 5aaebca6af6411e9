"""Limit every library to one thread; import this before NumPy, which reads the limits once."""

import os
import sys

NAMES = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS")
ONE = dict.fromkeys(NAMES, "1")

if "numba" not in sys.modules:  # Numba refuses a change once its threads run
    os.environ.update(ONE)
