"""What the folder of a run holds, to be compared with that of another run."""

import csv
import dataclasses
import json
import os
import signal
from pathlib import Path

import pytest

from fecloth.runs import restart
from fecloth.runs.run_scene import run_scene
from fecloth.scene.scene import load_scene
from fecloth.simulation.account import Accounts


def rows_of(file):
    """The rows of a CSV file as texts by the names of its columns."""
    with open(file, newline="") as stream:
        return list(csv.DictReader(stream))


def written(folder):
    """What must not differ, by file: all but what has the time of day or the process in it."""
    folder = Path(folder)
    files = (file for file in folder.rglob("*") if file.is_file())
    skipped = ("run.log", "summary.json")
    files = [f for f in files if f.name not in skipped and f.suffix != ".html"]
    result = {str(file.relative_to(folder)): file.read_bytes() for file in files}
    if "run.vtkhdf" in result:  # its values: HDF5 lays a file that was cut out in another way
        result["run.vtkhdf"] = hdf_values(folder / "run.vtkhdf")
    return result | {str(f.relative_to(folder)): record(f) for f in restart.files(folder)}


def interrupted(scene, folder, after, resume=False):
    """A run that is asked to stop after a step, as by Ctrl-C."""

    def report(info):
        if info.step == after:
            os.kill(os.getpid(), signal.SIGINT)

    return run_scene(load_scene(scene), folder, report=report, resume=resume)


def assert_same_files(first, second):
    """Two folders have the same files, bit for bit."""
    expected, result = written(first), written(second)
    assert {name: expected[name] == result.get(name) for name in expected} == dict.fromkeys(
        expected, True
    )


def gone_on(scene, folder, after):
    """Run a scene as a whole, and broken off after a step and resumed: the files are the same.

    The outcome of the whole run, in the folder "whole".
    """
    whole = run_scene(load_scene(scene), folder / "whole")
    assert interrupted(scene, folder / "broken", after).status == "interrupted"
    assert run_scene(load_scene(scene), folder / "broken", resume=True).status == "done"
    assert_same_files(folder / "whole", folder / "broken")
    return whole


def hdf_values(file):
    """All arrays of an HDF5 file, as bytes."""
    h5py, result = pytest.importorskip("h5py"), {}
    with h5py.File(file) as read:
        result["NSteps"] = read["VTKHDF/Steps"].attrs["NSteps"]
        arrays = {name for name in names(read) if isinstance(read[name], h5py.Dataset)}
        return result | {name: read[name][:].tobytes() for name in arrays}


def names(read):
    """Of all that an HDF5 file holds."""
    result = []
    read.visit(result.append)
    return result


def restart_at(state, memory):
    """A restart file's record of a run that accounts for nothing."""
    progress = restart.Progress(state, memory, Accounts({}), (), None, {})
    return restart.Restart("", "", "", progress, {})


def record(file):
    """A restart file without the machine: MKL's threads are known where a test has loaded it."""
    arrays = []
    packed = restart._pack(dataclasses.replace(restart.read(file), made_on={}), arrays)
    return json.dumps(packed), [array.tobytes() for array in arrays]
