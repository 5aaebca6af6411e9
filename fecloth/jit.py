"""Numba compilation with a disk cache that cannot go stale.

Numba notices a change of the file that defines a kernel, not of a function in another file that
the kernel calls. The cache folder is therefore named after a hash of every source file that
holds kernels.
"""

from __future__ import annotations

import hashlib
import os
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numba


@cache
def cache_folder() -> str:
    """Folder for the machine code of these very kernels.

    It lies in ``$NUMBA_CACHE_DIR``, else ``$XDG_CACHE_HOME``, else ``~/.cache``, else (where none
    of them can be written) in the temporary directory.
    """
    digest = hashlib.sha256()
    for source in sorted(Path(__file__).parent.rglob("*.py")):
        text = source.read_bytes()
        if b"fecloth.jit import" in text or b"import jit" in text or source == Path(__file__):
            digest.update(text)
    name = f"fecloth-{digest.hexdigest()[:16]}"
    for base in (
        os.environ.get("NUMBA_CACHE_DIR"),
        os.environ.get("XDG_CACHE_HOME"),
        os.path.expanduser("~/.cache"),
    ):
        if base and _writable(Path(base) / name):
            return str(Path(base) / name)
    return str(Path(tempfile.gettempdir()) / f"{name}-{os.getuid() if os.name == 'posix' else ''}")


def _writable(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return False
    return os.access(folder, os.W_OK)


def kernel(function: Callable) -> Callable:
    """Compile a function over arrays and keep the machine code on disk (an entry point).

    Products and sums may be contracted to fused multiply-adds; no other liberty is taken, so NaN
    and infinity survive and the result does not depend on the thread count.
    """
    return _kept(function)


def threaded_kernel(function: Callable) -> Callable:
    """Compile an entry point whose loops over `numba.prange` are shared among threads.

    The passes of such a loop must write nothing that another one reads or writes; then it keeps
    what `kernel` promises.
    """
    return _kept(function, parallel=True)


def _kept(function: Callable, **options) -> Callable:
    user_choice = numba.config.CACHE_DIR
    numba.config.CACHE_DIR = cache_folder()  # read by Numba while it decorates, not later
    try:
        options |= {"fastmath": {"contract"}, "error_model": "numpy"}
        return numba.njit(cache=True, **options)(function)
    finally:
        numba.config.CACHE_DIR = user_choice


def inner(function: Callable) -> Callable:
    """Compile a function that only kernels call: it is cached as a part of them."""
    return numba.njit(fastmath={"contract"}, error_model="numpy")(function)


def loop(function: Callable) -> Callable:
    """Compile a loop that takes a compiled law as its first argument.

    It is written out inside each entry point that calls it, so that the law is a plain call there:
    a function handed over as a value would keep Numba from caching the entry point.
    """
    return numba.njit(inline="always", error_model="numpy")(function)
