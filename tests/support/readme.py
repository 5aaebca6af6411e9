"""The README taken apart: its sections, fenced blocks, commands and code spans, for test_readme."""

import re
import shlex
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "README.md").read_text(encoding="utf-8")
FENCE = re.compile(r"^```(\w*)[^\n]*\n(.*?)^```[ \t]*$", re.MULTILINE | re.DOTALL)
SHELLS = ("sh", "bash", "console")
# how a line begins that a reader types, and a code span with a command for the shell
TYPED = re.compile(r"(\$ |\w+=\S+ )?(\.venv/bin/)?(fecloth|python3?|pip|pytest) \S")


@dataclass(frozen=True)
class Block:
    """A fenced block; `file` is the name that the lines before it give it, or ""."""

    language: str
    text: str
    file: str


@dataclass(frozen=True)
class Section:
    """What stands under one `##` heading, or before the first."""

    title: str
    text: str

    @cached_property
    def blocks(self) -> list[Block]:
        found = []
        for fence in FENCE.finditer(self.text):
            above = self.text[: fence.start()].rstrip().rsplit("\n\n", 1)[-1]
            named = re.findall(r"`([\w.-]+\.(?:toml|py|geo))`", above)
            file = named[-1] if named and above.endswith(":") else ""
            found.append(Block(fence[1], fence[2], file))
        return found

    @property
    def prose(self) -> str:
        """The text without fenced and indented blocks."""
        text = FENCE.sub("", self.text)
        return "\n".join(line for line in text.splitlines() if not line.startswith("    "))

    @property
    def spans(self) -> list[str]:
        """Inline code, each on one line."""
        return [" ".join(s.split()) for s in re.findall(r"(?<!`)`([^`]+)`(?!`)", self.prose)]

    @property
    def lines(self) -> list[str]:
        """Lines to type: indented ones that begin as such, those of a shell's blocks, spans."""
        indented = re.findall(r"^ {4}(\S.*)$", FENCE.sub("", self.text), re.MULTILINE)
        lines = [line for line in _joined(indented) if TYPED.match(line)]
        for block in self.blocks:
            if block.language in SHELLS:
                given = _joined(block.text.splitlines())
                prompt = "$ " if block.language == "console" else ""
                lines += [s for s in given if s.startswith(prompt) and s.strip() and s[0] != "#"]
        return lines + [span for span in self.spans if TYPED.match(span)]

    @property
    def commands(self) -> list[str]:
        """The commands of `lines`, one by one, without what is said about them."""
        said = (re.split(r"\s{2,}|\s#\s", line.removeprefix("$ "))[0] for line in self.lines)
        return [command.strip() for line in said for command in line.split(" && ")]


def _joined(lines: list[str]) -> list[str]:
    return "\n".join(lines).replace("\\\n", " ").splitlines()


def sections() -> list[Section]:
    """The README's, in order."""
    outside = FENCE.sub(lambda fence: re.sub(r"[^\n]", "x", fence[0]), TEXT)
    starts = [0, *(found.start() for found in re.finditer(r"^## ", outside, re.MULTILINE))]
    parts = [TEXT[a:b] for a, b in zip(starts, [*starts[1:], len(TEXT)], strict=True)]
    return [Section(part.splitlines()[0].lstrip("# "), part) for part in parts]


SECTIONS = sections()
SPANS = [span for section in SECTIONS for span in section.spans]
LINES = [line for section in SECTIONS for line in section.lines]
COMMANDS = list(dict.fromkeys(command for section in SECTIONS for command in section.commands))
ANCHORS = {
    re.sub(r"[^\w -]", "", title.lower()).strip().replace(" ", "-")
    for title in re.findall(r"^#+ (.*)$", FENCE.sub("", TEXT), re.MULTILINE)
}


def words(command: str) -> list[str]:
    """A command's words; what [brackets] say may be left out is kept."""
    return shlex.split(re.sub(r"\[(-[^]]*|[A-Z][\w.]*)\]", r"\1", command).replace(" ...", ""))
