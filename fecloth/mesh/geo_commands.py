"""Which commands a .geo file may hold: geometry, names, sizes; no input, output or programs.

A .geo file is a program for Gmsh's interpreter, which can also run commands of the system and
write files. `check_geo` allows the words of a list and refuses all others. It returns the
tokens that it has read, without comments, as a new text. So Gmsh reads exactly what was
checked. (Gmsh's own rules differ: a zero byte ends a comment, and a text ends after 1023
characters.)

A command that names a file or a program needs a text. Here a text may only be a name or a
formula, also where Sprintf makes it. Printf to the terminal is left out of the new text.
"""

import difflib
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

from fecloth.errors import MeshError

# Characters of a file; a longer one would be read for minutes before anything is refused.
MOST_CHARACTERS = 20_000_000
LONGEST_TEXT = 200  # characters; names are shorter, and Gmsh cuts a text after 1023

_ALLOWED = """
Point Line Curve Circle Ellipse Spline BSpline Bezier CatmullRom Compound Loop Wire Plane
Surface Ruled Rectangle Disk Volume Boundary CombinedBoundary PointsOf Physical
BooleanUnion BooleanDifference BooleanIntersection BooleanFragments BooleanFuse BooleanCut
BooleanCommon BooleanCoherence Coherence Delete Recursive Duplicata Reverse All
Translate Rotate Dilate Symmetry Affine Extrude Layers Fillet Chamfer
In Using Progression Bump Transfinite Recombine Left Right Alternate AlternateLeft
AlternateRight Periodic MeshSize Characteristic Length MeshAlgorithm Smoother Background Field
SetFactory DefineConstant DefineNumber If ElseIf Else EndIf For EndFor
Macro Function Call Return Hide Show BoundingBox Closest
Abs Fabs Acos Asin Atan Atan2 Ceil Cos Cosh Exp Floor Fmod Hypot Log Log10 Max Min Modulo Rand
Round Sin Sinh Sqrt Step Tan Tanh Pi LinSpace LogSpace Unique List
newreg newp newl newc newll newcl news newsl newv newf
Attractor AttractorAnisoCurve Ball BoundaryLayer Box Constant Curvature Cylinder Distance Extend
Frustum Gradient Intersect IntersectAniso Laplacian LonLat MathEval MathEvalAniso
MaxEigenHessian Mean MinAniso Param Restrict Threshold
Name Label Help Units Range Choices Visible ReadOnly Closed Highlight
"""
WORDS = frozenset(_ALLOWED.split())
_AT_START = ("Macro", "Function", "Call", "Return")  # allowed as the first word of a statement
LEAST_LIKENESS = 0.8  # of a word that is suggested, from 0 to 1
_TOKEN = re.compile(
    r"""(?P<space>[ \t\r\n\f]+|//[^\n]*|/\*.*?\*/)
    |(?P<text>"[^"\n\r]*"|'[^'\n\r]*')
    |(?P<dots>\.\.\.)
    |(?P<number>\d+\.(?!\.)\d*(?:[eE][-+]?\d+)?|\.\d+(?:[eE][-+]?\d+)?|\d+(?:[eE][-+]?\d+)?)
    |(?P<word>[A-Za-z_][A-Za-z_0-9]*)
    |(?P<sign>\+\+|--|[-+*/=!<>]=|&&|\|\||[-+*/=!<>%^?:;,.(){}\[\]\#~])""",
    re.VERBOSE | re.DOTALL,
)
_CONTROL = re.compile(r"[\x00-\x08\x0b\x0e-\x1f\x7f]|\r(?!\n)")
_LOOP_WORDS = re.compile(r"\b(If|ElseIf|Else|EndIf|For|EndFor|Return)\b")
# Gmsh looks for the end of what it skips by letters: it would find these inside of a word, too.
_SKIPPED_UNTIL = re.compile(r"EndIf|EndFor|Else|Return")
_PLAIN_TEXT = re.compile(r"""["'][^"'\\]*["']""")
# Gmsh writes each number of Sprintf to 256 characters.
_FORMAT = re.compile(r"(?:[^%]|%%|%0?\d?(?:\.[0-2]?\d)?g)*")
_ASSIGNMENTS = ("=", "+=", "-=", "*=", "/=", "++", "--")
# The next two patterns are for tokens with a space between them. Here a text may stand:
_TEXT = re.compile(
    r"""\bPhysical\ (Point|Line|Curve|Surface|Volume)\ \(\ "[^"]*"$
    |\bSetFactory\ \(\ "(Built-in|OpenCASCADE)"$
    |\]\ \.\ (F[XYZ]?|M[123][123])\ =\ "[^"]*"$  # a formula of Field[1]
    |\b(Name|Label|Help|Units|Closed|Highlight)\ "[^"]*"$
    |\b(Hide|Show)\ "\*"$
    |[{,]\ [\d.]+\ =\ "[^"]*"$  # Choices{1="fine"}""",
    re.VERBOSE,
)
# This stands before a statement:
_STARTED = re.compile(r'(^|[;)}\]"\d]|\d\.|\b(Else|EndIf|EndFor|Return)|\b(Macro|Function)\ \w+)$')


class Token(NamedTuple):
    """A word, number, text or sign of a file, and its line."""

    kind: str
    text: str
    line: int


def check_geo(text: str, where: str) -> str:
    """Return the text of a .geo file without its comments, if it holds known commands only.

    Allowed are points, curves, surfaces, Boolean operations, physical groups, sizes, fields
    without files or processes, SetFactory, DefineConstant, arithmetic, If, For, macros, Printf
    to the terminal, and Sprintf in names and formulas. An endless loop is allowed, too: the
    process that reads the file has limits of time and memory.

    Raises `MeshError` for the first word, text or character that is not allowed; `where` is
    the name of the file in the message.
    """
    tokens = _without_printf(list(_read_tokens(text, where)))
    _Checker(tokens, where).check()
    # Each token stays in its line, so that the line numbers in Gmsh's messages are right.
    words_of_line: dict[int, list[str]] = {}
    for token in tokens:
        words_of_line.setdefault(token.line, []).append(token.text)
    last_line = max(words_of_line, default=0)
    lines = [" ".join(words_of_line.get(line, [])) for line in range(1, last_line + 1)]
    return "\n".join(lines) + "\n"


def _make_error(what: str, line: int, where: str, suggestion: str = "") -> MeshError:
    allowed = "is not among the commands that are allowed in a .geo file"
    trust = "If you trust the file, pass --trust-geo, or trust=True to Cloth.read."
    return MeshError(f"{what} in line {line}", allowed, where, f"{suggestion} {trust}".strip())


def _suggest(word: str) -> str:
    """Return "Did you mean ...?" with the command that is nearly the same word; else ""."""
    commands = {command.lower(): command for command in WORDS}
    close = difflib.get_close_matches(word.lower(), commands, n=1, cutoff=LEAST_LIKENESS)
    return "".join(f"Did you mean {commands[command]!r}?" for command in close)


def _read_tokens(text: str, where: str) -> Iterator[Token]:
    """Yield the tokens without spaces and comments; texts in single quotes get double quotes.

    Raises `MeshError` for a file of too many characters, for a control character, and for a
    character that begins no token.
    """
    if len(text) > MOST_CHARACTERS:
        raise MeshError(f"{len(text)} characters", f"must be at most {MOST_CHARACTERS}", where)
    if match := _CONTROL.search(text):
        line = text.count("\n", 0, match.start()) + 1
        raise _make_error(f"the control character {match[0][0]!r}", line, where)
    place = 0
    line = 1
    while place < len(text):
        match = _TOKEN.match(text, place)
        if not match:
            raise _make_error(f"the character {text[place]!r}", line, where)
        kind = str(match.lastgroup)
        word = match[0]
        if kind == "text":
            word = f'"{word[1:-1]}"'
        if kind != "space":
            yield Token(kind, word, line)
        place = match.end()
        line = line + match[0].count("\n")


def _without_printf(tokens: list[Token]) -> list[Token]:
    """Return the tokens without statements ``Printf(…);``, which write to the terminal.

    A Printf to a file, ``Printf(…) > "file";``, stays, and is refused.
    """
    kept: list[Token] = []
    i = 0
    while i < len(tokens):
        end = i
        if tokens[i].text == "Printf":
            while end < len(tokens) and tokens[end].text != ";":
                end += 1
        is_to_terminal = end > i and tokens[end - 1].text == ")" and end < len(tokens)
        if is_to_terminal and not any(token.text in (">", ">>") for token in tokens[i:end]):
            i = end + 1
        else:
            kept.append(tokens[i])
            i += 1
    return kept


@dataclass
class _Checker:
    """The check of the tokens of a file, in two passes: macros may use later variables.

    Attributes
    ----------
    tokens
        The tokens in their order.
    where
        The file, for messages.
    variables
        Names that the file defines.
    statement
        The words of the statement so far.
    """

    tokens: list[Token]
    where: str
    variables: set[str] = field(default_factory=set)
    statement: set[str] = field(default_factory=set)

    def check(self) -> None:
        """Raise `MeshError` for the first token that is not allowed."""
        for i, before in self._places():
            is_word = self.tokens[i].kind == "word" and not before.endswith(" .")
            if is_word and self._defines_variable(i, before):
                self.variables.add(self.tokens[i].text)
        for i, before in self._places():
            kind, text, _ = self.tokens[i]
            if kind == "text":
                self._check_text(text, i, before)
            elif text == ".":
                self._check_option(i, before)
            elif kind == "word" and not before.endswith(" ."):  # after a point: `_check_option`
                self._check_word(text, i, before)

    def _places(self) -> Iterator[tuple[int, str]]:
        """Yield the number of each token, and the tokens before it; keep the `statement`."""
        self.statement.clear()
        for i, (kind, text, _) in enumerate(self.tokens):
            before = self._join_tokens(i - 4, i)  # four tokens are enough for `_TEXT`
            if text == ";":
                self.statement.clear()
            yield i, before
            if kind == "word" and not before.endswith(" ."):
                self.statement.add(text)

    def _check_text(self, text: str, i: int, before: str) -> None:
        """Raise `MeshError` for a text at i that is too long, or stands at a wrong place.

        Also raise it for a text that Gmsh might read otherwise: with a quotation mark, a
        backslash or a word of `_LOOP_WORDS`. The text of a Sprintf must stand where a text may,
        and have numbers as %g only.
        """
        is_allowed = len(text) <= LONGEST_TEXT and not _LOOP_WORDS.search(text)
        if before.endswith("Sprintf ("):
            before = self._join_tokens(i - 6, i - 2)
            is_allowed = is_allowed and bool(_FORMAT.fullmatch(text))
        if not (is_allowed and _PLAIN_TEXT.fullmatch(text) and _TEXT.search(f"{before} {text}")):
            raise self._error(f"the text {text[:40]}", i)

    def _join_tokens(self, begin: int, end: int) -> str:
        return " ".join(token.text for token in self.tokens[max(begin, 0) : end])

    def _error(self, what: str, i: int, suggestion: str = "") -> MeshError:
        return _make_error(what, self.tokens[i].line, self.where, suggestion)

    def _check_option(self, i: int, before: str) -> None:
        """Check the names around a point at i, as in Mesh.Algorithm or Field[1].SizeMin.

        Allowed are options of Mesh and Geometry, but not the number of threads, and of fields.
        """
        group = before.rpartition(" ")[2]
        name = self._join_tokens(i + 1, i + 2)
        is_field = group == "]" and "Field" in self.statement
        if not is_field and (group not in ("Mesh", "Geometry") or "Threads" in name):
            raise self._error(f"{group}.{name}", i)

    def _check_word(self, word: str, i: int, before: str) -> None:
        """Raise `MeshError` unless the word at i is a command or a variable that has a value.

        `before` are the tokens before i.
        """
        after = self._join_tokens(i + 1, i + 2)
        is_kind = "Field" in self.statement and before.endswith("] =")  # Field[1] = Box
        is_start = bool(_STARTED.search(before))
        if word not in WORDS and _SKIPPED_UNTIL.search(word):
            raise self._error(word, i)
        if word in _AT_START and not is_start:
            raise self._error(word, i)
        if word in WORDS or (word in ("Mesh", "Geometry") and after == "."):
            pass  # a command or an option
        elif word == "Mesh" and is_start and after in ("1", "2"):
            pass  # the statement Mesh 1; or Mesh 2;
        elif word == "Sprintf" and self._join_tokens(i + 1, i + 3).startswith('( "'):
            pass  # `_check_text` checks its place
        elif self._defines_variable(i, before):
            pass
        elif is_start or is_kind or word not in self.variables:
            raise self._error(word, i, _suggest(word))

    def _defines_variable(self, i: int, before: str) -> bool:
        """Return whether the word at i, after the tokens `before`, gets a value there."""
        if _STARTED.search(before):
            return self._is_assigned(i)
        after = self._join_tokens(i + 1, i + 2)
        # For i In {1:4}, Macro Hole, DefineConstant[i = 1]
        is_counted = f" {before}".endswith(" For") and after == "In"
        is_macro = f" {before}".endswith((" Macro", " Function"))
        return is_counted or is_macro or ("DefineConstant" in self.statement and after in "=,][()~")

    def _is_assigned(self, i: int) -> bool:
        """Return whether x = …, x[1] += … or x~{1} = … stands at i."""
        depth = 0
        for j in range(i + 1, len(self.tokens)):
            text = self.tokens[j].text
            depth += (text in "([{") - (text in ")]}")
            if text == ";" or (depth == 0 and text not in ")]}~"):
                return text in _ASSIGNMENTS
        return False
