"""Pages of the repository as chapters of the site.

A file of `docs` that includes a page, as in

    ```{include} ../fecloth/scene/README.md
    ```

is that page. A link in a page to one that is a chapter leads to the chapter, a link to any other
file of the repository leads to `repository` in conf.py; pictures are read from where they stand.
"""

import os
import re
from collections.abc import Callable
from pathlib import Path

from sphinx.application import Sphinx

INCLUDE = re.compile(r"^```\{include\} (\S+)\n```$", re.MULTILINE)
LINK = re.compile(r"(!?)\[((?:[^][]|\[[^]]*\])*)\]\(([^()\s:#]+)(#[^()\s]*)?\)")
FENCED = re.compile(r"^(```.*?^```[ \t]*$)", re.MULTILINE | re.DOTALL)


def chapters(folder: Path) -> dict[Path, Path]:
    """Return, for each page of the repository that is in the site, the file of its chapter."""
    found = {file.resolve(): file for file in folder.glob("lecture/[0-9]*.py")}
    for file in sorted(folder.glob("*.md")):
        found[file.resolve()] = file
        for name in INCLUDE.findall(file.read_text(encoding="utf-8")):
            found[(file.parent / name).resolve()] = file
    return found


def read_chapter(app: Sphinx, docname: str, source: list[str]) -> None:
    """Put the text of the page in the place of its `include`, with links of the site."""
    stub = Path(app.env.doc2path(docname))
    if stub.suffix != ".md":
        return
    page, text = stub, source[0]
    if match := INCLUDE.search(text):
        page = (stub.parent / match[1]).resolve()
        app.env.note_dependency(str(page))
        text = INCLUDE.sub(lambda _: page.read_text(encoding="utf-8"), text)
    link = link_of(page, stub, chapters(Path(app.srcdir)), app.config.repository)
    parts = FENCED.split(text)
    source[0] = "".join(p if p.startswith("```") else LINK.sub(link, p) for p in parts)


def link_of(
    page: Path, stub: Path, known: dict[Path, Path], repository: str
) -> Callable[[re.Match[str]], str]:
    """Return the function that rewrites a link of a page for the chapter in the file `stub`."""
    root = Path(__file__).parents[2]

    def rewritten(match: re.Match[str]) -> str:
        image, words, name, anchor = match.groups(default="")
        target = (page.parent / name).resolve()
        words = LINK.sub(rewritten, words)
        if chapter := known.get(target):
            if chapter.suffix == ".py":  # by its name: MyST would follow the link of its folder
                return f"{{doc}}`{words} </{chapter.parent.name}/{chapter.stem}>`"
            to = os.path.relpath(chapter, stub.parent)
        elif not target.exists():  # no link, as in a formula
            return match[0]
        elif image:
            to = os.path.relpath(target, stub.parent)
        else:
            to = f"{repository}/{target.relative_to(root).as_posix()}"
        return f"{image}[{words}]({to}{anchor})"

    return rewritten


def setup(app: Sphinx) -> dict[str, bool]:
    app.add_config_value("repository", "", "env", (str,))
    app.connect("source-read", read_chapter)
    return {"parallel_read_safe": True}
