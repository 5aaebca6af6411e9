"""Gmsh: an open session stays as it is, and the message for missing libraries."""

import builtins
import os
import signal
import subprocess
import sys

import numpy as np
import pytest
from support.meshed import MESHES, rejects

from fecloth.errors import InputError
from fecloth.mesh.generate import disk, rectangle
from fecloth.mesh.read import read


def test_an_open_session_of_gmsh_stays_as_it_is():
    import gmsh

    gmsh.initialize(readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.model.add("fecloth")
        gmsh.model.geo.addPoint(1, 2, 3)
        gmsh.model.geo.synchronize()
        gmsh.model.add("another")
        gmsh.model.setCurrent("fecloth")
        gmsh.option.setNumber("Mesh.Algorithm", 5)
        gmsh.option.setNumber("Mesh.MeshSizeFactor", 3)
        gmsh.parser.setNumber("h", [0.7])
        gmsh.onelab.setNumber("Parameters/h", [0.7])
        inside = read(MESHES / "square.geo", h=0.1), disk(1.0, 0.3)
        rejects(["h = 2 m"], MESHES / "square.geo", h=2, by=read, error=InputError)
        assert gmsh.isInitialized()
        assert gmsh.model.getCurrent() == "fecloth"
        assert gmsh.model.list().count("fecloth") == 1
        assert not any(name.startswith("fecloth_") for name in gmsh.model.list())
        assert gmsh.model.getEntities() == [(0, 1)]
        assert gmsh.option.getNumber("Mesh.Algorithm") == 5
        assert gmsh.option.getNumber("Mesh.MeshSizeFactor") == 3
        assert gmsh.parser.getNumber("h") == [0.7]
        assert gmsh.onelab.getNumber("Parameters/h") == [0.7]
    finally:
        gmsh.finalize()
    alone = read(MESHES / "square.geo", h=0.1), disk(1.0, 0.3)
    assert not gmsh.isInitialized()
    assert all(np.array_equal(a.X, b.X) for a, b in zip(inside, alone, strict=True))


def test_missing_system_libraries_are_named(monkeypatch):
    real = builtins.__import__

    def broken(name, *args, **kwargs):
        if name == "gmsh":
            raise OSError("libGLU.so.1: cannot open shared object file")
        return real(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", broken)
    rejects(["libGLU.so.1", "libglu1-mesa", "libxft2", "apt-get"], 1, 1, 0.5, by=rectangle)


@pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="no such signals")
def test_gmsh_restores_the_signal_handlers_of_python():
    """A new process is needed, because Gmsh replaces the handlers only once."""
    code = """
import os, signal
import gmsh
from fecloth.mesh.generate import rectangle
signal.signal(signal.SIGTERM, lambda *_: print("term"))
signal.signal(signal.SIGHUP, signal.SIG_IGN)  # as nohup does
initialize = gmsh.initialize
def stopped(**options):
    initialize(**options)
    os.kill(os.getpid(), signal.SIGTERM)  # while Gmsh's handlers are in place
gmsh.initialize = stopped
rectangle(1.0, 1.0, h=0.5)
os.kill(os.getpid(), signal.SIGTERM)
os.kill(os.getpid(), signal.SIGHUP)
reader, writer = os.pipe()
os.close(reader)
try:
    os.write(writer, b"x")
except BrokenPipeError:
    print("pipe")
"""
    names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
    alone = os.environ | dict.fromkeys(names, "1")  # or another thread would take the signal
    command = [sys.executable, "-c", code]
    run = subprocess.run(command, capture_output=True, text=True, env=alone)
    assert (run.returncode, run.stdout.split()) == (0, ["term", "term", "pipe"])
