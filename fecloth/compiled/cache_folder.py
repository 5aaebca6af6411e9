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
    """Return the folder for the machine code of the kernels of these sources; make it if needed.

    It lies in ``$NUMBA_CACHE_DIR``, else ``$XDG_CACHE_HOME``, else ``~/.cache``, else in the
    temporary directory: in the first one where it can be written and `can_be_trusted`. If there
    is none, the process has a folder of its own until it ends, and a `RuntimeWarning` says why.
    """
    name = f"fecloth-{_digest_of_sources()}"
    bases = [
        os.environ.get("NUMBA_CACHE_DIR"),
        os.environ.get("XDG_CACHE_HOME"),
        os.path.expanduser("~/.cache"),
    ]
    # all users share the temporary directory: each has a folder of his own there
    user = os.getuid() if os.name == "posix" else ""
    folders = [Path(os.path.realpath(base)) / name for base in bases if base]
    folders.append(Path(os.path.realpath(tempfile.gettempdir())) / f"{name}-{user}")
    for folder in folders:
        if _make(folder) and can_be_trusted(folder):
            return str(folder)
    own_folder = Path(tempfile.mkdtemp(prefix="fecloth-"))
    atexit.register(shutil.rmtree, own_folder, ignore_errors=True)
    _warn_of(folders)
    return str(own_folder)


def can_be_trusted(folder: Path) -> bool:
    """Whether only this user and root can change what a folder holds.

    The folder must be a real one, no symbolic link, and belong to this user. Each folder above
    it must belong to this user or to root. Group and others must not be able to write any of
    them; the folders above may have the sticky bit instead, as ``/tmp`` has. On Windows the
    answer is yes: there a user's folders have lists of access rights.
    """
    if os.name != "posix":
        return True
    status = folder.lstat()
    is_mine = stat.S_ISDIR(status.st_mode) and status.st_uid == os.getuid()
    if not is_mine or _others_can_write(status):
        return False
    return all(_can_be_above(parent.lstat()) for parent in folder.parents)


def _others_can_write(status: os.stat_result) -> bool:
    """Whether group or others can write a folder."""
    return bool(status.st_mode & (stat.S_IWGRP | stat.S_IWOTH))


def _can_be_above(status: os.stat_result) -> bool:
    """Whether a folder may be above a folder that can be trusted."""
    is_sticky = bool(status.st_mode & stat.S_ISVTX)
    belongs = status.st_uid in (0, os.getuid())
    return belongs and (is_sticky or not _others_can_write(status))


def _digest_of_sources() -> str:
    """Hash of all source files of the package that hold kernels, and of this folder."""
    digest = hashlib.sha256()
    compiler = Path(__file__).parent
    for source in sorted(Path(__file__).parents[1].rglob("*.py")):
        text = source.read_bytes()
        if b"fecloth.compiled.jit import" in text or source.parent == compiler:
            digest.update(text)
    return digest.hexdigest()[:16]


def _make(folder: Path) -> bool:
    """Make a folder, and those above it that are missing, for this user only, if possible."""
    try:
        for place in reversed([folder, *folder.parents]):
            if not place.exists():
                place.mkdir(mode=0o700, exist_ok=True)
    except OSError:
        return False
    return os.access(folder, os.W_OK)


def _warn_of(folders: list[Path]) -> None:
    """Warn of `folders`, none of which can hold machine code: say of each why not."""
    reasons = []
    for folder in folders:
        if os.access(folder, os.W_OK):
            reasons.append(f"other users can change what is in {folder}")
        elif folder.exists():
            reasons.append(f"{folder} cannot be written and may be of another user")
        else:
            reasons.append(f"{folder} cannot be made")
    message = (
        f"machine code is compiled anew for this process: {', '.join(reasons)}. Set "
        "NUMBA_CACHE_DIR to a folder of your own; or remove these folders, and take the right to "
        "write from group and others on the folders above (chmod go-w)."
    )
    warnings.warn(message, RuntimeWarning, stacklevel=2)
