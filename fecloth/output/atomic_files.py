"""Files written whole or not at all, and folders locked for one process."""

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from filelock import FileLock, Timeout

from fecloth.errors import BAD_INPUT, FAILED, InputError

LOCK = ".lock"  # in the folder of a run while it runs
_NO_LOCKS = (errno.ENOSYS, errno.ENOLCK, errno.EOPNOTSUPP)
_SPACE = "Free space or choose another folder."
_REMEDIES = {  # errors with exit status 3
    errno.ENOSPC: _SPACE,
    getattr(errno, "EDQUOT", errno.ENOSPC): _SPACE,
    errno.EFBIG: "Raise the limit on the size of a file (ulimit -f), or choose another disk.",
}


class WriteError(InputError):
    """The system refuses to read or write a file."""


class DiskFull(WriteError):
    """The disk is full, or a file reaches the allowed size."""

    @staticmethod
    def errno_in(words: str) -> int | None:
        """Return the error number of a full disk in another program's message, or None."""
        return next((number for number in _REMEDIES if os.strerror(number) in words), None)


def ending_of(error: Exception) -> tuple[int, str]:
    """Return the exit status of a command that ends with this error, and the line to print.

    `error` is a `FeclothError`, an OSError or a MemoryError. The status is `BAD_INPUT` for a
    mistake of the user, else `FAILED`. A full disk is no mistake of the user.
    """
    if isinstance(error, MemoryError):
        return FAILED, f"failed: memory is full ({error}). Take a coarser mesh."
    if isinstance(error, OSError):  # of the system, as where Numba keeps machine code
        if error.errno in _REMEDIES:
            return FAILED, f"failed: {error}. {_REMEDIES[error.errno]}"
        return BAD_INPUT, f"error: {error}"
    if isinstance(error, InputError) and not isinstance(error, DiskFull):
        return BAD_INPUT, f"error: {error}"
    return FAILED, f"failed: {error}"


def replace_file(path: Path, data: bytes) -> None:
    """Replace a file in one go: a reader finds all old bytes or all new ones."""
    with replacing(path) as part:
        part.write_bytes(data)


def append_in_place(path: Path, data: bytes, tail: int) -> None:
    """Write `data` in the place of the last `tail` bytes of a file, in one write.

    A killed process leaves the file as it was or with all the new bytes. After an error the file
    is as it was, and `WriteError` is raised. The cost does not depend on the size of the file.
    """
    with writing(path), path.open("r+b", buffering=0) as stream:
        place = stream.seek(-tail, os.SEEK_END)
        old_end = stream.read(tail)
        stream.seek(place)
        try:
            while data:  # an almost full disk takes a part
                data = data[stream.write(data) :]
        except BaseException:
            with suppress(OSError):  # report the first error
                stream.seek(place)
                stream.write(old_end)
                stream.truncate()
            raise


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield the path of a temporary file that replaces `path` at the end of the block.

    After an error in the block the temporary file is removed, and `path` is as it was. An
    OSError is raised as a `WriteError`. The folder of `path` is made if there is none.
    """
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


def flush_to_disk(*paths: Path) -> None:
    """Wait until the contents of files, and the entries of folders, would survive a power cut.

    Raises `WriteError` if the system cannot write one of them.
    """
    for path in paths:
        if path.is_dir() and os.name == "nt":
            continue  # Windows cannot open folders
        with writing(path):
            # A folder can be opened for reading only.
            file = os.open(path, os.O_RDONLY if path.is_dir() else os.O_RDWR)
            try:
                os.fsync(file)
            finally:
                os.close(file)


@contextmanager
def lock_folder(path: Path) -> Iterator[None]:
    """Lock a run's folder against other runs, by a lock on the file `LOCK` in it.

    The lock ends with the block, or with the process, however that ends. On a drive without
    locks it does nothing. Raises `InputError` if another process has the lock, and `WriteError`
    if the file cannot be made.
    """
    lock = FileLock(path / LOCK, timeout=0)
    with writing(path):
        try:
            lock.acquire()
        except Timeout as error:
            remedy = "Wait for its end, or choose another folder with -o."
            raise InputError(f"folder {path}", _holder(path), remedy=remedy) from error
        except OSError as error:
            if error.errno not in _NO_LOCKS:
                raise
    try:
        yield
    finally:
        # Windows does not remove a file that is open; there the release removes it.
        with suppress(OSError):
            (path / LOCK).unlink()
        lock.release()


def _holder(path: Path) -> str:
    """Return which process writes there, by its log."""
    with suppress(OSError):
        lines = (path / "run.log").read_text(encoding="utf-8", errors="replace").splitlines()
        if holders := [line for line in lines if " process " in line]:
            when, _, words = holders[-1].partition(" ")
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
