"""A file NAME.ipynb beside each page of the site that is a notebook, and a link to it."""

from pathlib import Path

import jupytext
from sphinx.application import Sphinx


def add_link(app: Sphinx, name: str, template: str, context: dict, doctree: object) -> None:
    """Add the link to the end of such a page."""
    if name in app.env.all_docs and app.env.doc2path(name).suffix == ".py":
        file = f"{Path(name).name}.ipynb"
        context["body"] += f'<p><a href="{file}" download>This page as a Jupyter notebook</a></p>'


def write(app: Sphinx, exception: Exception | None) -> None:
    if exception is None and app.builder.format == "html":
        for name in app.env.all_docs:
            if (page := Path(app.env.doc2path(name))).suffix == ".py":
                target = Path(app.outdir, f"{name}.ipynb")
                jupytext.write(jupytext.read(page, fmt="py:percent"), target)


def setup(app: Sphinx) -> dict[str, bool]:
    app.connect("html-page-context", add_link)
    app.connect("build-finished", write)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
