"""The pages of the lecture taken apart: their cells, words and lines of code."""

import ast
import io
import re
import tokenize
from collections.abc import Sequence
from pathlib import Path

ANSWER = re.compile(r"<details><summary>Answer</summary>\n\n(.*?)\n\n</details>", re.DOTALL)
MARK = re.compile(r"^# %%(?: \[(markdown)\])?\n", re.MULTILINE)


def cells(path: Path) -> list[tuple[str, str]]:
    """("markdown" or "code", text) of each cell."""
    _, *parts = MARK.split(path.read_text(encoding="utf-8"))
    pairs = zip(parts[::2], parts[1::2], strict=True)
    return [
        (kind or "code", re.sub(r"^# ?", "", text, flags=re.MULTILINE) if kind else text)
        for kind, text in pairs
    ]


def markdown(path: Path) -> str:
    """The text of the page: its cells of Markdown, without the folded answer."""
    text = "\n".join(text for kind, text in cells(path) if kind == "markdown")
    return ANSWER.sub("", text)


def answer(path: Path) -> str:
    """The folded answer to the question that closes the page; "" if there is none."""
    result = ANSWER.findall("\n".join(text for kind, text in cells(path) if kind == "markdown"))
    return "".join(result)


def code_lines(code: Sequence[str]) -> int:
    """Lines of code in the cells without figure and check; imports and comments do not count."""
    lines = 0
    for text in code:
        tree = ast.parse(text)
        is_check = any(isinstance(node, ast.Assert) for node in ast.walk(tree))
        if not is_check and "plt." not in text:
            lines += len(_lines_with_code(text, tree))
    return lines


def _lines_with_code(text: str, tree: ast.Module) -> set[int]:
    lines: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.string.strip() and token.type != tokenize.COMMENT:
            lines |= set(range(token.start[0], token.end[0] + 1))
    for node in tree.body:
        if isinstance(node, ast.Import | ast.ImportFrom):
            lines -= set(range(node.lineno, node.end_lineno + 1))
    return lines
