"""A Gmsh session that is loaded on demand and leaves no state behind."""

import contextlib
import signal
import sys
import threading
from collections.abc import Iterator

from fecloth.errors import MeshError

_DEBIAN_PACKAGES = (
    "libglu1-mesa libgl1 libgomp1 libx11-6 libxext6 libxrender1 libxfixes3 libxcursor1 "
    "libxft2 libxinerama1 libfontconfig1 zlib1g"
)
# Of Gmsh's 2-D algorithms 6 (Frontal-Delaunay) gives the best triangles and edges of length h.
# More than one smoothing sweep takes 1.7 times the time and improves only the worst triangle.
GMSH_OPTIONS = {
    "General.Terminal": 0,
    "General.NumThreads": 1,
    "Mesh.Algorithm": 6,
    "Mesh.Smoothing": 1,
    "Mesh.ElementOrder": 1,
    "Mesh.RecombineAll": 0,
    "Mesh.MeshSizeFactor": 1,
    "Mesh.MeshSizeMin": 0,
    "Mesh.MeshSizeMax": 1e22,
    "Mesh.MeshSizeFromPoints": 1,
    "Mesh.MeshSizeExtendFromBoundary": 1,
}


def _import_gmsh():
    try:
        import gmsh
    except (OSError, ImportError) as error:
        remedy = f"Debian and Ubuntu: apt-get install {_DEBIAN_PACKAGES}; then pip install gmsh."
        raise MeshError(f"Gmsh cannot be imported ({error})", remedy=remedy) from error
    return gmsh


def is_open() -> bool:
    """Whether the user has an open session of Gmsh in this process, which we must not change."""
    gmsh = sys.modules.get("gmsh")
    return gmsh is not None and bool(gmsh.isInitialized())


@contextlib.contextmanager
def gmsh_model() -> Iterator:
    """Yield Gmsh with a new, empty model, and end its session after the block.

    The process must have no open session. Raises `MeshError` if Gmsh cannot be imported.
    """
    gmsh = _import_gmsh()
    # With interruptible=True Gmsh would replace Python's handler of Ctrl-C permanently.
    with _signal_handlers_restored():
        gmsh.initialize(readConfigFiles=False, interruptible=False)
    try:
        set_options(gmsh, GMSH_OPTIONS)
        gmsh.model.add("fecloth")
        yield gmsh
    finally:
        gmsh.finalize()


@contextlib.contextmanager
def _signal_handlers_restored() -> Iterator[None]:
    """Restore the signal handlers at the end of the block.

    Gmsh replaces them: then SIGTERM, or writing to a closed pipe, ends the process at once.
    Signals that arrive in between are delayed, if the system supports it and no other thread
    handles them.
    """
    names = ("SIGTERM", "SIGPIPE", "SIGHUP")  # nohup ignores SIGHUP
    numbers = [getattr(signal, name) for name in names if hasattr(signal, name)]
    old_mask = None
    if hasattr(signal, "pthread_sigmask"):
        old_mask = signal.pthread_sigmask(signal.SIG_BLOCK, numbers)
    try:
        yield
    finally:
        # Python sets handlers in the main thread only.
        if threading.current_thread() is threading.main_thread():
            for number in numbers:
                # Python still returns its own handler. None means that no handler is Python's.
                if (handler := signal.getsignal(number)) is not None:
                    signal.signal(number, handler)
        if old_mask is not None:
            signal.pthread_sigmask(signal.SIG_SETMASK, old_mask)


def set_options(gmsh, options: dict[str, float]) -> None:
    """Set numbers among the options of Gmsh, such as "Mesh.Algorithm"."""
    for name, value in options.items():
        gmsh.option.setNumber(name, value)
