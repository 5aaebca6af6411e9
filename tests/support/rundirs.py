"""What the folder of a run holds, to be compared with that of another run."""

import csv
import dataclasses
import json
from pathlib import Path

import pytest

from fecloth.runs import restart
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
