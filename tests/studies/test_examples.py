"""The three examples of what a user may write: short, and as the page of terms shows them."""

import ast
import io
import re
import tokenize

import pytest
from support.examples import FILES, FOLDER


def code_lines(text):
    """Lines with code: no blank ones, comments or docstrings."""
    tree, lines = ast.parse(text), set()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.string.strip() and token.type != tokenize.COMMENT:
            lines |= set(range(token.start[0], token.end[0] + 1))
    for node in ast.walk(tree):
        documented = isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef)
        if documented and ast.get_docstring(node) is not None:
            lines -= set(range(node.body[0].lineno, node.body[0].end_lineno + 1))
    return len(lines)


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_each_is_under_forty_lines(path):
    assert 10 < code_lines(path.read_text(encoding="utf-8")) < 40


def test_the_page_of_terms_shows_the_law_as_it_is():
    page = FOLDER.parents[1] / "fecloth" / "terms" / "README.md"
    law = next(path for path in FILES if "law" in path.stem).read_text(encoding="utf-8")
    (block,) = re.findall(r"^```python\n(.*?)^```", page.read_text(), re.MULTILINE | re.DOTALL)
    assert block in law
