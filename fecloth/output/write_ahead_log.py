"""A file changed in place that has either all changes of a block or none.

The changes of a block are held in memory, and reads see them. At the end of the block they are
written in one go to another file, `NAME.redo`; then they are made, and that file is removed. A
process that finds a .redo makes its changes again. This is the write-ahead log of databases (Mohan
and others 1992, ACM Transactions on Database Systems 17, 94-162) with one record.
"""

import errno
import io
import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from hashlib import sha256
from pathlib import Path

from fecloth.output.atomic_files import flush_to_disk, replace_file, writing


@contextmanager
def changing(path: Path) -> Iterator[io.RawIOBase]:
    """Yield the file to read and write; it changes when the block ends without an error."""
    with writing(path):
        recover(path)
        with path.open("rb") as base:
            stream = _Waiting(base)
            yield stream
        data = b"".join(data for _, data in stream.changes)
        places = [(at, len(data)) for at, data in stream.changes]
        head = json.dumps([sha256(data).hexdigest(), stream.size, places])
        replace_file(_redo(path), head.encode() + b"\n" + data)
        flush_to_disk(_redo(path), path.parent)
        _reserve(path, stream.size)
        recover(path)


def recover(path: Path) -> None:
    """Complete the changes that a killed process has begun, if any."""
    redo = _redo(path)
    if not redo.exists():
        return
    with writing(path):
        if (read := _read(redo)) is not None:
            _make(path, *read)
        redo.unlink()


def replace_whole(path: Path, data: bytes) -> None:
    """Replace the whole file, and drop unfinished changes of the old one."""
    with writing(path):
        _redo(path).unlink(missing_ok=True)
    replace_file(path, data)


def _read(redo: Path) -> tuple[int, list, memoryview] | None:
    """Return size, places and bytes; None if the log is incomplete, so no change was begun."""
    head, _, data = redo.read_bytes().partition(b"\n")
    try:
        digest, size, places = json.loads(head)
    except (ValueError, TypeError):
        return None
    return (size, places, memoryview(data)) if digest == sha256(data).hexdigest() else None


def _make(path: Path, size: int, places: list, data: memoryview) -> None:
    with path.open("r+b") as file:
        for at, count in places:
            file.seek(at)
            file.write(data[:count])
            data = data[count:]
        file.truncate(size)
    flush_to_disk(path)


def _redo(path: Path) -> Path:
    return path.with_name(f"{path.name}.redo")


def _reserve(path: Path, size: int) -> None:
    """Reserve the space on disk before the first byte changes; refuse if there is none."""
    before = path.stat().st_size
    if size <= before or not hasattr(os, "posix_fallocate"):
        return
    with path.open("r+b") as file:
        try:
            os.posix_fallocate(file.fileno(), before, size - before)
        except OSError as error:
            if error.errno in (errno.EOPNOTSUPP, errno.EINVAL):  # a drive that cannot reserve
                return
            file.truncate(before)
            _redo(path).unlink()
            raise


class _Waiting(io.RawIOBase):
    """A file whose changes are held in memory."""

    def __init__(self, base: io.BufferedReader):
        self.base, self.place = base, 0
        self.size = base.seek(0, os.SEEK_END)  # of the file with its changes
        self.changes: list[tuple[int, bytes]] = []  # (place, bytes), in order of writing

    def seekable(self) -> bool:
        return True

    readable = writable = seekable

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        origin = {os.SEEK_SET: 0, os.SEEK_CUR: self.place, os.SEEK_END: self.size}[whence]
        self.place = origin + offset
        return self.place

    def tell(self) -> int:
        return self.place

    def readinto(self, buffer) -> int:
        begin = self.place
        view = memoryview(buffer).cast("B")
        view = view[: max(0, min(len(view), self.size - begin))]
        self.base.seek(begin)
        count = self.base.readinto(view)
        view[count:] = bytes(len(view) - count)
        for at, data in self.changes:
            first, last = max(at, begin), min(at + len(data), begin + len(view))
            if first < last:
                view[first - begin : last - begin] = data[first - at : last - at]
        self.place += len(view)
        return len(view)

    def write(self, data) -> int:
        data = bytes(data)
        self.changes.append((self.place, data))
        self.place += len(data)
        self.size = max(self.size, self.place)
        return len(data)

    def truncate(self, size: int | None = None) -> int:
        self.size = self.place if size is None else size
        return self.size
