"""Files in TOML: read with limits, so that a file from elsewhere costs no more than its size."""

import re
import tomllib
from pathlib import Path
from typing import Any

from fecloth.errors import InputError
from fecloth.validation import file_problem

MOST_BYTES = 1_000_000  # of a file: a scene has some kilobytes, so a larger file is a mistake
MOST_PARTS = 10  # of a dotted key: the time of `tomllib` grows with the square of their number
_PART = r"""(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+"""
# Keys begin a line, or follow a bracket or the comma of an inline table.
_LONG_KEY = re.compile(rf"(?:^|[\[{{,])[ \t]*+(?:{_PART}\.[ \t]*+){{{MOST_PARTS}}}", re.MULTILINE)


def read(path: str | Path, kind: str = "a TOML file") -> dict[str, Any]:
    """Return the tables of a TOML file; raise `InputError` if it cannot be read.

    `kind` says in messages which file is expected.
    """
    content = text(Path(path), kind)
    try:
        return parse(content)
    except ValueError as error:
        problem = str(error)
    where = str(path)
    remedy = _remedy(problem)
    if twice := _given_twice(problem, content):
        remedy = remedy or "Leave one of them out."
        raise InputError(twice, "must stand there once", where, remedy)
    raise InputError(f"not TOML ({problem})", f"must be {kind}", where, remedy)


def text(path: Path, kind: str = "a TOML file") -> str:
    """Return the text of a TOML file; `kind` says in messages which file is expected.

    Raise `InputError` if there is no such file, if it has more than `MOST_BYTES`, and if it
    cannot be read or is not UTF-8.
    """
    where = str(path)
    if problem := file_problem(path):
        reason, remedy = problem
        raise InputError(reason, f"must be {kind}", where, remedy)
    try:
        size = path.stat().st_size
        if size > MOST_BYTES:
            raise InputError(f"has {size} bytes", f"must have at most {MOST_BYTES}", where)
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror})", where=where) from None
    try:
        return data.decode("utf-8-sig")  # editors on Windows add a byte order mark
    except UnicodeDecodeError as error:
        what = f"is not UTF-8 text (byte {error.start})"
        raise InputError(what, "must be a text in TOML", where) from None


def parse(content: str) -> dict[str, Any]:
    """Return the tables of a text in TOML.

    Raise `ValueError` if it is not TOML, is nested too deeply, or has a key of more than
    `MOST_PARTS` parts.
    """
    if match := _LONG_KEY.search(content):
        line = 1 + content.count("\n", 0, match.end())
        raise ValueError(f"a key of more than {MOST_PARTS} parts at line {line}")
    try:
        return tomllib.loads(content)
    except RecursionError:
        raise ValueError("nested too deeply") from None


def _remedy(problem: str) -> str:
    """Return what to do about the usual mistakes in TOML, or "".

    `problem` is the message of `tomllib`, whose words tell the mistake.
    """
    unclosed = ("Unterminated string", r"Illegal character '\n'", 'Expected "\'"')
    if any(words in problem for words in unclosed):
        return "A text has no closing quotation mark."
    if match := re.search(r"Cannot declare \('(terms|pins|probes)',\) twice", problem):
        return f"Write [[{match[1]}]], with two brackets, above each of them."
    if "Expected newline or end of document after a statement" in problem:
        return 'A text has quotation marks, also a number with a unit: h = "5 cm".'
    return ""


def _given_twice(problem: str, content: str) -> str:
    """Return which key or header the TOML file has twice, and in which lines; "" if none.

    `problem` is the message of `tomllib` about the file with this `content`.
    """
    if not re.match("Cannot overwrite|Cannot declare .* twice", problem):
        return ""
    lines = content.splitlines()
    match = re.search(r"at line (\d+)", problem)
    last = int(match[1]) if match else len(lines)  # "at end of document"
    heads = [line.partition("=")[0].strip() for line in lines[:last]]
    head = heads[-1]
    tables = [number for number, line in enumerate(heads, 1) if line.startswith("[")]
    # A key may stand again in another table, a header of a table may not.
    begin = 0 if head.startswith("[") else max(tables, default=0)
    earlier = [number for number, line in enumerate(heads, 1) if line == head and number > begin]
    if earlier[0] == last:
        return ""
    return f"{head} is given twice, in line {earlier[0]} and in line {last}"
