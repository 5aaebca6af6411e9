"""The folder of machine code: where it lies, and that nobody else can put code there."""

import os
import shutil
import stat
from pathlib import Path

import pytest

from fecloth.compiled import cache_folder

PACKAGE = Path(cache_folder.__file__).parents[1]


@pytest.fixture
def copy(tmp_path):
    """A copy of the package whose sources a test may change."""
    ignore = shutil.ignore_patterns("__pycache__")
    return shutil.copytree(PACKAGE, tmp_path / "source" / "fecloth", ignore=ignore)


def folder_for(package, monkeypatch):
    monkeypatch.setattr(cache_folder, "__file__", str(package / "compiled" / "cache_folder.py"))
    return cache_folder.cache_folder.__wrapped__()


def test_every_file_with_kernels_changes_the_folder(copy, tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    own = folder_for(copy, monkeypatch)
    assert own == folder_for(PACKAGE, monkeypatch)  # by content, wherever it lies
    decorated = [
        source
        for source in sorted(copy.rglob("*.py"))
        if any(
            word in source.read_text("utf-8") for word in ("\n@kernel", "\n@inner", "specialise(")
        )
    ]
    assert {"block_matrix.py", "membrane_loops.py", "condition.py", "stvk.py"} <= {
        p.name for p in decorated
    }
    for source in [*decorated, copy / "compiled" / "jit.py"]:
        text = source.read_bytes()
        source.write_bytes(text + b"\n")
        assert folder_for(copy, monkeypatch) != own, source.name
        source.write_bytes(text)
    with (copy / "errors.py").open("ab") as other:  # no kernels: nothing to compile anew
        other.write(b"\n")
    assert folder_for(copy, monkeypatch) == own


def test_the_folder_lies_where_it_can_be_written(tmp_path, monkeypatch):
    blocked = tmp_path / "file"
    blocked.write_text("not a folder")
    for name, value in (
        ("NUMBA_CACHE_DIR", tmp_path / "numba"),
        ("XDG_CACHE_HOME", tmp_path / "xdg"),
        ("HOME", tmp_path / "home"),
        ("USERPROFILE", tmp_path / "home"),
    ):
        monkeypatch.setenv(name, str(value))
    monkeypatch.setattr(cache_folder.tempfile, "gettempdir", lambda: str(tmp_path / "temporary"))
    wanted = [tmp_path / "numba", tmp_path / "xdg", tmp_path / "home" / ".cache"]
    for name, folder in zip(("NUMBA_CACHE_DIR", "XDG_CACHE_HOME", "HOME"), wanted, strict=True):
        assert Path(cache_folder.cache_folder.__wrapped__()).parent == folder
        monkeypatch.setenv(name, str(blocked))
        monkeypatch.setenv("USERPROFILE", os.environ["HOME"])
    assert Path(cache_folder.cache_folder.__wrapped__()).parent == tmp_path / "temporary"


@pytest.fixture
def base(tmp_path, monkeypatch):
    """The folder in $NUMBA_CACHE_DIR, where the home and the temporary folder are others."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "numba"))
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setenv("HOME", str(tmp_path / "file"))
    (tmp_path / "file").write_text("not a folder")
    (tmp_path / "temporary").mkdir()
    monkeypatch.setattr(cache_folder.tempfile, "tempdir", str(tmp_path / "temporary"))
    return tmp_path / "numba"


def chosen() -> Path:
    return Path(cache_folder.cache_folder.__wrapped__())


def test_the_folder_and_those_made_above_it_are_for_this_user_only(base, monkeypatch):
    mask = os.umask(0)
    try:
        folder = chosen()
    finally:
        os.umask(mask)
    assert folder.parent == base
    assert [stat.S_IMODE(each.stat().st_mode) for each in (folder, base)] == [0o700, 0o700]
    assert chosen() == folder  # again


def link(folder):
    folder.rename(folder.with_name("theirs"))
    folder.symlink_to(folder.with_name("theirs"))


PLANTED = {
    "folder that others write": lambda folder: folder.chmod(0o707),
    "folder that a group writes": lambda folder: folder.chmod(0o770),
    "link": link,
    "folder above that others write": lambda folder: folder.parent.chmod(0o777),
    "folder above that a group writes": lambda folder: folder.parent.chmod(0o770),
}


@pytest.mark.skipif(os.name != "posix", reason="modes of folders are of POSIX")
@pytest.mark.parametrize("plant", PLANTED.values(), ids=PLANTED)
def test_code_in_a_folder_that_others_can_change_is_not_run(base, plant):
    first = chosen()
    plant(first)
    folder = chosen()  # in the temporary folder, by a name that others may know
    assert folder.parent == base.parent / "temporary"
    plant(folder)
    with pytest.warns(RuntimeWarning, match="chmod go-w") as caught:
        fresh = chosen()
    assert str(first) in str(caught[0].message)
    assert fresh not in (first, folder)
    assert stat.S_IMODE(fresh.stat().st_mode) == 0o700
    assert not list(fresh.iterdir())
    fresh.rmdir()


@pytest.mark.skipif(os.name != "posix", reason="modes of folders are of POSIX")
def test_a_folder_that_cannot_be_written_is_told(base, monkeypatch):
    """It may have been planted by another user, so that code is compiled at each start."""
    base.write_text("not a folder")
    planted = chosen()
    assert planted.parent == base.parent / "temporary"
    can = os.access
    monkeypatch.setattr(os, "access", lambda path, mode: path != planted and can(path, mode))
    with pytest.warns(RuntimeWarning, match=f"{planted} cannot be written"):
        fresh = chosen()
    assert fresh != planted
    fresh.rmdir()


def test_a_folder_of_another_user_is_not_trusted(base, monkeypatch):
    folder = chosen()
    (folder / "numba").mkdir(0o700)
    assert cache_folder.can_be_trusted(folder)
    status = Path.lstat

    def owned_by(owners):
        def lstat(path):
            values = list(status(path))
            values[stat.ST_UID] = owners.get(path, values[stat.ST_UID])
            return os.stat_result(values)

        return lstat

    other = os.getuid() + 1
    for owner, path, answer in (
        (other, folder, False),
        (other, base, False),
        (0, base, True),
    ):
        monkeypatch.setattr(Path, "lstat", owned_by({path: owner}))
        assert cache_folder.can_be_trusted(folder) is answer, path


def test_others_may_write_above_only_where_they_cannot_rename(base):
    folder = chosen()
    base.chmod(0o1777)  # as /tmp
    assert chosen() == folder
    base.chmod(0o777)
    assert chosen() != folder
