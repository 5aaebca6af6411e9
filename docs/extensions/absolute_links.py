"""Write README.md with links that the package index can follow, too: `python FILE`.

The address stands in pyproject.toml alone, as `Repository`.
"""

import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[2]
LINK = re.compile(r"(!?)(\[(?:[^][]|\[[^]]*\])*\])\((?!\w+:)([^()\s#]+)(#[^()\s]*)?\)")


def absolute(text: str, repository: str) -> str:
    """Return a page of the repository's top level with absolute links."""

    def rewritten(match: re.Match[str]) -> str:
        image, words, name, anchor = match.groups(default="")
        words = LINK.sub(rewritten, words)
        raw = "?raw=true" if image else ""  # the picture itself, not a page about it
        return f"{image}{words}({repository}/{name}{raw}{anchor})"

    return LINK.sub(rewritten, text)


def main() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    readme = ROOT / "README.md"
    text = absolute(readme.read_text(encoding="utf-8"), project["urls"]["Repository"])
    readme.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
