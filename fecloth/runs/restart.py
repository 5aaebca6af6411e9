"""Restart files: all that a run needs to continue as if it had never stopped, in one .npz.

A record is a frozen dataclass, marked with `remembered`, of numbers, texts, arrays, mappings,
tuples and records. Its arrays are members of the .npz; all else is in a JSON header, whose
numbers read back as the same float64.
"""

import hashlib
import io
import json
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from fecloth.errors import InputError
from fecloth.linalg.mkl_pardiso import threads
from fecloth.output.atomic_files import flush_to_disk, replace_file, writing
from fecloth.quantities import toml_file
from fecloth.runs.environment import versions
from fecloth.scene.toml_text import flatten
from fecloth.simulation.account import Accounts
from fecloth.simulation.doubts.doubt import Doubt, DoubtKind
from fecloth.simulation.fused_march import Wanted
from fecloth.simulation.steps import Memory
from fecloth.system.state import State
from fecloth.terms.records import RECORDS, remembered

FORMAT = 12  # of the files: another number for other fields of a record
FOLDER = "restart"
PATTERN = "restart_*.npz"
FILES_KEPT = 2  # so that a run can continue where the newest file cannot be read
FREE = ("title", "expect", "interest", "uncertain", "measured")  # keys that do not change a run


@remembered
@dataclass(frozen=True, eq=False)
class Progress:
    """A run between two steps. It is replaced whole: a step is in all of it or in none.

    Attributes
    ----------
    state, memory, accounts
        After the last step.
    doubts
        The doubts since the first step.
    wanted
        The next step to record; None: each.
    tables
        Number of bytes of each table.
    """

    state: State
    memory: Memory
    accounts: Accounts
    doubts: tuple[Doubt, ...]
    wanted: Wanted | None
    tables: Mapping[str, int]


@remembered
@dataclass(frozen=True, eq=False)
class Restart:
    """The progress of a run, and the run to which it belongs.

    Attributes
    ----------
    scene
        The resolved scene.
    start
        The `digest` of the mesh and the start.
    method
        The method that takes the steps, as text; for "auto" the chosen one.
    progress
        The run between two steps.
    made_on
        Versions and threads.
    """

    scene: str
    start: str
    method: str
    progress: Progress
    made_on: Mapping[str, str]


def write(folder: Path, restart: Restart) -> Path:
    """Write a restart file in one go and remove all but the last two; return its path.

    `folder` is the folder of the run. The file is flushed to the disk before others are
    removed, so that a power cut leaves one. Raise `WriteError` if the disk refuses it, and
    `InputError` for a value that no restart file can hold.
    """
    path = path_of(folder, restart.progress)
    arrays: list[np.ndarray] = []
    header = json.dumps({"format": FORMAT, "run": _pack(restart, arrays)})
    stream = io.BytesIO()
    named: dict[str, Any] = {f"array_{i}": array for i, array in enumerate(arrays)}
    np.savez(stream, header=np.frombuffer(header.encode(), np.uint8), **named)
    replace_file(path, stream.getvalue())
    flush_to_disk(path, path.parent, folder)
    with writing(path):
        for old in files(folder)[FILES_KEPT:]:
            old.unlink()
    return path


def path_of(folder: Path, progress: Progress) -> Path:
    """Return the path of the restart file after a step, in the folder of its run."""
    return folder / FOLDER / f"restart_{progress.memory.step:09d}.npz"


def files(folder: Path) -> list[Path]:
    """Return the restart files of a run's folder, the newest first."""
    return sorted((folder / FOLDER).glob(PATTERN), reverse=True)


def read(path: Path) -> Restart:
    """Return the restart of one file.

    Raise `InputError` for a file that cannot be read, has another format, or is no restart.
    """
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
            members = {name: file[name] for name in file.files}
        header = json.loads(members.pop("header").tobytes())
        arrays = [members.pop(f"array_{i}") for i in range(len(members))]
        if header["format"] != FORMAT:
            words = f"it has format {header['format']}, and this fecloth reads {FORMAT}"
            raise ValueError(f"{words}; the fecloth that wrote it can resume the run")
        restart = _unpack(header["run"], arrays)
        if not isinstance(restart, Restart):
            raise ValueError("it is no restart of a run")
    except (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile) as error:
        what = f"cannot be read ({error})"
        remedy = "Remove this file to resume from another one."
        raise InputError(what, where=str(path), remedy=remedy) from error
    return restart


def _pack(value, arrays: list):
    """Return the value in JSON's types; append its arrays to `arrays`.

    A dict with one of the keys "record", "array", "mapping" and "doubt" stands for what JSON
    does not have. Raise `InputError` for an object of any other class.
    """
    name = type(value).__name__
    if RECORDS.get(name) is type(value):
        keys = [field.name for field in fields(RECORDS[name])]
        values = {key: _pack(getattr(value, key), arrays) for key in keys}
        return {"record": name, "fields": values}
    if isinstance(value, np.ndarray):
        arrays.append(value)
        return {"array": len(arrays) - 1}
    if isinstance(value, Mapping):
        return {"mapping": {key: _pack(item, arrays) for key, item in value.items()}}
    if isinstance(value, DoubtKind):
        return {"doubt": value.value}
    if isinstance(value, tuple):
        return [_pack(item, arrays) for item in value]
    if isinstance(value, np.generic):
        return value.item()
    if value is None or isinstance(value, bool | int | float | str):
        return value
    remedy = "Mark its class with @remembered, from fecloth.terms.records."
    raise InputError(f"a {name}", "cannot be written to a restart file", remedy=remedy)


def _unpack(value, arrays: list):
    """Return the value from which `_pack` made this; `arrays` are those that it appended.

    Raise `KeyError`, `TypeError` or `ValueError` for what `_pack` does not make.
    """
    if isinstance(value, list):
        return tuple(_unpack(item, arrays) for item in value)
    if not isinstance(value, dict):
        return value
    match value:
        case {"array": int(number)}:
            return arrays[number]
        case {"doubt": str(name)}:
            return DoubtKind(name)
        case {"mapping": dict(items)}:
            return {key: _unpack(item, arrays) for key, item in items.items()}
        case {"record": str(name), "fields": dict(values)}:
            return RECORDS[name](**{key: _unpack(item, arrays) for key, item in values.items()})
    raise ValueError("its header has an unknown part")


def find(folder: Path) -> Restart:
    """Return the newest readable restart of a run's folder.

    Raise `InputError` if there is no restart file, or none that can be read.
    """
    remedy = "restart_steps in [output] writes some; -o names the folder of a new run."
    error = InputError(f"--resume {folder}", "there is no restart file", remedy=remedy)
    for path in files(folder):
        try:
            return read(path)
        except InputError as unreadable:
            error = unreadable
    raise error


def refuse_another(restart: Restart, scene: str, start: str, folder: Path) -> None:
    """Raise `InputError` if a scene cannot continue the run of a restart.

    `scene` is the resolved scene as TOML, `start` the `digest` of its mesh and start, and
    `folder` the folder of the run. The scene must be the one of the run, and the message names
    the keys that differ. The keys that do not change a motion (`FREE`) may differ, and so may
    `time.t_end`, but the run must not be beyond it.
    """
    values_then = flatten(toml_file.parse(restart.scene))
    values_now = flatten(toml_file.parse(scene))
    changes = []
    for key in {**values_then, **values_now}:  # a dict, for the order of the keys
        may_differ = key.split(".")[0] in FREE or key == "time.t_end"
        if values_then.get(key) != values_now.get(key) and not may_differ:
            there = values_then.get(key, "nothing")
            here = values_now.get(key, "nothing")
            changes.append(f"{key} = {there} there, {here} here")
    if changes:
        remedy = "Resume with the scene of that run, or start another run."
        raise InputError(f"{folder} belongs to another scene", "; ".join(changes), remedy=remedy)
    if restart.start != start:
        allowed = "the mesh or the frame of the start has changed"
        raise InputError(f"{folder} has another start", allowed)
    t = restart.progress.state.t
    t_end = values_now.get("time.t_end", t)  # a static scene always ends at all the loads
    if t > t_end:
        allowed = f"the run in {folder} has already reached {t:g} s"
        raise InputError(f"time.t_end = {t_end}", allowed)


def digest(cloth, state: State) -> str:
    """Return a fingerprint of a mesh and a start."""
    whole = hashlib.sha256()
    for array in (cloth.X, cloth.cells, state.x, state.v):
        whole.update(np.ascontiguousarray(array).tobytes())
    return whole.hexdigest()


def machine() -> dict[str, str]:
    """Return what the last bits depend on: versions, and the threads of PARDISO."""
    return versions() | {"threads": str(threads())}


def differences(restart: Restart) -> str:
    """Return in words what differs between the machine of a restart and this one, or "".

    These are versions of packages and the threads of PARDISO, on which the last bits depend.
    """
    then = restart.made_on
    now = machine()
    changes = []
    for key in sorted(then.keys() & now.keys()):
        is_known = "None" not in (then[key], now[key])  # the text of an unknown number
        if is_known and then[key] != now[key]:
            changes.append(f"{key} was {then[key]}, is {now[key]}")
    return "; ".join(changes)
