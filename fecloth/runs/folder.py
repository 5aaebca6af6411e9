"""The folder of one run: tables that grow row by row, a summary, a log; files written whole."""

import csv
import io
import json
import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
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

    def __init__(self, path: Path):
        """Open a new table, or an earlier one to add rows with the keys of its header.

        Raise `WriteError` if the file cannot be opened.
        """
        self.path = path
        self._header: tuple[str, ...] = ()
        with writing(path):
            # Without a buffer the system has each row at once: a killed process loses none.
            self._stream = path.open("ab", buffering=0)
            self.size = self._stream.tell()
            if self.size:
                with path.open(newline="", encoding="utf-8") as stream:
                    self._header = tuple(next(csv.reader(stream)))

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
                with suppress(WriteError):  # the first error is the one to report
                    self.cut(self.size)
                raise
        self._header = header
        self.size = self._stream.tell()

    def cut(self, size: int) -> None:
        """Remove the bytes beyond the first `size`. Raise `InputError` if there are fewer."""
        if size > self.size:
            remedy = "Run the scene again with --overwrite."
            raise InputError(f"{self.path} has lost rows", remedy=remedy)
        with writing(self.path):
            self._stream.truncate(size)
        self.size = size
        if not size:  # the header is gone, too: the next row gives it again
            self._header = ()

    def column(self, name: str) -> list[float]:
        """Return the numbers of one column."""
        with writing(self.path), self.path.open(newline="", encoding="utf-8") as stream:
            return [float(row[name]) for row in csv.DictReader(stream)]

    def close(self) -> None:
        """Close the file."""
        with writing(self.path):
            self._stream.close()


TABLES = ("steps.csv", "energies.csv", "observed.csv", "strains.csv")
# Patterns of the files that fecloth writes into the folder of a run. The tables are the last:
# `RunFolder.refuse` knows the folder by them, so an interrupted removal can be repeated.
FILES = (
    "run.pvd",
    "run.vtu.series",
    "run.vtkhdf",
    "obstacles.pvd",
    "frames/frame_*.vtu",
    "frames/obstacles_*.vtu",
    "restart/restart_*.npz",
    "report.html",
    "view.html",
    "summary.json",
    "run.log",
    "scene.resolved.toml",
    *TABLES,
)


@dataclass(frozen=True)
class RunFolder:
    """Where one run writes; a new one is made by `create`.

    Each row and each line is handed to the operating system at once, and whole files are
    replaced in one go: a killed process loses nothing. After a power cut only what restart
    files need is safe; see `flush_to_disk`.
    """

    path: Path

    def check_in_place(self) -> None:
        """Raise `WriteError` if the folder is no longer there."""
        if not self.path.is_dir():
            remedy = (
                "What was written is in it under its new name, where --resume continues the run."
            )
            raise WriteError(f"{self.path} was moved or removed during the run", remedy=remedy)

    @classmethod
    def create(cls, path: str | Path, overwrite: bool = False) -> "RunFolder":
        """Make an empty folder, or with `overwrite` clear an earlier run's files out of one.

        Only what fecloth writes into a run's folder is removed: `FILES`.
        """
        path = Path(path)
        cls.refuse(path, overwrite)
        with writing(path):
            path.mkdir(parents=True, exist_ok=True)
            _clear(path)
        return cls(path)

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
        """Open a table, e.g. "steps.csv"; in a continued run it has its earlier rows."""
        return Table(self.path / name)

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


def _clear(path: Path) -> None:
    """Remove a run's files from a folder, also half written ones, and its inner folders."""
    for pattern in FILES:
        for file in [*path.glob(pattern), *path.glob(f"{pattern}.part")]:
            file.unlink()
    for inner in ("frames", "restart"):
        with suppress(OSError):  # it is not there, or holds files of the user
            (path / inner).rmdir()


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
