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
    """A .csv file of rows with equal keys, each handed to the system before `add` returns.

    Numbers read back as the same float64. A row that does not fit on the disk leaves no part.

    Attributes
    ----------
    size
        Bytes written.
    """

    def __init__(self, path: Path, size: int | None = None):
        """Open a new table, or an earlier one truncated to `size` bytes."""
        self.path, self.size = path, size or 0
        self._header: tuple[str, ...] = ()
        with writing(path):
            if size:
                os.truncate(path, size)
                with path.open(newline="", encoding="utf-8") as stream:
                    self._header = tuple(next(csv.reader(stream)))
            self._stream = path.open("ab" if size else "wb", buffering=0)

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
            raise InputError(f"keys {odd}", "must be the keys of the first row", str(self.path))
        line = [row[key] for key in header]
        data = _csv([line] if self._header else [header, line])
        with writing(self.path):
            try:
                while data:  # an almost full disk takes a part
                    data = data[self._stream.write(data) :]
            except BaseException:
                with suppress(OSError):  # report the first error
                    self.cut(self.size)
                raise
        self._header, self.size = header, self._stream.tell()

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
