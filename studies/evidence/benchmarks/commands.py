"""CPU seconds of whole commands, over another commit's: `fecloth run` of ten scenes.

    python -m studies.evidence.benchmarks.commands [--against COMMIT] [--scenes NAME …] [--short]

COMMIT may also be a folder that holds `fecloth/`. Both trees run the same scene files, with frames
and all accounts, each run in a process of its own on one thread. Its seconds are user and system
time of the process, with imports and everything that it writes. The trees take turns; the first
run of each is not counted, as it may compile, and the fastest of the others counts.

"Apart" is the largest distance between the positions of both trees in the last frame, over the
extent of the cloth; the error in time that the run states stands beside it. "Ledger" is the part
of the energy that the balance misses, over the largest change of an energy in the run.
"""

from __future__ import annotations

import csv
import json
import math
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fecloth.output.frame_reader import read_vtu
from fecloth.scene.toml_text import read, to_toml
from fecloth.study.command import StudyFailed
from fecloth.study.result import markdown_table
from studies import harness
from studies.evidence.benchmarks.measure import SCENES
from studies.evidence.benchmarks.trees import ONE_THREAD, OWN, tree_of

PAGE = Path(__file__).with_suffix(".md")
MOST_ITERATIONS = 1.02  # of Newton, over the other tree's
# A sheet of 1 m × 1 m that is held at two corners and falls. Twelve steps: longer runs fold, and
# then small differences grow.
SHEET = """
[cloth]
shape = "rectangle"
pattern = "right"
width = 1.0
height = 1.0
h = {h}

[fabric]
areal_density = 0.2
tensile_stiffness = 1000.0
poisson_ratio = 0.3
bending_rigidity = 1e-4

[[terms]]
type = "StVK"

[[terms]]
type = "PlateBending"

[[terms]]
type = "StrainRateDamping"
time = 0.01

[[terms]]
type = "Gravity"

[[pins]]
inside = "Y > 0.999 and (X < 0.001 or X > 0.999)"

[time]
method = "bdf2"
dt = 0.005
t_end = 0.06

[output]
every = 0.03
"""


@dataclass(frozen=True)
class Scene:
    """A scene file, what is set on the command line, and the ratio of seconds that is asked.

    Attributes
    ----------
    short
        What is set in addition by ``--short``.
    """

    file: Path
    asked: float
    settings: tuple[str, ...] = ()
    short: tuple[str, ...] = ()


@dataclass(frozen=True)
class Run:
    """A finished command: its CPU seconds, and what stands in its folder.

    Attributes
    ----------
    summary
        The content of summary.json.
    missed
        The remainder of the energy balance over the largest change of an energy; NaN without any.
    x
        (n, 3) positions in the last frame [m].
    """

    seconds: float
    summary: dict
    missed: float
    x: np.ndarray


def write_scenes(folder: Path) -> dict[str, Scene]:
    """Return the scenes by name. What is no file of studies/scenes is written into the folder."""
    for name, cells in ("8k", 63), ("32k", 126):
        (folder / f"{name}.toml").write_text(SHEET.format(h=1 / cells))
    explicit = "time.method=central_difference", "time.dt=auto", "time.t_end=0.2"
    return {
        "flag": Scene(SCENES / "flag.toml", 0.33, short=("time.t_end=0.24",)),
        "napkin": Scene(write_napkin(folder), 0.5, short=("time.t_end=0.3",)),
        "new_cloth": Scene(write_new_cloth(folder), 0.5),
        "swing": Scene(SCENES / "swing.toml", 0.5),
        "hanging_strip": Scene(SCENES / "hanging_strip.toml", 0.5),
        "trampoline": Scene(SCENES / "trampoline.toml", 0.5, ("time.t_end=0.1",)),
        "trampoline_explicit": Scene(SCENES / "trampoline.toml", 0.45, explicit),
        "drape_equilibrium": Scene(write_static_drape(folder), 0.6),
        "8k": Scene(folder / "8k.toml", 0.35),
        "32k": Scene(folder / "32k.toml", 0.5, short=("time.t_end=0.02",)),
    }


def write_napkin(folder: Path) -> Path:
    """Write the scene that stands in docs/first_steps.md, and return its file."""
    text = (OWN / "docs" / "first_steps.md").read_text(encoding="utf-8")
    (scene,) = re.findall(r"This is `napkin\.toml`.*?```toml\n(.*?)```", text, re.DOTALL)
    file = folder / "napkin.toml"
    file.write_text(scene, encoding="utf-8")
    return file


def write_new_cloth(folder: Path) -> Path:
    """Write the scene of `fecloth new cloth`, and return its file."""
    command = [sys.executable, "-m", "fecloth", "new", "cloth", "--overwrite"]
    environment = os.environ | {"PYTHONPATH": str(OWN)}
    subprocess.run(command, cwd=folder, env=environment, check=True, stdout=subprocess.DEVNULL)
    return folder / "cloth.toml"


def write_static_drape(folder: Path) -> Path:
    """Write the scene of the drape with [equilibrium] in place of [time], and return its file."""
    tables = read(SCENES / "drape.toml")
    for name in "time", "output", "expect":
        del tables[name]
    tables["cloth"]["path"] = str((SCENES / tables["cloth"]["path"]).resolve())
    file = folder / "static_drape.toml"
    file.write_text(to_toml(tables | {"equilibrium": {"load_steps": 1}}), encoding="utf-8")
    return file


def run_command(tree: Path, scene: Scene, short: bool, folder: Path) -> Run:
    """Run the scene with the fecloth of the tree, and return what it took and wrote.

    Raises `StudyFailed` with the last line of the output if the command fails.
    """
    settings = scene.settings + (scene.short if short else ())
    options = [part for setting in settings for part in ("--set", setting)]
    command = [sys.executable, "-m", "fecloth", "run", str(scene.file), "-o", str(folder), *options]
    environment = os.environ | ONE_THREAD | {"PYTHONPATH": str(tree)}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)  # else each run compiles all sources
    shutil.rmtree(folder, ignore_errors=True)
    with tempfile.TemporaryFile("w+") as log:
        process = subprocess.Popen(command, cwd=tree, env=environment, stdout=log, stderr=log)
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode:
            log.seek(0)
            last = (log.read().strip() or "no output").splitlines()[-1]
            raise StudyFailed(f"{scene.file.name} with {tree}: {last}")
    return read_run(folder, usage.ru_utime + usage.ru_stime)


def read_run(folder: Path, seconds: float) -> Run:
    """Return the run whose files are in the folder."""
    summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    with (folder / "energies.csv").open(newline="", encoding="utf-8") as file:
        energies = list(csv.DictReader(file))
    frame = max((folder / "frames").glob("frame_*.vtu"))
    return Run(seconds, summary, missed_energy(energies), np.array(read_vtu(frame).points))


def missed_energy(energies: Sequence[dict[str, str]]) -> float:
    """Return the remainder at the end over the largest change of an energy since the start."""
    first, last = energies[0], energies[-1]
    if "remainder" not in last:
        return math.nan
    kinds = [name for name in last if name not in ("t", "total", "remainder")]
    changes = [abs(float(last[name]) - float(first[name])) for name in kinds]
    return abs(float(last["remainder"])) / max(changes)


def compare(trees: tuple[Path, Path], scene: Scene, repeats: int, short: bool) -> tuple[Run, Run]:
    """Return the fastest run of each tree, of the other one and of this one."""
    best: list[Run | None] = [None, None]
    with tempfile.TemporaryDirectory() as scratch:
        for turn in range(repeats + 1):
            for i in (0, 1) if turn % 2 else (1, 0):
                run = run_command(trees[i], scene, short, Path(scratch) / "run")
                is_warm_up = turn == 0
                if not is_warm_up and (best[i] is None or run.seconds < best[i].seconds):
                    best[i] = run
    before, now = best
    return before, now


def row_of(name: str, asked: float, before: Run, now: Run) -> dict[str, object]:
    """Return a row of the table."""
    extent = np.ptp(before.x, axis=0).max()
    return {
        "scene": name,
        "before [s]": before.seconds,
        "now [s]": now.seconds,
        "ratio": now.seconds / before.seconds,
        "asked": asked,
        "Newton": f"{before.summary['newton']} → {now.summary['newton']}",
        "more iterations": now.summary["newton"] / max(before.summary["newton"], 1),
        "apart": float(np.linalg.norm(now.x - before.x, axis=1).max() / extent),
        "error in time": now.summary.get("time_error"),
        "ledger": f"{before.missed:.1e} → {now.missed:.1e}",
    }


def findings_of(rows: Sequence[dict]) -> list[harness.Finding]:
    """Return the ratios of seconds and of Newton iterations that are required."""
    return [
        *(harness.Finding(row["scene"], row["ratio"], high=row["asked"]) for row in rows),
        harness.Finding(
            "Newton iterations over the other tree's, the worst scene",
            max(row["more iterations"] for row in rows),
            high=MOST_ITERATIONS,
        ),
    ]


def page_of(against: str, repeats: int, rows: Sequence[dict], load: tuple[float, float]) -> str:
    """Return the page: what was measured, the table, the findings and the machine.

    `load` is the number of programs that wanted to run, before and after.
    """
    machine = ", ".join(f"{name} {value}" for name, value in harness.hardware().items())
    shown = [{key: row[key] for key in row if key != "more iterations"} for row in rows]
    parts = (
        f"# CPU seconds of whole commands, over those of commit {against}",
        f"`python -m studies.evidence.benchmarks.commands --against {against} --write`",
        "\n\n".join(__doc__.split("\n\n")[2:]).strip(),
        f"The fastest of {repeats} runs each.",
        markdown_table(shown),
        "\n".join(f"- {finding}" for finding in findings_of(rows)),
        f"Ran on: {machine}. Programs that wanted to run: {load[0]:.1f} at the start, "
        f"{load[1]:.1f} at the end; more than processors make seconds longer and less alike.",
    )
    return "\n\n".join(parts) + "\n"


def main() -> int:
    parser = harness.Parser(description=__doc__.splitlines()[0])
    add = parser.add_argument
    add("--against", default=str(OWN), metavar="COMMIT", help="commit or folder (this tree)")
    add("--scenes", nargs="+", metavar="NAME", help="some of the scenes (all)")
    add("--repeats", type=int, default=3, metavar="N", help="runs that count, of each tree (3)")
    add("--short", action="store_true", help="a part of the long runs")
    add("--quick", action="store_true", help="the smallest scene once; nothing is judged")
    add("--write", action="store_true", help="write the page beside this file anew")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        scenes = write_scenes(Path(folder))
        chosen = ["hanging_strip"] if options.quick else options.scenes or list(scenes)
        unknown = [name for name in chosen if name not in scenes]
        if unknown:
            parser.error(f"--scenes {unknown[0]}: must be one of {', '.join(scenes)}")
        trees = tree_of(options.against), OWN
        repeats = 1 if options.quick else options.repeats
        load = os.getloadavg()[0]
        rows = []
        for name in chosen:
            runs = compare(trees, scenes[name], repeats, options.short)
            rows.append(row_of(name, scenes[name].asked, *runs))
            print(rows[-1], flush=True)
    findings = findings_of(rows)
    print(markdown_table(rows), *findings, sep="\n")
    if options.write:
        loads = load, os.getloadavg()[0]
        PAGE.write_text(page_of(options.against, repeats, rows, loads), encoding="utf-8")
    return 0 if options.quick or all(finding.is_met for finding in findings) else 1


if __name__ == "__main__":
    harness.run_main(main)
