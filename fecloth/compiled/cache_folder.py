"""Where the machine code of the kernels is stored: a folder that nobody else can write.

Numba runs the code that it finds there. A folder that another user made, or can write, could
hold code of that user.
"""

import atexit
import hashlib
import os
import shutil
import stat
import tempfile
import warnings
from functools import cache
from pathlib import Path


@cache
def cache_folder() -> str:
    """Folder for the machine code of these very kernels.

    It lies in ``$NUMBA_CACHE_DIR``, else ``$XDG_CACHE_HOME``, else ``~/.cache``, else in the
    temporary directory: the first where it can be written, and where `can_be_trusted` says so of
    it. If no folder can, the process has one of its own until it ends.
    """
    name = f"fecloth-{_digest_of_sources()}"
    bases = [
        os.environ.get("NUMBA_CACHE_DIR"),
        os.environ.get("XDG_CACHE_HOME"),
        os.path.expanduser("~/.cache"),
    ]
    user = os.getuid() if os.name == "posix" else ""
    folders = [Path(os.path.realpath(base)) / name for base in bases if base]
    folders.append(Path(os.path.realpath(tempfile.gettempdir())) / f"{name}-{user}")
    writable = [folder for folder in folders if _make(folder)]
    for folder in writable:
        if can_be_trusted(folder):
            return str(folder)
    folder = Path(tempfile.mkdtemp(prefix="fecloth-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    _warn_of(writable)
    return str(folder)


def can_be_trusted(folder: Path) -> bool:
    """Whether only this user and root can change what a folder holds.

    The folder must be a real one, no symbolic link, and this user's; each folder above it must
    be this user's or root's. Group and others must not be able to write any of them; the
    folders above may have the sticky bit instead, as ``/tmp`` has. On Windows the answer is
    yes: there a user's folders have lists of access rights.
    """
    if os.name != "posix":
        return True
    mine = folder.lstat()
    if not stat.S_ISDIR(mine.st_mode) or mine.st_uid != os.getuid() or mine.st_mode & 0o022:
        return False
    above = [each.lstat() for each in folder.parents]
    return all(
        each.st_uid in (0, os.getuid())
        and (not each.st_mode & 0o022 or each.st_mode & stat.S_ISVTX)
        for each in above
    )


def _digest_of_sources() -> str:
    digest = hashlib.sha256()
    compiler = Path(__file__).with_name("jit.py")
    for source in sorted(Path(__file__).parents[1].rglob("*.py")):
        text = source.read_bytes()
        if b"fecloth.compiled.jit import" in text or source == compiler:
            digest.update(text)
    return digest.hexdigest()[:16]


def _make(folder: Path) -> bool:
    """Make a folder, and those above it that are missing, for this user only, if possible."""
    try:
        for each in reversed([folder, *folder.parents]):
            if not each.exists():
                each.mkdir(mode=0o700, exist_ok=True)
    except OSError:
        return False
    return os.access(folder, os.W_OK)


def _warn_of(folders: list[Path]) -> None:
    if folders:
        words = (
            f"machine code is compiled anew for this process: other users can change what is in "
            f"{', '.join(map(str, folders))}. Remove it, and take the right to write from group "
            f"and others on the folders above it (chmod go-w), or set NUMBA_CACHE_DIR to a folder "
            f"of your own."
        )
        warnings.warn(words, RuntimeWarning, stacklevel=2)
