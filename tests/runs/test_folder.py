"""The folder of a run: its tables, summary and log, what is refused, what a full disk leaves."""

from __future__ import annotations

import contextlib
import csv
import json
import signal
from pathlib import Path

import numpy as np
import pytest

import fecloth as fc
from fecloth.errors import InputError
from fecloth.output.frames import Frames
from fecloth.runs.folder import RunFolder, Table


def fill(folder, system, state):
    Frames(folder.path / "run", system.cloth, system).add(state)
    for name in ("steps.csv", "energies.csv", "observed.csv"):
        with contextlib.closing(folder.table(name)) as table:
            table.add({"t": 0.0})
    folder.summary({"steps": 1})
    folder.text("scene.resolved.toml", "dt = 0.01\n")
    folder.log("done")


def test_overwrite_leaves_foreign_files_alone(small, isotropic, tmp_path):
    system = fc.System(small, isotropic, [fc.StVK()])
    fill(RunFolder.create(tmp_path / "run"), system, system.rest())
    foreign = {"mine.pvd", "mine.vtu", "steps.csv.bak", "frames/mine.vtu", "other.vtu.series"}
    for name in foreign:
        (tmp_path / "run" / name).write_text("mine")
    again = RunFolder.create(tmp_path / "run", overwrite=True)
    left = {p.relative_to(again.path).as_posix() for p in again.path.rglob("*") if p.is_file()}
    assert left == foreign
    (again.path / "frames" / "mine.vtu").unlink()
    fill(again, system, system.rest())
    RunFolder.create(again.path, overwrite=True)
    assert not (again.path / "frames").exists()


def test_interrupted_overwrite_can_be_overwritten(small, isotropic, tmp_path, monkeypatch):
    system = fc.System(small, isotropic, [fc.StVK()])
    unlink = Path.unlink

    def killed(path):
        if not left:
            raise KeyboardInterrupt
        left.pop()
        unlink(path)

    fill(RunFolder.create(tmp_path / "run"), system, system.rest())
    while any((tmp_path / "run").iterdir()):  # by one file at a time
        left = [None]
        with monkeypatch.context() as patched, contextlib.suppress(KeyboardInterrupt):
            patched.setattr(Path, "unlink", killed)
            RunFolder.create(tmp_path / "run", overwrite=True)


def test_rows_keep_their_numbers_and_keys(tmp_path):
    row = {"t": np.float64(0.1) + 0.2, "n": np.int64(3), "reaction:top, left.x": float("nan")}
    with contextlib.closing(Table(tmp_path / "steps.csv")) as table:
        table.add(row)
        with pytest.raises(InputError, match=r"steps\.csv: keys extra"):
            table.add(row | {"extra": 1})
        table.add(dict(reversed(row.items())))
    with (tmp_path / "steps.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [list(map(float, r.values())) for r in rows] == [
        pytest.approx(list(row.values()), nan_ok=True, rel=0, abs=0)
    ] * 2


def test_summary_is_strict_json(tmp_path):
    folder = RunFolder.create(tmp_path / "run")
    folder.summary({"old": 1})
    values = {"n": np.int64(3), "residual": np.nan, "x": np.ones(2), "ok": True, "at": tmp_path}
    folder.summary(values | {"seconds": {"solve": np.float64(0.5)}, "peak": None})

    def refuse(constant):
        raise AssertionError(constant)

    assert json.loads((folder.path / "summary.json").read_text(), parse_constant=refuse) == {
        "n": 3,
        "residual": None,
        "x": [1.0, 1.0],
        "ok": True,
        "at": str(tmp_path),
        "seconds": {"solve": 0.5},
        "peak": None,
    }


def test_a_table_that_is_cut_to_nothing_has_a_header_again(tmp_path):
    # as steps.csv of a run that was killed before its first restart file, and goes on
    row = {"step": 1, "t": 0.5}
    Table(tmp_path / "a.csv").add(row)
    again = Table(tmp_path / "a.csv")
    again.cut(0)
    again.add(row)
    assert again.column("t") == [0.5]


def test_row_that_does_not_fit_on_the_disk_is_removed(tmp_path):
    resource = pytest.importorskip("resource")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    before = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    table = Table(tmp_path / "t.csv")
    table.add({"t": 0.0})
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (10, limits[1]))
        with pytest.raises(InputError, match="File too large"):
            table.add({"t": 123456.789})
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        signal.signal(signal.SIGXFSZ, before)
    assert table.path.read_text() == "t\n0.0\n"
    table.add({"t": 1.0})
    table.close()
    assert table.path.read_text() == "t\n0.0\n1.0\n"
