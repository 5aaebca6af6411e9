"""One thread for every library: imported before NumPy, which reads these once."""

from __future__ import annotations

import os
import sys

NAMES = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS")
ONE = dict.fromkeys(NAMES, "1")

if "numba" not in sys.modules:  # it refuses a change once its threads run
    os.environ.update(ONE)
