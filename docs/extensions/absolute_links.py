"""Give README.md and the pages of the wheel links that lead somewhere: `python FILE`.

The package index shows README.md alone, and a wheel has the files below fecloth/ alone. Links to
other files lead to the address in pyproject.toml, `Repository`.
"""

import os
import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[2]
LINK = re.compile(r"(!?)(\[(?:[^][]|\[[^]]*\])*\])\((?!\w+:)([^()\s#]+)(#[^()\s]*)?\)")


def absolute(text: str, repository: str, page: str = "README.md") -> str:
    """Return the text of a page of the repository with absolute links to what is not beside it."""

    def rewritten(match: re.Match[str]) -> str:
        image, words, name, anchor = match.groups(default="")
        words = LINK.sub(rewritten, words)
        target = os.path.normpath(Path(page).parent / name).replace(os.sep, "/")
        is_beside = page.startswith("fecloth/") and target.startswith("fecloth/")
        if is_beside or not (ROOT / target).exists():  # the latter in a formula
            return f"{image}{words}({name}{anchor})"
        raw = "?raw=true" if image else ""  # the picture itself, not a page about it
        return f"{image}{words}({repository}/{target}{raw}{anchor})"

    return LINK.sub(rewritten, text)


def main() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    for file in [ROOT / "README.md", *ROOT.glob("fecloth/**/*.md")]:
        page = file.relative_to(ROOT).as_posix()
        text = absolute(file.read_text(encoding="utf-8"), project["urls"]["Repository"], page)
        file.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
