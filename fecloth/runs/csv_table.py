"""A .csv file that grows row by row; what is written survives the process."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from fecloth.errors import InputError
from fecloth.output.atomic_files import writing


class Table:
    """A .csv file of rows with equal keys, each handed to the system once `add` returns.

    Numbers are written so that they read back as the same float64. A row for which there is no
    room leaves nothing of itself.

    Attributes
    ----------
    size
        Bytes written.
    """

    def __init__(self, path: Path, kept: int | None = None):
        self.path, self.size = path, kept or 0
        self._header: tuple[str, ...] = ()
        with writing(path):
            if kept:
                os.truncate(path, kept)
                with path.open(newline="", encoding="utf-8") as stream:
                    self._header = tuple(next(csv.reader(stream)))
            self._stream = path.open("ab" if kept else "wb", buffering=0)

    def add(self, row: Mapping[str, object]) -> None:
        """Write one row.

        Raises
        ------
        InputError
            If its keys are not the first row's, or the file cannot be written.
        """
        header = self._header or tuple(row)
        if row.keys() != set(header):
            odd = ", ".join(sorted(row.keys() ^ set(header)))
            raise InputError(f"keys {odd}", "must be those of the first row", str(self.path))
        line = [row[key] for key in header]
        data = _csv([line] if self._header else [header, line])
        with writing(self.path):
            try:
                while data:  # a disk that is almost full takes a part
                    data = data[self._stream.write(data) :]
            except BaseException:
                with suppress(OSError):  # that first one is told
                    self.cut(self.size)
                raise
        self._header, self.size = header, self._stream.tell()

    def cut(self, size: int) -> None:
        """Take the bytes beyond the first `size` away."""
        self._stream.truncate(size)
        self._stream.seek(size)
        self.size = size

    def column(self, name: str) -> list[float]:
        """The numbers of one column."""
        with writing(self.path), self.path.open(newline="", encoding="utf-8") as stream:
            return [float(row[name]) for row in csv.DictReader(stream)]

    def close(self) -> None:
        with writing(self.path):
            self._stream.close()

    def __enter__(self) -> Table:
        return self

    def __exit__(self, *_) -> None:
        self.close()


def _csv(rows) -> bytes:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue().encode()
