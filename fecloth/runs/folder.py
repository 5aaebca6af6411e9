"""The folder of one run: tables that grow row by row, a summary, a log; files written whole."""

import csv
import io
import json
import math
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from datetime import datetime
from pathlib import Path

import numpy as np

from fecloth.errors import InputError
from fecloth.output.atomic_files import LOCK, WriteError, replace_file, writing


class Table:
    """A .csv file of rows with equal keys, each handed to the system before `add` returns.

    Numbers read back as the same float64. A row that does not fit on the disk leaves no part.
    `size` counts the bytes written.
    """

    def __init__(self, path: Path, size: int | None = None):
        """Open a new table, or an earlier one truncated to its first `size` bytes.

        The header of an earlier table is read, because further rows must have its keys. Raise
        `WriteError` if the file cannot be opened.
        """
        self.path = path
        self.size = size or 0
        self._header: tuple[str, ...] = ()
        with writing(path):
            if size:
                os.truncate(path, size)
                with path.open(newline="", encoding="utf-8") as stream:
                    self._header = tuple(next(csv.reader(stream)))
            # Without a buffer the system has each row at once: a killed process loses none.
            self._stream = path.open("ab" if size else "wb", buffering=0)

    def add(self, row: Mapping[str, object]) -> None:
        """Write one row; the first row of a new table also gives the header.

        Raise `InputError` if its keys are not the keys of the first row, and `WriteError`, which
        is an `InputError`, if the disk is full. Then no part of the row is left in the file.
        """
        header = self._header or tuple(row)
        if row.keys() != set(header):
            different_keys = ", ".join(sorted(row.keys() ^ set(header)))
            what = f"keys {different_keys}"
            raise InputError(what, "must be the keys of the first row", str(self.path))
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        if not self._header:
            writer.writerow(header)
        writer.writerow([row[key] for key in header])
        data = text.getvalue().encode()
        with writing(self.path):
            try:
                while data:  # an almost full disk takes only a part at a time
                    written = self._stream.write(data)
                    data = data[written:]
            except BaseException:  # also a signal in the middle of a row
                with suppress(OSError):  # the first error is the one to report
                    self.cut(self.size)
                raise
        self._header = header
        self.size = self._stream.tell()

    def cut(self, size: int) -> None:
        """Remove the bytes beyond the first `size`."""
        self._stream.truncate(size)
        self._stream.seek(size)
        self.size = size

    def column(self, name: str) -> list[float]:
        """Return the numbers of one column."""
        with writing(self.path), self.path.open(newline="", encoding="utf-8") as stream:
            return [float(row[name]) for row in csv.DictReader(stream)]

    def close(self) -> None:
        """Close the file."""
        with writing(self.path):
            self._stream.close()


TABLES = ("steps.csv", "energies.csv", "observed.csv", "strains.csv")
PAGES = ("report.html", "view.html")
TEXTS = ("summary.json", "scene.resolved.toml", "run.log", *PAGES, "run.vtkhdf")
FRAMES = ("frame_", "obstacles_")  # how the names of the files in frames/ begin
LISTS = ("*.pvd", "*.vtu.series")  # a run's folder is cleared of such lists of these files only


class FolderMoved(WriteError):
    """The folder of a run is no longer where it was made."""


@dataclass(frozen=True)
class RunFolder:
    """Where one run writes; made by `create`.

    Each row and each line is handed to the operating system at once, and whole files are
    replaced in one go: a killed process loses nothing. After a power cut only what restart
    files need is safe; see `flush_to_disk`.
    """

    path: Path
    sizes: Mapping[str, int] = field(default_factory=dict)
    inode: int | None = None

    def check_in_place(self) -> None:
        """Raise `FolderMoved` if the path no longer leads to the folder that was opened.

        The folder is known by its inode, a number that it keeps when it is moved.
        """
        try:
            inode_now = self.path.stat().st_ino
        except OSError:
            inode_now = -1  # no folder is there
        if self.inode not in (None, inode_now):
            remedy = (
                "What was written is in it under its new name, where --resume continues the run."
            )
            raise FolderMoved(f"{self.path} was moved or removed during the run", remedy=remedy)

    @classmethod
    def create(cls, path: str | Path, overwrite: bool = False) -> "RunFolder":
        """Make an empty folder, or with `overwrite` clear an earlier run's files out of one.

        Only what fecloth writes into a run's folder is removed: frames, the lists that name
        them, tables, summary, resolved scene and log.
        """
        path = Path(path)
        cls.refuse(path, overwrite)
        with writing(path):
            path.mkdir(parents=True, exist_ok=True)
            _clear(path)
            return cls(path, inode=path.stat().st_ino)

    @classmethod
    def reopen(cls, path: str | Path, tables: Mapping[str, int]) -> "RunFolder":
        """Return the folder of a run to continue.

        `tables` has the name of each table and its number of bytes, to which `table` cuts it.
        Raise `InputError` for a table that is shorter, and `WriteError` for one that is missing.
        """
        folder = cls(Path(path), dict(tables))
        for name, size in tables.items():
            file = folder.path / f"{name}.csv"
            with writing(file):
                if file.stat().st_size < size:
                    what = f"{file} has lost rows"
                    raise InputError(what, remedy="Run the scene again with --overwrite.")
        return replace(folder, inode=folder.path.stat().st_ino)

    @staticmethod
    def refuse(path: str | Path, overwrite: bool = False) -> None:
        """Raise `InputError` if `create` would refuse this folder; change nothing.

        A folder that is not empty is refused without `overwrite`, and with it if it holds no
        run: so no other files are ever removed.
        """
        path = Path(path)
        with writing(path):
            # A folder with nothing but the lock of this process counts as empty.
            if not path.exists() or {LOCK} >= {file.name for file in path.iterdir()}:
                return
            if not overwrite:
                remedy = "Choose another folder with -o, or pass --overwrite to replace its run"
                if any(path.glob("restart/restart_*.npz")):
                    remedy += f", or --resume {path} to continue it"
                remedy += "."
                raise InputError(f"output folder {path}", "is not empty", remedy=remedy)
            if not any((path / name).is_file() for name in ("scene.resolved.toml", *TABLES)):
                remedy = "Choose another folder with -o."
                what = f"output folder {path}"
                raise InputError(what, "contains other files than a run's", remedy=remedy)

    def table(self, name: str) -> Table:
        """Open a table, e.g. "steps.csv", with the keys of its first row as header.

        It is empty; in a continued run it has its earlier rows.
        """
        return Table(self.path / name, self.sizes.get(Path(name).stem))

    def summary(self, values: Mapping) -> None:
        """Replace summary.json; arrays become lists and numbers that are not finite null."""
        text = json.dumps(_plain(values), indent=2, ensure_ascii=False)
        self.text("summary.json", f"{text}\n")

    def text(self, name: str, text: str) -> None:
        """Replace a text file, e.g. "scene.resolved.toml"."""
        self.check_in_place()
        replace_file(self.path / name, text.encode())

    def log(self, message: str) -> None:
        """Append a line with the time of day to run.log."""
        self.check_in_place()
        file = self.path / "run.log"
        with writing(file), file.open("a", encoding="utf-8") as stream:
            stream.write(f"{datetime.now().isoformat(timespec='milliseconds')} {message}\n")


@contextmanager
def remove_on_failure(path: Path, is_new: bool) -> Iterator[None]:
    """Remove the files of a run from the folder `path` if the block raises.

    If the folder `is_new`, made by this run, it is removed, too. The error passes on.
    """
    try:
        yield
    except BaseException:
        with suppress(OSError):  # the error of the block is the one to report
            _clear(path)
            if is_new:
                (path / LOCK).unlink(missing_ok=True)
                path.rmdir()
        raise


def _clear(path):
    """Remove a run's files from a folder, and its folders of frames and restarts if empty."""
    for file in _files_of_run(path):
        file.unlink()
    for inner in (path / "frames", path / "restart"):
        if inner.is_dir() and not inner.is_symlink() and not any(inner.iterdir()):
            inner.rmdir()


def _files_of_run(path):
    """Yield the files that fecloth wrote into a run's folder, also half written ones (.part).

    The tables are the last: `RunFolder.refuse` knows a run's folder by them, so a removal that
    is interrupted can be repeated.
    """
    for pattern in LISTS:
        for file in [*path.glob(pattern), *path.glob(f"{pattern}.part")]:
            content = file.read_bytes()
            # Only a list that names frames of a run: the user's own lists stay.
            if any(f'"frames/{name}'.encode() in content for name in FRAMES):
                yield file
    for name in FRAMES:
        for suffix in ("vtu", "vtu.part"):
            yield from (path / "frames").glob(f"{name}*.{suffix}")
    for pattern in ("restart_*.npz", "restart_*.npz.part"):
        yield from (path / "restart").glob(pattern)
    for name in (*TEXTS, *TABLES):
        yield from (file for file in (path / name, path / f"{name}.part") if file.is_file())


def _plain(value):
    """Return the value in JSON's types.

    Arrays and tuples become lists, a number that is not finite becomes None, and an object of
    any other class becomes its text.
    """
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return _plain(value.tolist())
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if value is None or isinstance(value, bool | int | str):
        return value
    return str(value)
