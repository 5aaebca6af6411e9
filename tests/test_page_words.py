"""The pages are short enough to be read, and each says at its beginning what it is for."""

import re
import subprocess

import pytest
from support.lecture import markdown
from support.pages import GENERATED, NAMES, ROOT

LIMIT = 35_000
LIMIT_OF_ALL = 60_000  # words of all Markdown, with tables and what is generated
# the changelog; and the paper, which is no page of the documentation and whose length
# tests/test_wheel.py checks
NOT_COUNTED = ("CHANGELOG.md", ".github/paper/paper.md")
BY_HAND = [
    *(name for name in NAMES if "CHANGELOG" not in name),
    *(f"fecloth/{name}/README.md" for name in ("distributed", "terms/bending", "terms/contact")),
    "studies/validation/data/README.md",
]


def tracked(*patterns: str) -> list[str]:
    """Names of the files in the repository that match a pattern."""
    command = ["git", "ls-files", *patterns]
    listed = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    return listed.split()


def pages() -> list[str]:
    """Names of all pages in the repository that are counted, also in `docs` and the lecture."""
    listed = tracked("*.md", "*.rst", "studies/lecture/[0-9]*.py")
    return [name for name in listed if name not in NOT_COUNTED]


def words(name: str) -> int:
    """Words of a page without its generated part; of a report without tables and findings."""
    if name.endswith(".py"):
        return len(markdown(ROOT / name).split())
    text = GENERATED.sub("", (ROOT / name).read_text(encoding="utf-8"))
    lines = text.splitlines()
    if name not in BY_HAND:
        lines = [line for line in lines if not line.startswith(("|", "- ", "**"))]
    return len(" ".join(lines).split())


def test_all_pages_have_at_most_so_many_words():
    counts = {name: words(name) for name in pages()}
    assert set(BY_HAND) <= counts.keys()
    assert sum(counts.values()) <= LIMIT, dict(sorted(counts.items(), key=lambda item: -item[1]))


def test_all_markdown_together_has_at_most_so_many_words():
    counts = {
        name: len((ROOT / name).read_text(encoding="utf-8").split()) for name in tracked("*.md")
    }
    assert sum(counts.values()) <= LIMIT_OF_ALL, sorted(counts.items(), key=lambda item: -item[1])


def test_the_readme_begins_with_what_fecloth_does():
    _, beginning = (ROOT / "README.md").read_text(encoding="utf-8").split("\n\n")[:2]
    assert beginning.startswith("fecloth computes ")


@pytest.mark.parametrize(
    "name",
    [*(n for n in BY_HAND if n != "README.md"), *(n for n in pages() if n.endswith(".rst"))],
)
def test_a_page_begins_with_what_it_is_for(name):
    """In a first sentence that can be read in one breath."""
    title, beginning = (ROOT / name).read_text(encoding="utf-8").split("\n\n")[:2]
    assert re.match(r"# |.*\n=+$", title)
    first = re.split(r"(?<=[.:])\s", " ".join(beginning.split()))[0]
    assert 4 <= len(first.split()) <= 40, first
    assert "this page" not in first.lower()
