"""Pages and charts from the templates of page/, filled in by Jinja, which escapes every text."""

from collections.abc import Mapping
from functools import cache
from typing import Any


@cache
def _environment() -> Any:
    from jinja2 import Environment, PackageLoader, StrictUndefined  # 50 ms, for pages alone

    loader = PackageLoader("fecloth.view", "page")
    return Environment(loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True)


def render(template: str, values: Mapping[str, object]) -> str:
    """Return a template with its values; texts are escaped, and what `render` returns is not."""
    from markupsafe import Markup

    return Markup(_environment().get_template(template).render(values))


def unescaped(text: str) -> str:
    """Return a text that templates insert as it is: style, script or numbers of a page."""
    from markupsafe import Markup

    return Markup(text)
