"""The command's process: its exit status around signals and pipes, and any encoding of its text."""

import io
import os
import shlex
import signal
import subprocess
import sys
import time

import pytest
from rich.markup import escape
from support.tiers import in_turn

from fecloth.cli.main import main
from fecloth.cli.progress import show, terminal
from fecloth.runs.interruption import Interrupted

SCENE = """
cloth = { shape = "rectangle", width = 1.0, height = 0.5, h = 0.1, pattern = "right" }
terms = [{ type = "StVK" }, { type = "HingeBending" }, { type = "Gravity" }]
pins = [{ where = "left" }]
time = { method = "backward_euler", dt = 0.005, t_end = 0.1 }
output = { restart_steps = 5 }
[fabric]
areal_density = 0.2
tensile_stiffness = 1000.0
bending_rigidity = 1e-5
"""
FECLOTH = (sys.executable, "-m", "fecloth")
COMMANDS = [
    "info sheet.toml",
    "info",
    "info --fabrics",
    "info --terms",
    "info --terms Wind",
    "info --schema",
    "mesh sheet.toml",
    "run sheet.toml --overwrite",
    "check sheet.toml --set 'expect.sag={value=0.01,relative=90}'",
    "run sheet.toml --overwrite --set cloth.widht=1",
]


@pytest.fixture
def scene(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "sheet.toml").write_text(SCENE)


def shell(line: str, **environment: str) -> subprocess.CompletedProcess:
    """Run a line of Bash in which FECLOTH stands for the command."""
    line = "set -o pipefail; " + line.replace("FECLOTH", " ".join(FECLOTH))
    options = {"capture_output": True, "env": os.environ | environment}
    return subprocess.run(["bash", "-c", line], **options)


# --- pipes and full disks -------------------------------------------------------------------------


@pytest.mark.stories
def test_where_the_text_goes_does_not_decide_about_a_run(scene, tmp_path):
    """It writes to both streams, of which each may be lost."""
    result = shell("FECLOTH run sheet.toml > /dev/full 2>&1")
    assert result.returncode == 0, result.stderr
    assert (tmp_path / "out/sheet/report.html").is_file()
    assert (tmp_path / "out/sheet/summary.json").is_file()


@pytest.mark.stories
@pytest.mark.parametrize(
    ("redirection", "status"),
    [("2>&1 | head -1", 0), ("2> /dev/full", 0), ("> /dev/full", 3), (">&- 2>&-", 0)],
)
def test_lost_text_is_a_failure_only_where_a_disk_is_full(scene, redirection, status):
    result = shell(f"FECLOTH info --fabrics {redirection}")
    assert result.returncode == status, result.stderr
    assert b"Traceback" not in result.stderr


# --- encodings ------------------------------------------------------------------------------------


@pytest.mark.parametrize(("command", "encoding"), in_turn(COMMANDS, ["ascii", "cp1252", "utf-16"]))
def test_any_encoding_of_the_output(scene, monkeypatch, command, encoding):
    streams = {"stdout": "strict", "stderr": "backslashreplace"}  # as Python opens them
    for name, errors in streams.items():
        monkeypatch.setattr(sys, name, io.TextIOWrapper(io.BytesIO(), encoding, errors))
    assert main(shlex.split(command)) == (2 if "widht" in command else 0)


@pytest.mark.stories
def test_the_c_locale(scene):
    result = shell("FECLOTH run sheet.toml", LC_ALL="C", PYTHONUTF8="0", PYTHONCOERCECLOCALE="0")
    assert result.returncode == 0, result.stderr
    assert b"Traceback" not in result.stderr


# --- markup ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["[/red]x", "[start]", "[bold]", ":smile:", "\\[red]", "[link=x]"])
def test_the_terminal_prints_text_as_it_is(capsys, monkeypatch, name):
    assert escape(name) != name or ":" in name or "\\" in name
    for is_terminal in (False, True):
        monkeypatch.setattr(sys.stderr, "isatty", lambda is_terminal=is_terminal: is_terminal)
        console = terminal()
        assert (console is not None) == is_terminal
        show(f"warning: the region {name} is heavy", console)
        assert capsys.readouterr().err == f"warning: the region {name} is heavy\n"


# --- signals --------------------------------------------------------------------------------------

SIGNALS = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP]


def stopped(number: int, seconds: float, *command: str) -> tuple[int, str]:
    """Exit status and errors of a command that gets a signal after some seconds."""
    process = subprocess.Popen([*FECLOTH, *command], stderr=subprocess.PIPE, text=True)
    time.sleep(seconds)
    process.send_signal(number)
    errors = process.communicate()[1]
    return process.returncode, errors


@pytest.mark.stories
def test_a_signal_at_any_moment_is_status_4_or_comes_after_the_end(scene, tmp_path):
    """From the imports to the end of the process; a status of 0 means that all is written."""
    begin = time.monotonic()
    subprocess.run([*FECLOTH, "run", "sheet.toml", "--quiet"], check=True)
    whole, seen = time.monotonic() - begin, []
    for number, share in zip([*SIGNALS[:2], *SIGNALS[:2]], (9, 35, 61, 97), strict=True):
        run = "run", "sheet.toml", "--quiet", "-o", f"out/{share}"
        status, errors = stopped(number, max(0.15, whole * share / 100), *run)
        assert status in (0, 4), errors
        assert "Traceback" not in errors
        done = (tmp_path / "out" / str(share) / "summary.json").is_file()
        assert done or status == 4
        seen.append(status)
    assert 4 in seen


def test_a_signal_while_a_class_is_made_stops_the_command(monkeypatch, run_command):
    def fails(arguments):  # as Python 3.11 does
        raise RuntimeError("Error calling __set_name__") from Interrupted()

    monkeypatch.setattr("fecloth.cli.main._run_command", fails)
    assert "interrupted; run it again" in run_command("info", "none.toml", status=4).err
