"""Report of a study: results.csv and report.md with settings, machine, figures and findings."""

import argparse
import csv
import math
import os
import platform
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from fecloth.errors import FAILED, MISSED
from fecloth.output.atomic_files import replace_file, writing
from fecloth.runs.environment import versions
from fecloth.study.cases import describe_settings
from fecloth.study.command import StudyFailed
from fecloth.study.status import OK

LONGEST_CELL = 300  # characters
NAMED = 10  # failed cases that are named first
Row = Mapping[str, object]


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


def write_csv(rows: Sequence[Row], path: str | Path) -> None:
    """Write all rows, with the union of their columns; omit columns that hold lists."""
    columns = list(dict.fromkeys(key for row in rows for key in row))
    columns = [c for c in columns if not any(isinstance(row.get(c), list | dict) for row in rows)]
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    with writing(Path(path)), Path(path).open("w", newline="", encoding="utf-8") as stream:
        table = csv.DictWriter(stream, columns, extrasaction="ignore", lineterminator="\n")
        table.writeheader()
        table.writerows(rows)


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
) -> int:
    """Write OUT/results.csv and OUT/report.md; print failed cases, conclusion and findings.

    Return the exit status of the study: 3 if a case failed, 1 if a finding is missed, otherwise 0.
    If every case failed, the report names the failures and has no conclusion.

    Parameters
    ----------
    options
        Result of `parse_arguments`.
    rows
        Rows of all cases.
    tables
        Heading and rows of each table; a table of the failed rows follows them.
    figures
        File names without suffix.
    conclusion
        Text before the findings.
    settings
        Settings that all cases share; the options follow them.
    results
        Statuses of failures that are results of this study, such as "failed" where it tries
        steps that are too large.
    """
    write_csv(rows, options.out / "results.csv")
    failed = [row for row in rows if row.get("status", OK) != OK]
    if rows and len(failed) == len(rows):
        conclusion, findings, figures, tables, results = "", (), (), {}, ()
    missing = [row for row in failed if row["status"] not in results]
    first = list_failures(missing, len(rows))
    said = [conclusion, _bullet_list(findings)]
    parts = [f"# {title}", first, *said, *(f"![{name}]({name}.png)" for name in figures)]
    parts += [
        f"## {heading}\n\n{markdown_table(table)}" for heading, table in (tables or {}).items()
    ]
    if failed:
        parts.append(f"## Cases that failed\n\n{markdown_table(list(map(_shorten, failed)))}")
    shared = {**(settings or {}), **vars(options)}
    for heading, what in (("Settings", shared), ("Ran on", hardware())):
        parts.append(f"## {heading}\n\n{_bullet_list([f'{k}: {v}' for k, v in what.items()])}")
    text = "\n\n".join(part for part in parts if part) + "\n"
    replace_file(options.out / "report.md", text.encode())
    print("\n".join(part for part in (first, *said) if part))
    print(f"wrote {options.out / 'report.md'}")
    return FAILED if missing else 0 if all(finding.is_met for finding in findings) else MISSED


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


def _shorten(row: Row) -> Row:
    """Return a failed row without lists, and with only the first line of its cause."""
    cells = {key: value for key, value in row.items() if not isinstance(value, list | dict)}
    return cells | {"cause": _first_line(row.get("cause"))}


def _first_line(cause: object) -> str:
    return str(cause).splitlines()[0] if cause else ""


def markdown_table(rows: Sequence[Row]) -> str:
    """Format rows as a Markdown table, numbers to four digits."""
    columns = list(dict.fromkeys(key for row in rows for key in row))
    table = [columns, *[[_cell(row.get(column)) for column in columns] for row in rows]]
    lines = [f"| {' | '.join(cells)} |" for cells in table]
    return "\n".join([lines[0], f"|{'---|' * len(columns)}", *lines[1:]])


def _cell(value: object) -> str:
    if value is None:
        return ""
    text = f"{value:.4g}" if isinstance(value, float) else " ".join(str(value).split())
    return (text if len(text) <= LONGEST_CELL else text[:LONGEST_CELL] + " …").replace("|", "\\|")


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
