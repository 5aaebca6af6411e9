"""What the studies of this folder share: options, exit statuses, findings, reports, figures."""

import argparse
import math
import os
import platform
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import chdir, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from fecloth.errors import FAILED, MISSED, STOPPED, FeclothError, InputError
from fecloth.output.atomic_files import ending_of, replace_file
from fecloth.runs.environment import versions
from fecloth.study.cases import describe_settings
from fecloth.study.command import StudyFailed, require_packages
from fecloth.study.figures import (
    COLOURS,
    STYLE,
    line_style,
    mark_failures,
    new_figure,
    use_plain_ticks,
)
from fecloth.study.result import Row, markdown_table, write_csv
from fecloth.study.status import OK

NAMED = 10  # failed cases that are named first
LISTED = 12  # findings of a page that are listed, not counted


class Parser(argparse.ArgumentParser):
    """A parser of options that raises `InputError` for an invalid one."""

    def error(self, message: str) -> NoReturn:
        raise InputError(message, remedy="--help lists the options.")


def run_main(main: Callable[[], int | None]) -> NoReturn:
    """Call the main function of a study and exit: one line for a mistake instead of a traceback.

    The exit status is 0 if all is as expected, 1 if a finding lies outside its range, 2 for a
    mistake in the input, 3 if a case failed or the disk is full, 4 after Ctrl-C.
    """
    sys.exit(exit_status(main))


def exit_status(main: Callable[[], int | None]) -> int:
    """Call `main`; print its mistake or failure as one line and return the exit status."""
    try:
        return main() or 0
    except (FeclothError, OSError, MemoryError) as error:
        status, line = ending_of(error)
        print(line, file=sys.stderr)
        return status
    except KeyboardInterrupt:
        print("interrupted; run it again to go on: finished cases are stored", file=sys.stderr)
        return STOPPED


def parse_arguments(
    description: str, argv: list[str] | None = None, needs: Sequence[str] = (), **more: dict
) -> argparse.Namespace:
    """Parse --out, --quick, --jobs, --scheduler, --fresh, --write.

    Raises `InputError` for an invalid option, or a package that is not installed.

    Parameters
    ----------
    description
        The study's docstring; --help shows its first line.
    needs
        Packages without which the study cannot end, such as "pyvista".
    more
        Further options of the study: name, and keywords of `add_argument`.
    """
    options = _make_parser(description, more).parse_args(argv)
    if options.jobs < 1:
        raise InputError(f"--jobs {options.jobs}", "must be at least 1")
    options.out = options.out or _default_folder()
    require_packages(*needs, *(["distributed"] if options.scheduler else []))
    return options


def _make_parser(description: str, more: dict[str, dict]) -> Parser:
    parser = Parser(description=description.strip().splitlines()[0])
    add = parser.add_argument
    add("--out", type=Path, metavar="DIR", help="folder of the results (out/STUDY)")
    add("--quick", action="store_true", help="few and small cases, below a minute of CPU time")
    add("--jobs", type=int, default=1, metavar="N", help="processes, one thread each")
    add("--scheduler", metavar="ADDRESS", help="Dask scheduler that runs the cases")
    add("--fresh", action="store_true", help="run every case again")
    add("--write", action="store_true", help="write the page beside the study anew")
    for option, keywords in more.items():
        add(f"--{option.replace('_', '-')}", **keywords)
    return parser


def _default_folder() -> Path:
    """Return out/STUDY."""
    script = Path(sys.argv[0])
    return Path("out") / (script.parent.name if script.stem == "__main__" else script.stem)


def run_options(options: argparse.Namespace, alone: bool = False) -> dict[str, Any]:
    """Return the options that `run_cases` takes.

    With `alone` the cases run one after another in this process, whatever --jobs and --scheduler
    are, so that their seconds can be compared.
    """
    chosen = {name: getattr(options, name) for name in ("out", "jobs", "scheduler", "fresh")}
    return chosen | {"jobs": 1, "scheduler": None} if alone else chosen


@dataclass(frozen=True)
class Finding:
    """A number of the conclusion and its expected range."""

    what: str
    value: float
    low: float = -math.inf
    high: float = math.inf

    @property
    def is_met(self) -> bool:
        """True if the value lies in the range."""
        return self.low <= self.value <= self.high

    def __str__(self) -> str:
        if math.isinf(self.low) and math.isinf(self.high):
            return f"{self.what}: {self.value:.4g}"
        expected = f"in [{self.low:g}, {self.high:g}]"
        if math.isinf(self.high):
            expected = f">= {self.low:g}"
        if math.isinf(self.low):
            expected = f"<= {self.high:g}"
        return f"{self.what}: {self.value:.4g} {expected}: {'met' if self.is_met else 'MISSED'}"


def write_report(
    options: argparse.Namespace,
    title: str,
    rows: Sequence[Row],
    *,
    tables: Mapping[str, Sequence[Row]] | None = None,
    figures: Sequence[str] = (),
    findings: Sequence[Finding] = (),
    conclusion: str = "",
    settings: Mapping[str, object] | None = None,
    results: Sequence[str] = (),
    page: Path | None = None,
) -> int:
    """Write OUT/results.csv and OUT/report.md; print failed cases, conclusion and findings.

    Return the exit status of the study: 3 if a case failed, 1 if a finding is missed, otherwise 0.
    If every case failed, the report names the failures and has no conclusion.

    Parameters
    ----------
    options
        Result of `parse_arguments`. With --write the report, the rows and the figures become the
        `page`.
    rows
        Rows of all cases. They stand in the CSV file only.
    tables
        Heading and rows of each table: a summary of the rows that fits on a screen.
    figures
        File names without suffix.
    conclusion
        Text before the findings.
    settings
        Settings that all cases share.
    results
        Statuses of failures that are results of this study, such as "failed" where it tries
        steps that are too large.
    page
        The page beside the study, without suffix: its table is the .csv file of the same name.
    """
    write_csv(rows, options.out / "results.csv")
    failed = [row for row in rows if row.get("status", OK) != OK]
    if rows and len(failed) == len(rows):
        conclusion, findings, figures, tables, results = "", (), (), {}, ()
    missing = [row for row in failed if row["status"] not in results]
    first = list_failures(missing, len(rows))
    listed = _bullet_list(findings)
    shown = [f"![{name}]({name}.png)" for name in figures]
    shown += [
        f"## {heading}\n\n{markdown_table(table)}" for heading, table in (tables or {}).items()
    ]
    if settings:
        shown.append(f"Settings: {_list_values(settings)}.")

    def text(name: str, listed: str, ran: str) -> bytes:
        made = f"`{_command_line()}`, each case in `{name}.csv`."
        parts = [f"# {title}", first, made, conclusion, listed, *shown, ran]
        return ("\n\n".join(part for part in parts if part) + "\n").encode()

    machine = hardware()
    ran = f"Ran on: {_list_values(machine)}."
    replace_file(options.out / "report.md", text("results", listed, ran))
    if page and options.write:
        few = _bullet_list(_summarise(findings))
        ran = f"Commit {machine['commit']}."
        replace_file(page.with_suffix(".md"), text(page.name, few, ran))
        write_csv(rows, page.with_suffix(".csv"))
        for name in figures:
            shutil.copy(options.out / f"{name}.png", page.parent)
    print("\n".join(part for part in (first, conclusion, listed) if part))
    print(f"wrote {options.out / 'report.md'}")
    return FAILED if missing else 0 if all(finding.is_met for finding in findings) else MISSED


def conclude(
    options: argparse.Namespace,
    docstring: str | None,
    page: Path,
    rows: Sequence[Row],
    findings: Sequence[Finding],
    tables: Mapping[str, Sequence[Row]] | None = None,
) -> int:
    """Write the report of a study whose docstring is its title and its conclusion.

    `page` is the page beside the study, without suffix; the rest is as for `write_report`.
    """
    title, what = about(docstring)
    return write_report(
        options, title, rows, conclusion=what, findings=findings, tables=tables, page=page
    )


def _summarise(findings: Sequence[Finding]) -> list[object]:
    """Return a few findings as they are; of many the missed ones, and how many are met."""
    if len(findings) <= LISTED:
        return list(findings)
    missed = [finding for finding in findings if not finding.is_met]
    return [*missed, f"{len(findings) - len(missed)} of {len(findings)} findings are met"]


def about(docstring: str | None) -> tuple[str, str]:
    """Return the question of a study, and what it does: its docstring up to the command."""
    question, _, what = (docstring or "").partition("\n    python")[0].strip().partition("\n\n")
    return question, what.strip()


def count_by(rows: Sequence[Row], column: str, verdicts: str) -> list[dict[str, object]]:
    """Return a table: a row for each value of `column`, how often it has each of the `verdicts`."""
    counts = Counter((row[column], row[verdicts]) for row in rows)
    names = sorted({verdict for _, verdict in counts})
    values = dict.fromkeys(row[column] for row in rows)
    return [
        {column: value, **{name: counts[value, name] or "" for name in names}} for value in values
    ]


def _command_line() -> str:
    """Return the command that runs this study, with its options."""
    spec = sys.modules["__main__"].__spec__
    program = ["-m", spec.name.removesuffix(".__main__")] if spec else sys.argv[:1]
    options = [option for option in sys.argv[1:] if option != "--write"]
    return shlex.join(["python", *program, *options])


def _list_values(named: Mapping[str, object]) -> str:
    return ", ".join(f"{name} {value}" for name, value in named.items())


def require_results(options: argparse.Namespace, title: str, rows: Sequence[Row]) -> None:
    """Raise `StudyFailed` if every case failed; write a report that names the failures.

    Call it before the first number is computed from the rows.
    """
    if rows and all(row["status"] != OK for row in rows):
        write_report(options, title, rows)
        raise StudyFailed(f"{title}: all {len(rows)} cases failed")


def list_failures(failed: Sequence[Row], count: int) -> str:
    """Return a line that counts failed cases, and one for each of the first few."""
    if not failed:
        return ""
    lines = []
    for row in failed[:NAMED]:
        named = {key: v for key, v in row.items() if key not in ("status", "cause")}
        cause = _first_line(row.get("cause"))
        lines.append(f"{describe_settings(named)}: {row['status']}{': ' * bool(cause)}{cause}")
    if len(failed) > NAMED:
        lines.append(f"and {len(failed) - NAMED} more")
    return f"{len(failed)} of {count} cases failed:\n\n{_bullet_list(lines)}"


def _bullet_list(items: Sequence[object]) -> str:
    return "\n".join(f"- {item}" for item in items)


def _first_line(cause: object) -> str:
    return str(cause).splitlines()[0] if cause else ""


@contextmanager
def temporary_folder() -> Iterator[None]:
    """Work in a new folder, which is removed at the end; also a decorator of functions.

    For engines that write into the current folder: MuJoCo appends its warnings to MUJOCO_LOG.TXT.
    Paths that are used inside must be absolute.
    """
    with tempfile.TemporaryDirectory() as folder, chdir(folder):
        yield


def hardware() -> dict[str, object]:
    """Return the processor, its cores, the memory, the versions and the commit."""
    machine = {"processor": _processor(), "cores": os.cpu_count(), "memory": _memory()}
    return {**machine, **versions(), "commit": _commit()}


def _processor() -> str:
    info = Path("/proc/cpuinfo")
    if info.exists():
        for line in info.read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    return platform.processor() or platform.machine()


def _memory() -> str:
    try:
        return f"{os.sysconf('SC_PAGE_SIZE') * os.sysconf('SC_PHYS_PAGES') / 2**30:.1f} GiB"
    except (AttributeError, ValueError, OSError):
        return "unknown"


def _commit() -> str:
    """Return the commit of the sources, with + if they have changed since."""
    command = ["git", "-C", str(Path(__file__).parent), "describe", "--always", "--dirty=+"]
    try:
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return "unknown"


@contextmanager
def figure(
    out: str | Path,
    name: str,
    xlabel: str = "",
    ylabel: str = "",
    title: str = "",
    log: bool = True,
    panels: tuple[int, int] = (1, 1),
    size: tuple[float, float] | None = None,
    **subplots: Any,
) -> Iterator[tuple]:
    """Yield a figure and its axes; write OUT/NAME.png and .svg at the end of the block.

    Parameters
    ----------
    xlabel, ylabel, title
        Of every panel, with the unit: "time step [s]".
    log
        Whether both axes are logarithmic.
    panels
        Numbers of rows and columns; with more than one panel the axes are an array.
    size
        Width and height [inch], by default 8 × 5 for one panel.
    """
    size = size or (8.0, 5.0 if panels[0] == 1 else 3.6 * panels[0])
    drawing, axes = new_figure(*panels, size, **subplots)
    from matplotlib import rc_context

    with rc_context(fname=STYLE):
        for ax in np.ravel(axes):
            ax.set(xlabel=xlabel, ylabel=ylabel, title=title)
            if log:
                ax.set(xscale="log", yscale="log")
        yield drawing, axes
        for ax in np.ravel(axes):
            use_plain_ticks(ax)
        Path(out).mkdir(parents=True, exist_ok=True)
        for kind in ("png", "svg"):
            drawing.savefig(Path(out) / f"{name}.{kind}")


def draw_lines(
    ax,
    rows: Sequence[Mapping],
    x: str,
    y: str,
    by: str,
    legend: bool = True,
    names: Sequence = (),
) -> None:
    """Draw a line for each value of the column `by`, and a cross for each row that failed.

    Parameters
    ----------
    x, y
        Columns of the axes.
    names
        All values of the column `by`, in the order of their colours, if several panels share
        the colours.
    """
    names = names or list(dict.fromkeys(row[by] for row in rows))
    for i, name in enumerate(names):
        group = [row for row in rows if row[by] == name]
        points = sorted((row[x], row[y]) for row in group if row["status"] == "ok")
        ax.plot(
            *zip(*points, strict=True) if points else ((), ()), label=str(name), **line_style(i)
        )
        mark_failures(ax, group, x, COLOURS[i % len(COLOURS)])
    if legend:
        ax.legend()


def draw_slope_triangle(
    ax, order: float, at: tuple[float, float] = (0.75, 0.12), width: float = 0.15
) -> None:
    """Draw a right triangle with the slope `order` on logarithmic axes, and label it.

    Call this last, when the limits of the axes are final: it does not change them.

    Parameters
    ----------
    at
        Lower right corner, as fractions of the axes.
    width
        Length of the base as a fraction of the axes; shorter if the triangle would be too high.
    """
    (x0, x1), (y0, y1) = np.log10(ax.get_xlim()), np.log10(ax.get_ylim())
    right, bottom = x0 + at[0] * (x1 - x0), y0 + at[1] * (y1 - y0)
    base = min(width * (x1 - x0), 0.25 * (y1 - y0) / abs(order))
    left, top = right - base, bottom + order * base
    corners = 10.0 ** np.array([(left, bottom), (right, bottom), (right, top)])
    limits = ax.get_xlim(), ax.get_ylim()
    ax.fill(*corners.T, facecolor="0.93", edgecolor="0.35", lw=1)
    middle = 10 ** (0.5 * (bottom + top))
    ax.annotate(
        f"{order:g}", (corners[1, 0], middle), (4, 0), textcoords="offset points", va="center"
    )
    ax.set(xlim=limits[0], ylim=limits[1])


@dataclass(frozen=True)
class Seconds:
    """Duration of a call."""

    wall: float  # wall-clock time of the fastest call [s]
    cpu: float  # its processor time [s]
    value: object = None  # result of the last call


def measure_seconds(function: Callable[[], object], repeats: int = 3) -> Seconds:
    """Call a function once to warm up, then `repeats` times, and return the shortest times."""
    function()
    calls = []
    for _ in range(repeats):
        wall, cpu = time.perf_counter(), time.process_time()
        value = function()
        calls.append((time.perf_counter() - wall, time.process_time() - cpu))
    return Seconds(*map(min, zip(*calls, strict=True)), value)
