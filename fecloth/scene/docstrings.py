"""The parts of a class's docstring: its summary, its text and what it says of each parameter."""

from __future__ import annotations

import inspect
import re

from fecloth import terms

_HEADING = re.compile(r"\n\n(\w+)\n-{4,}\n")
_PARAMETER = re.compile(r"^(\S.*)\n((?:(?: {4}.*)?(?:\n|$))+)", re.MULTILINE)


def summary(cls: type) -> str:
    """Return the first paragraph, on one line."""
    return " ".join(text(cls).split("\n\n")[0].split())


def text(cls: type) -> str:
    """Return what stands before the first section, such as Parameters."""
    return _HEADING.split(inspect.getdoc(cls) or "")[0].strip()


def parameters(cls: type) -> dict[str, str]:
    """Return what the section Parameters says of each parameter, on one line.

    Examples
    --------
    >>> from fecloth import Gravity
    >>> parameters(Gravity)
    {'acceleration': 'g, three components [m/s²].'}
    """
    parts = _HEADING.split(inspect.getdoc(cls) or "")
    sections = dict(zip(parts[1::2], parts[2::2], strict=True))
    items = _PARAMETER.findall(sections.get("Parameters", ""))
    found = {name: " ".join(words.split()) for names, words in items for name in names.split(", ")}
    return {name: _resolved(name, words) for name, words in found.items()}


def _resolved(name: str, words: str) -> str:
    """Return the meaning where a docstring refers to another term, as in "As for `Drag`."."""
    other = re.fullmatch(r"As (?:for|of) `(\w+)`\.", words)
    return parameters(getattr(terms, other[1]))[name] if other else words
