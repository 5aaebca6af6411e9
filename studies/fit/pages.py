"""The tables of the studies of this folder, as they are committed."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from fecloth.output.atomic_files import replace_file
from fecloth.study.result import Row, markdown_table, write_csv
from studies.harness import Finding

DATA = Path(__file__).parents[1] / "validation" / "data"  # measured curves


def write_page(
    out: Path,
    name: str,
    about: str | None,
    findings: Sequence[Finding],
    *tables: Sequence[Row],
    words: str = "",
    cases: Sequence[Row] = (),
) -> None:
    """Write NAME.md with what a study is `about`, its findings and its tables.

    NAME.csv has the cases, or the first table. `about` is the docstring of the study: a question,
    what is done, and the command.
    """
    question, _, rest = (about or "").strip().partition("\n")
    what, _, command = rest.strip().rpartition("\n\n")
    listed = "\n".join(f"- {each}" for each in findings)
    parts = [f"# {question}", what, f"`{command.strip()}`", listed, words]
    text = "\n\n".join([*filter(None, parts), *map(markdown_table, tables)]) + "\n"
    replace_file(out / f"{name}.md", text.encode())
    write_csv(list(cases or tables[0]), out / f"{name}.csv")
