"""Restart files: all that a run needs to go on as if it had never stopped, in one .npz.

A record is a frozen dataclass, marked with `remembered`, of numbers, texts, arrays, mappings and
records; its arrays lie in the .npz as they are, all else in a header of JSON, whose numbers read
back as the same float64.
Reading is strict: a file that lacks anything, or holds anything else, is refused.
"""

from __future__ import annotations

import hashlib
import io
import json
import tomllib
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from fecloth.errors import InputError
from fecloth.linalg.mkl_pardiso import threads
from fecloth.output.atomic_files import on_disk, replace_file, writing
from fecloth.records import RECORDS, remembered
from fecloth.runs.folder import versions
from fecloth.runs.outcome import DONE
from fecloth.simulation.energy_ledger import Ledger
from fecloth.simulation.march import Memory
from fecloth.system.system import State

FORMAT = 2
FOLDER, PATTERN = "restart", "restart_*.npz"
KEPT = 2  # files
FREE = ("title", "expect", "interest")  # tables that do not change a run


@remembered
@dataclass(frozen=True, eq=False)
class Restart:
    """A run between two steps.

    Attributes
    ----------
    scene
        The resolved scene.
    start
        `digest` of the mesh and the start.
    method
        What takes the steps, in words; of "auto", the choice.
    state, memory, ledger
        After the last step.
    turnover, counts
        What the recorder has counted so far.
    frames, tables
        Number of frames, and the bytes of each table.
    exact
        Whether the run that goes on from it is the unbroken one bit for bit: its solver kept
        nothing, or dropped it here.
    made_on
        Versions and threads.
    """

    scene: str
    start: str
    method: str
    state: State
    memory: Memory
    ledger: Ledger
    turnover: float
    counts: Mapping[str, int]
    frames: int
    tables: Mapping[str, int]
    exact: bool
    made_on: Mapping[str, str]


# --- one file -------------------------------------------------------------------------------------


def write(folder: Path, restart: Restart) -> Path:
    """Write the file in one go and remove those before the last two; returns it.

    No other is removed before it is on the disk, so that a power cut leaves one.
    """
    path = folder / FOLDER / f"restart_{restart.memory.step:09d}.npz"
    arrays: list[np.ndarray] = []
    header = json.dumps({"format": FORMAT, "run": _packed(restart, arrays)})
    stream = io.BytesIO()
    named = {f"array_{i}": array for i, array in enumerate(arrays)}
    np.savez(stream, header=np.frombuffer(header.encode(), np.uint8), **named)
    replace_file(path, stream.getvalue())
    on_disk(path, path.parent, folder)
    with writing(path):
        for old in files(folder)[KEPT:]:
            old.unlink()
    return path


def files(folder: Path) -> list[Path]:
    """The restart files of a run's folder, the newest first."""
    return sorted((folder / FOLDER).glob(PATTERN), reverse=True)


def read(path: Path) -> Restart:
    """The record of one file.

    Raises
    ------
    InputError
        If it cannot be read, or is not whole.
    """
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
            members = {name: file[name] for name in file.files}
        header = json.loads(members.pop("header").tobytes())
        arrays = [members.pop(f"array_{i}") for i in range(len(members))]
        if header.keys() != {"format", "run"} or header["format"] != FORMAT:
            raise ValueError(f"it is of another format than {FORMAT}")
        found = _unpacked(header["run"], arrays)
        _check(found, arrays)
    except (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile) as error:
        what, remedy = f"cannot be read ({error})", "Resume from another one: remove this file."
        raise InputError(what, where=str(path), remedy=remedy) from error
    return found


def _check(found, arrays) -> None:
    """That a record is a restart whose arrays are all (n, 3), finite and float64."""
    if not isinstance(found, Restart):
        raise ValueError("it holds no run")
    shape = found.state.x.shape
    for array in arrays:
        if array.shape != shape or array.dtype != np.float64 or not np.isfinite(array).all():
            raise ValueError(f"an array is not finite, or not float64 of shape {shape}")


def _packed(value, arrays: list):
    """The value in JSON's types; its arrays are appended."""
    name = type(value).__name__
    if RECORDS.get(name) is type(value):
        given = {one.name: _packed(getattr(value, one.name), arrays) for one in fields(value)}
        return {"record": name, "fields": given}
    if isinstance(value, np.ndarray):
        arrays.append(value)
        return {"array": len(arrays) - 1}
    if isinstance(value, Mapping):
        return {"mapping": {key: _packed(item, arrays) for key, item in value.items()}}
    if isinstance(value, np.generic):
        return value.item()
    if value is None or isinstance(value, bool | int | float | str):
        return value
    remedy = "Mark its class with @remembered, from fecloth.records."
    raise InputError(f"a {name}", "cannot be kept in a restart file", remedy=remedy)


def _unpacked(value, arrays: list):
    """What `_packed` was given; a KeyError, TypeError or ValueError for anything else."""
    if not isinstance(value, dict):
        return value
    match value:
        case {"array": int(number)}:
            return arrays[range(len(arrays)).index(number)]
        case {"mapping": dict(items)}:
            return {key: _unpacked(item, arrays) for key, item in items.items()}
        case {"record": str(name), "fields": dict(given)}:
            if given.keys() != {one.name for one in fields(RECORDS[name])}:
                raise ValueError(f"a {name} has other fields")
            return RECORDS[name](**{key: _unpacked(item, arrays) for key, item in given.items()})
    raise ValueError("its header holds something else")


# --- the one to go on from ------------------------------------------------------------------------


def find(folder: Path) -> Restart:
    """The newest restart of a run that can be read, of the exact ones if there are any.

    Raises
    ------
    InputError
        Where there is none.
    """
    found, broken = [], None
    for path in files(folder):
        try:
            found.append(read(path))
        except InputError as error:
            broken = broken or error
    if not found and broken:
        raise broken
    if not found:
        raise _nothing(folder)
    return next((one for one in found if one.exact), found[0])


def _nothing(folder: Path) -> InputError:
    """Why there is nothing to go on from."""
    if not folder.is_dir():
        remedy = "Give the folder of a run; -o names that of a new one."
        return InputError(f"--resume {folder}", "there is no such folder", remedy=remedy)
    remedy = "Run it anew with --overwrite; restart_steps in [output] writes restart files."
    told = _summary(folder)
    if told.get("status") == DONE:
        words = f"the run in {folder} is complete up to t = {told['t']:g} s"
        return InputError(words, "there is no restart file to go beyond", remedy=remedy)
    return InputError(f"{folder} holds no restart file", remedy=remedy)


def drop_later(folder: Path, restart: Restart) -> None:
    """Remove the files of later steps: the run comes to them again."""
    for path in files(folder):
        if path.name > f"restart_{restart.memory.step:09d}.npz":
            with writing(path):
                path.unlink()


def refuse_another(restart: Restart, scene: str, start: str, folder: Path) -> None:
    """Raise `InputError`, with the difference, for a restart of another scene.

    `time.t_end` may be another, and what does not change a run may differ; but there must be
    something left to do, be it no more than the summary.
    """
    then, now = (_flat(tomllib.loads(text)) for text in (restart.scene, scene))
    keys = [key for key in {**then, **now} if then.get(key) != now.get(key)]
    keys = [key for key in keys if key.split(".")[0] not in FREE and key != "time.t_end"]
    if keys:
        nothing = "nothing"
        each = (f"{k} = {then.get(k, nothing)} there, {now.get(k, nothing)} here" for k in keys)
        remedy = "Resume with the scene that the run was started with, or start another run."
        raise InputError(f"another scene than that of {folder}", "; ".join(each), remedy=remedy)
    if restart.start != start:
        allowed = "the mesh, or the frame that it starts from, is another one than it was"
        raise InputError(f"another start than that of {folder}", allowed)
    to_go = now["time.t_end"] - restart.state.t
    if to_go < 0 or (to_go == 0 and _closed(folder, restart.state.t)):
        allowed = f"the run in {folder} has come to {restart.state.t:g} s already"
        remedy = "To go on beyond its end, raise it: --set time.t_end=..."
        raise InputError(f"time.t_end = {now['time.t_end']}", allowed, remedy=remedy)


def _closed(folder: Path, t: float) -> bool:
    """Whether a run has told that it came to t; one that is killed before has that to do."""
    return _summary(folder).get("t") == t


def _summary(folder: Path) -> dict:
    """What summary.json says; nothing if there is none."""
    try:
        found = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}


def _flat(data, key: str = "") -> dict:
    """{"terms.0.type": "StVK", …}."""
    if not isinstance(data, dict | list):
        return {key: data}
    items = data.items() if isinstance(data, dict) else enumerate(data)
    flat: dict = {}
    for name, value in items:
        flat |= _flat(value, f"{key}.{name}" if key else str(name))
    return flat


def digest(cloth, state: State) -> str:
    """A fingerprint of a mesh and a start."""
    whole = hashlib.sha256()
    for array in (cloth.X, cloth.cells, state.x, state.v):
        whole.update(np.ascontiguousarray(array).tobytes())
    return whole.hexdigest()


def machine() -> dict[str, str]:
    """What the last bits depend on: the versions, and the threads of PARDISO."""
    return versions() | {"threads": str(threads())}


def differences(restart: Restart) -> str:
    """In words what has changed since, or ""."""
    then, now = restart.made_on, machine()
    keys = [key for key in then.keys() & now.keys() if "None" != then[key] != now[key] != "None"]
    return "; ".join(f"{key} was {then[key]}, is {now[key]}" for key in sorted(keys))
