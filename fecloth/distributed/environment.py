"""Whether mpiexec has started this process, by its environment; loads no library."""

import os

SIZES = ("PMI_SIZE", "OMPI_COMM_WORLD_SIZE", "PMIX_SIZE", "MPI_LOCALNRANKS")
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def count_processes() -> int:
    """Number of processes that mpiexec, mpirun or srun has started together; 1 without."""
    for name in SIZES:
        if os.environ.get(name, "").isdigit():
            return int(os.environ[name])
    return 1


def use_one_thread() -> None:
    """Let BLAS start no threads, as each process has its core.

    Call it before NumPy is loaded.
    """
    for name in THREADS:
        os.environ.setdefault(name, "1")
