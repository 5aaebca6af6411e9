"""Changes in place: all of a block or none, wherever the process is killed and the disk full."""

import errno
import os
import random
import signal

import pytest

from fecloth.errors import InputError
from fecloth.output.write_ahead_log import changing, recover, replace_whole


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "it"
    path.write_bytes(bytes(range(200)))
    return path


def write(file, *pieces):
    with changing(file) as stream:
        for place, data in pieces:
            stream.seek(place)
            stream.write(data)


def test_it_reads_and_writes_as_a_file_does(file):
    rng, wanted = random.Random(5), bytearray(file.read_bytes())
    with changing(file) as stream:
        for _ in range(300):
            at, count = rng.randrange(260), rng.randrange(1, 40)
            if rng.random() < 0.5:
                new = rng.randbytes(count)
                if at > len(wanted):
                    continue  # a gap
                stream.seek(at)
                assert stream.write(new) == count
                wanted[at : at + count] = new
            else:
                stream.seek(at - len(wanted), os.SEEK_END)
                assert stream.read(count) == wanted[at : at + count]
        assert file.read_bytes() == bytes(range(200))
    assert file.read_bytes() == wanted
    with changing(file) as stream:
        stream.truncate(50)
    assert file.read_bytes() == wanted[:50]
    assert [f.name for f in file.parent.iterdir()] == ["it"]


def test_error_in_the_block_leaves_the_file_unchanged(file):
    with pytest.raises(TypeError):
        write(file, (0, b"xyz"), (3, None))
    assert file.read_bytes() == bytes(range(200))
    assert [f.name for f in file.parent.iterdir()] == ["it"]


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork here")
@pytest.mark.parametrize("whole", [True, False])
def test_changes_of_a_killed_process_are_complete_or_absent(file, whole, monkeypatch):
    monkeypatch.setattr("fecloth.output.write_ahead_log._make", lambda *_: os._exit(1))
    if not (child := os.fork()):
        try:
            write(file, (198, b"abcdef"))
        finally:
            os._exit(2)  # it must not go on as a second pytest
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 1
    monkeypatch.undo()
    left = file.with_name("it.redo")
    if not whole:  # as a power cut leaves it, before the first change
        left.write_bytes(left.read_bytes()[:-1])
        file.write_bytes(bytes(range(200)))
    with file.open("r+b") as stream:  # as far as it had come
        stream.seek(198)
        stream.write(b"ab"[: 2 * whole])
    recover(file)
    recover(file)
    assert file.read_bytes()[:198] == bytes(range(198))
    assert file.read_bytes()[198:204] == (b"abcdef" if whole else bytes([198, 199]))
    assert not left.exists()


def test_full_disk_leaves_the_file_unchanged(file):
    resource = pytest.importorskip("resource")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    before = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (250, limits[1]))
        with pytest.raises(InputError, match="redo cannot be written: File too large"):
            write(file, (0, b"in place"), (200, bytes(251)))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        signal.signal(signal.SIGXFSZ, before)
    assert file.read_bytes() == bytes(range(200))
    assert [f.name for f in file.parent.iterdir()] == ["it"]


def test_changes_to_a_file_are_not_made_to_the_next_of_its_name(file, monkeypatch):
    with monkeypatch.context() as patched:
        patched.setattr("fecloth.output.write_ahead_log._make", lambda *_: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            write(file, (0, b"old"))
    assert file.with_name("it.redo").exists()
    replace_whole(file, b"another file")
    write(file, (8, b"FILE"))
    assert file.read_bytes() == b"another FILE"


@pytest.mark.skipif(not hasattr(os, "posix_fallocate"), reason="no room can be reserved here")
def test_file_is_written_on_a_drive_that_cannot_reserve_space(file, monkeypatch):
    def refuses(*_):
        raise OSError(errno.EOPNOTSUPP, "Operation not supported")

    monkeypatch.setattr(os, "posix_fallocate", refuses)
    write(file, (200, b"more"))
    assert file.read_bytes() == bytes(range(200)) + b"more"


@pytest.mark.skipif(not hasattr(os, "posix_fallocate"), reason="no room can be reserved here")
def test_space_is_reserved_before_the_first_change(file, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "posix_fallocate", full)
    with pytest.raises(InputError, match="Free space"):
        write(file, (0, b"in place"), (200, b"more"))
    assert file.read_bytes() == bytes(range(200))
    assert [f.name for f in file.parent.iterdir()] == ["it"]
