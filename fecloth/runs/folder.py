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
        """Open a new table, or an earlier one truncated to `size` bytes."""
        self.path = path
        self.size = size or 0
        self._header: tuple[str, ...] = ()
        with writing(path):
            if size:
                os.truncate(path, size)
                with path.open(newline="", encoding="utf-8") as stream:
                    self._header = tuple(next(csv.reader(stream)))
            self._stream = path.open("ab" if size else "wb", buffering=0)

    def add(self, row: Mapping[str, object]) -> None:
        """Write one row.

        Raises `InputError` if its keys are not the keys of the first row, or the disk is full.
        """
        header = self._header or tuple(row)
        if row.keys() != set(header):
            odd = ", ".join(sorted(row.keys() ^ set(header)))
            raise InputError(f"keys {odd}", "must be the keys of the first row", str(self.path))
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        if not self._header:
            writer.writerow(header)
        writer.writerow([row[key] for key in header])
        data = text.getvalue().encode()
        with writing(self.path):
            try:
                while data:  # an almost full disk takes a part
                    data = data[self._stream.write(data) :]
            except BaseException:
                with suppress(OSError):  # report the first error
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
        """Raise `FolderMoved` if this is no longer the folder that was opened."""
        try:
            inode = self.path.stat().st_ino
        except OSError:
            inode = -1
        if self.inode not in (None, inode):
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
        """Return the folder of a run to continue; each table is cut to its number of bytes."""
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
        """Raise the `InputError` of `create` for a folder that is not empty; change nothing."""
        path = Path(path)
        with writing(path):
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
    """Remove a run's files if the block raises; also the folder if it `is_new`, of this run."""
    try:
        yield
    except BaseException:
        with suppress(OSError):
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
    """Yield the files that fecloth wrote; the tables, which tell a run's folder, are the last."""
    for pattern in LISTS:
        for file in [*path.glob(pattern), *path.glob(f"{pattern}.part")]:
            text = file.read_bytes()
            if any(f'"frames/{name}'.encode() in text for name in FRAMES):
                yield file
    for name in FRAMES:
        for suffix in ("vtu", "vtu.part"):
            yield from (path / "frames").glob(f"{name}*.{suffix}")
    for pattern in ("restart_*.npz", "restart_*.npz.part"):
        yield from (path / "restart").glob(pattern)
    for name in (*TEXTS, *TABLES):
        yield from (file for file in (path / name, path / f"{name}.part") if file.is_file())


def _plain(value):
    """Return the value in JSON's types; a number that is not finite becomes None."""
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
