"""Files written whole or not at all, and folders that one process writes into at a time."""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from fecloth.errors import InputError

_SPACE = "Free space or choose another folder."
_REMEDIES = {  # of what is told with exit status 3
    errno.ENOSPC: _SPACE,
    getattr(errno, "EDQUOT", errno.ENOSPC): _SPACE,
    errno.EFBIG: "Raise the limit on the size of a file (ulimit -f), or choose another disk.",
}


class WriteError(InputError):
    """The system does not let a file be read or written."""


class DiskFull(WriteError):
    """There is no room for a file, or none may be so large."""

    @staticmethod
    def said(words: str) -> int | None:
        """The error number of a full disk that another program's words end in, or None."""
        return next((number for number in _REMEDIES if os.strerror(number) in words), None)


def replace_file(path: Path, data: bytes) -> None:
    """Write a file in one go: whoever opens it finds the old bytes or all the new ones.

    Raises
    ------
    InputError
        If the system refuses; the old file is then untouched.
    """
    with in_one_go(path) as part:
        part.write_bytes(data)


def lengthen(path: Path, data: bytes, tail: int) -> None:
    """The same with the old file's bytes, less the last `tail` of them, and the new ones."""
    with in_one_go(path) as part:
        shutil.copyfile(path, part)
        with part.open("r+b") as stream:
            stream.seek(-tail, os.SEEK_END)
            stream.write(data)


@contextmanager
def in_one_go(path: Path) -> Iterator[Path]:
    """A file to write, which then takes the place of the path."""
    part = path.with_name(path.name + ".part")
    with writing(path):
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            yield part
            os.replace(part, path)
        except BaseException:
            with suppress(OSError):
                part.unlink(missing_ok=True)
            raise


def on_disk(*paths: Path) -> None:
    """Wait until files, and the names that folders hold, would survive a power cut."""
    for path in paths:
        if path.is_dir() and os.name == "nt":
            continue  # Windows opens no folders
        with writing(path):
            file = os.open(path, os.O_RDONLY if path.is_dir() else os.O_RDWR)
            try:
                os.fsync(file)
            finally:
                os.close(file)


@contextmanager
def alone(path: Path) -> Iterator[None]:
    """Hold a run's folder, so that no other run writes into it meanwhile.

    The operating system's lock on the folder itself, which ends with the process however that
    ends; nothing where there is none (Windows, some network drives).

    Raises
    ------
    InputError
        If another run holds it.
    """
    try:
        import fcntl
    except ImportError:
        yield
        return
    with writing(path):
        folder = os.open(path, os.O_RDONLY)
    try:
        try:
            fcntl.flock(folder, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            remedy = "Wait for its end, or choose another folder with -o."
            raise InputError(f"folder {path}", _holder(path), remedy=remedy) from error
        except OSError:  # a drive without locks
            pass
        yield
    finally:
        os.close(folder)


def _holder(path: Path) -> str:
    """Who writes there, as its log says."""
    with suppress(OSError):
        lines = (path / "run.log").read_text(encoding="utf-8", errors="replace").splitlines()
        if found := [line for line in lines if " process " in line]:
            when, _, words = found[-1].partition(" ")
            return f"another run writes there: {words.split(';')[0]}, since {when}"
    return "another run writes there"


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Turn an OSError inside into a `WriteError` that names the file and the reason."""
    try:
        yield
    except OSError as error:
        what = f"{path} cannot be written: {error.strerror or error}"
        if error.errno in _REMEDIES:
            raise DiskFull(what, remedy=_REMEDIES[error.errno]) from error
        raise WriteError(what, remedy="Choose another folder.") from error
