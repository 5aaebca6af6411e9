"""The index of the search: the text of each section and of each public name, as a script.

A page that is opened from a file may load a script but no data, so the index is one.
"""

import json
from pathlib import Path

from docutils import nodes
from sphinx import addnodes
from sphinx.application import Sphinx

LEFT_OUT = ("changelog",)  # it tells what is no more
UNITS = (nodes.section, addnodes.desc)


def collect(app: Sphinx, doctree: nodes.document, docname: str) -> None:
    """Keep the sections of a page: place, titles from the page to the section, text."""
    if docname in LEFT_OUT:
        return
    found = []
    for node in doctree.findall(lambda each: isinstance(each, UNITS)):
        name = anchor(node)
        if name and (text := " ".join(own_text(node)).split()):
            found.append([app.builder.get_target_uri(docname), name, titles(node), " ".join(text)])
    app.env.sections = {**getattr(app.env, "sections", {}), docname: found}


def anchor(node: nodes.Element) -> str:
    ids = node["ids"] or (node[0]["ids"] if isinstance(node, addnodes.desc) else [])
    return ids[0] if ids else ""


def own_text(node: nodes.Node) -> list[str]:
    """Return the texts of a section without the sections in it."""
    texts = []
    for child in node.children:
        if isinstance(child, (*UNITS, nodes.comment)):
            continue
        if isinstance(child, nodes.Text):
            texts.append(child.astext())
        elif isinstance(child, nodes.TextElement):
            texts.append(child.astext() if not isinstance(child, nodes.title) else "")
        else:
            texts += own_text(child)
    return texts


def titles(node: nodes.Node) -> list[str]:
    """Return the title of the page, and of the sections down to this one."""
    found: list[str] = []
    while node is not None:
        if isinstance(node, nodes.section):
            found.insert(0, node.next_node(nodes.title).astext())
        elif isinstance(node, addnodes.desc):
            found.insert(0, node[0].get("fullname") or node[0].astext())
        node = node.parent
    return found


def leave_out_other(app: Sphinx) -> None:
    """Do not build Sphinx' own search: from a file it has no excerpts, and it ranks whole pages."""
    app.builder.search = False


def write(app: Sphinx, exception: Exception | None) -> None:
    if exception is None and app.builder.format == "html":
        rows = [row for name in sorted(app.env.sections) for row in app.env.sections[name]]
        text = json.dumps(rows, ensure_ascii=False, separators=(",", ":"))
        Path(app.outdir, "_static", "sections.js").write_text(
            f"const SECTIONS = {text};\n", "utf-8"
        )


def setup(app: Sphinx) -> dict[str, bool]:
    app.connect("builder-inited", leave_out_other)
    app.connect("doctree-resolved", collect)
    app.connect("build-finished", write)
    return {"parallel_read_safe": True, "parallel_write_safe": False}
