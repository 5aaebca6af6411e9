"""The fields of the dataclasses whose docstring has no list of them, from their comments.

Results such as `Ledger` say in a comment what a field is, with shape and unit:

    times: np.ndarray  # (s + 1,) the start, and the ends of the steps that have rows [s]
"""

import ast
import dataclasses
import inspect
import re
import textwrap

from sphinx.application import Sphinx

SECTIONS = ("Parameters", "Attributes")
COMMENT = re.compile(r"#\s*(.*)")


def add_fields(app: Sphinx, what: str, name: str, value: object, options: object, lines: list):
    """Append a section "Attributes", which numpydoc shows as a list."""
    if not (inspect.isclass(value) and dataclasses.is_dataclass(value)):
        return
    if set(SECTIONS).isdisjoint(lines) and (told := fields(value)):
        lines += ["", "Attributes", "----------"]
        for field, (kind, words) in told.items():
            lines += [f"{field} : {kind}", f"    {words}"]
        lines.append("")


def fields(value: type) -> dict[str, tuple[str, str]]:
    """Return type and comment of each public field, of the base classes too."""
    names = {field.name for field in dataclasses.fields(value) if field.name[0] != "_"}
    found = {}
    for each in reversed([c for c in value.__mro__ if dataclasses.is_dataclass(c)]):
        text = textwrap.dedent(inspect.getsource(each))
        lines = text.splitlines()
        for node in ast.parse(text).body[0].body:
            if isinstance(node, ast.AnnAssign) and node.target.id in names:
                found[node.target.id] = ast.unparse(node.annotation), comment(lines, node)
    return found


def comment(lines: list[str], node: ast.AnnAssign) -> str:
    """Return the comment behind a field, or else the lines of comment above it."""
    behind = COMMENT.search(lines[node.end_lineno - 1][node.end_col_offset :])
    if behind:
        return behind[1]
    above = []
    for line in reversed(lines[: node.lineno - 1]):
        if not line.strip().startswith("#"):
            break
        above.insert(0, COMMENT.search(line)[1])
    return " ".join(above)


def setup(app: Sphinx) -> dict[str, bool]:
    app.connect("autodoc-process-docstring", add_fields, priority=300)  # before `as_written`
    return {"parallel_read_safe": True}
