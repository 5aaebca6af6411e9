"""A session of Gmsh: loaded when it is needed, and without a trace afterwards."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Iterator

from fecloth.errors import MeshError

_PACKAGES = (
    "libglu1-mesa libgl1 libgomp1 libx11-6 libxext6 libxrender1 libxfixes3 libxcursor1 "
    "libxft2 libxinerama1 libfontconfig1 zlib1g"
)
# Of Gmsh's 2-D algorithms, on 50,000 triangles: 6 (Frontal-Delaunay) gives mean quality 0.999 and
# edges of length h in 0.6 s; 5 (Delaunay) 0.952 in 0.5 s; 1 (MeshAdapt) 0.959 in 2 s. More than
# one smoothing sweep lifts only the worst triangle, 0.79 to 0.82, for 1.7 times the time.
OPTIONS = {
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
        remedy = f"Debian and Ubuntu: apt-get install {_PACKAGES}; then pip install gmsh."
        raise MeshError(f"Gmsh cannot be imported ({error})", remedy=remedy) from error
    return gmsh


@contextlib.contextmanager
def gmsh_model() -> Iterator:
    """Gmsh with an empty model of ours; a session that the user has open is left as it was."""
    gmsh = _import_gmsh()
    if gmsh.isInitialized():
        with _kept_session(gmsh):
            yield gmsh
        return
    # Not interruptible: Gmsh would replace Python's handler of Ctrl-C for good.
    with _own_signals():
        gmsh.initialize(readConfigFiles=False, interruptible=False)
    try:
        set_options(gmsh, OPTIONS)
        gmsh.model.add("fecloth")
        yield gmsh
    finally:
        gmsh.finalize()


@contextlib.contextmanager
def _own_signals() -> Iterator[None]:
    """Python's handlers afterwards: Gmsh lets SIGTERM, and a pipe without reader, end the process.

    What is sent meanwhile waits, where the system can hold it back and no other thread takes it.
    """
    names = ("SIGTERM", "SIGPIPE", "SIGHUP")  # the last one ignored by nohup
    numbers = [getattr(signal, name) for name in names if hasattr(signal, name)]
    masks = hasattr(signal, "pthread_sigmask")
    before = signal.pthread_sigmask(signal.SIG_BLOCK, numbers) if masks else None
    try:
        yield
    finally:
        if threading.current_thread() is threading.main_thread():
            for number in numbers:
                if (handler := signal.getsignal(number)) is not None:
                    signal.signal(number, handler)
        if masks:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextlib.contextmanager
def _kept_session(gmsh) -> Iterator[None]:
    """A model of ours beside the user's; options that a .geo file sets itself do remain set."""
    current, models = gmsh.model.getCurrent(), gmsh.model.list()
    options = {name: gmsh.option.getNumber(name) for name in OPTIONS}
    parser, onelab = _parser_values(gmsh), gmsh.onelab.get()
    name = "fecloth"
    while name in models:
        name += "_"
    try:
        gmsh.parser.clear()
        gmsh.onelab.clear()
        set_options(gmsh, OPTIONS)
        gmsh.model.add(name)
        yield
    finally:
        gmsh.model.setCurrent(name)
        gmsh.model.remove()
        gmsh.model.setCurrent(current)
        set_options(gmsh, options)
        gmsh.parser.clear()
        for key, numbers, strings in parser:
            gmsh.parser.setString(key, strings) if strings else gmsh.parser.setNumber(key, numbers)
        gmsh.onelab.clear()
        gmsh.onelab.set(onelab)


def set_options(gmsh, options: dict[str, float]) -> None:
    for name, value in options.items():
        gmsh.option.setNumber(name, value)


def _parser_values(gmsh):
    parser = gmsh.parser
    return [(key, parser.getNumber(key), parser.getString(key)) for key in parser.getNames()]
