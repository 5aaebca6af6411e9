"""Which commands a .geo file may hold: geometry, names, sizes; no input, output or programs.

A .geo file is a program for Gmsh's interpreter, which can also run commands of the system and
write files. `check_geo` allows the words of a list and refuses all others. It returns the
tokens that it has read, without comments, as a new text. So Gmsh reads exactly what was
checked. (Gmsh's own rules differ: a zero byte ends a comment, and a text ends after 1023
characters.)

A command that names a file or a program needs a text. Here a text may only be a name or a
formula, and no allowed word makes a text from anything else.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

from fecloth.errors import MeshError, did_you_mean

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
Abs Fabs Acos Asin Atan Atan2 Ceil Cos Cosh Exp Floor Fmod Hypot Log Log10 Max Min Modulo Rand
Round Sin Sinh Sqrt Step Tan Tanh Pi LinSpace LogSpace Unique List
newreg newp newl newc newll newcl news newsl newv newf
Attractor AttractorAnisoCurve Ball BoundaryLayer Box Constant Curvature Cylinder Distance Extend
Frustum Gradient Intersect IntersectAniso Laplacian LonLat MathEval MathEvalAniso
MaxEigenHessian Mean MinAniso Param Restrict Threshold
Name Label Help Units Range Choices Visible ReadOnly Closed Highlight
"""
WORDS = frozenset(_ALLOWED.split())
_TOKEN = re.compile(
    r"""(?P<space>[ \t\r\n\f]+|//[^\n]*|/\*.*?\*/)
    |(?P<text>"[^"'\\\n\r]*"|'[^"'\\\n\r]*')
    |(?P<number>\d+\.\d*(?:[eE][-+]?\d+)?|\.\d+(?:[eE][-+]?\d+)?|\d+(?:[eE][-+]?\d+)?)
    |(?P<word>[A-Za-z_][A-Za-z_0-9]*)
    |(?P<sign>\+\+|--|[-+*/=!<>]=|&&|\|\||[-+*/=!<>%^?:;,.(){}\[\]\#~])""",
    re.VERBOSE | re.DOTALL,
)
_CONTROL = re.compile(r"[\x00-\x08\x0b\x0e-\x1f\x7f]|\r(?!\n)")
_LOOP_WORDS = re.compile(r"\b(If|ElseIf|Else|EndIf|For|EndFor|Return)\b")
_ASSIGNMENTS = ("=", "+=", "-=", "*=", "/=", "++", "--")
# The next two patterns are for tokens with a space between them. Here a text may stand:
_TEXT = re.compile(
    r"""\bPhysical\ (Point|Line|Curve|Surface|Volume)\ \(\ "[^"]*"$
    |\bSetFactory\ \(\ "(Built-in|OpenCASCADE)"$
    |\]\ \.\ (F[XYZ]?|M[123][123])\ =\ "[^"]*"$  # a formula of Field[1]
    |\b(Name|Label|Help|Units|Closed|Highlight)\ "[^"]*"$
    |[{,]\ [\d.]+\ =\ "[^"]*"$  # Choices{1="fine"}""",
    re.VERBOSE,
)
# This stands before a statement:
_STARTED = re.compile(r'(^|[;)}\]"\d]|\d\.|\b(Else|EndIf|EndFor))$')


class Token(NamedTuple):
    """A word, number, text or sign of a file, and its line."""

    kind: str
    text: str
    line: int


def check_geo(text: str, where: str) -> str:
    """Return the text of a .geo file without its comments, if it holds known commands only.

    Allowed are points, curves, surfaces, Boolean operations, physical groups, sizes, fields
    without files or processes, SetFactory, DefineConstant, arithmetic, If, and For. An endless
    loop is allowed, too: the process that reads the file has limits of time and memory.

    Raises `MeshError` for the first word, text or character that is not allowed; `where` is
    the name of the file in the message.
    """
    tokens = list(_read_tokens(text, where))
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


def _read_tokens(text: str, where: str) -> Iterator[Token]:
    """Yield the tokens without spaces and comments; texts in single quotes get double quotes.

    Raises `MeshError` for a file of too many characters, for a control character, for a
    character that begins no token, and for a text that is too long or contains a word of
    `_LOOP_WORDS`.
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
            if len(word) > LONGEST_TEXT or _LOOP_WORDS.search(word):
                raise _make_error(f"the text {word[:40]}", line, where)
            word = f'"{word[1:-1]}"'
        if kind != "space":
            yield Token(kind, word, line)
        place = match.end()
        line = line + match[0].count("\n")


@dataclass
class _Checker:
    """One pass over the tokens of a file.

    Attributes
    ----------
    tokens
        The tokens in their order.
    where
        The file, for messages.
    variables
        Names that the file has defined so far.
    statement
        The words of the statement so far.
    """

    tokens: list[Token]
    where: str
    variables: set[str] = field(default_factory=set)
    statement: set[str] = field(default_factory=set)

    def check(self) -> None:
        """Raise `MeshError` for the first token that is not allowed.

        Also keep the variables that the file defines, and the words of the statement.
        """
        for i, (kind, text, _) in enumerate(self.tokens):
            before = self._join_tokens(i - 4, i)  # four tokens are enough for `_TEXT`
            if text == ";":
                self.statement.clear()
            elif kind == "text" and not _TEXT.search(f"{before} {text}"):
                raise self._error(f"the text {text}", i)
            elif text == ".":
                self._check_option(i, before)
            elif kind == "word" and not before.endswith(" ."):  # after a point: `_check_option`
                self._check_word(text, i, before)
                self.statement.add(text)

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

        A word that gets its value here is kept as a variable. `before` are the tokens before i.
        """
        after = self._join_tokens(i + 1, i + 2)
        is_kind = "Field" in self.statement and before.endswith("] =")  # Field[1] = Box
        is_start = bool(_STARTED.search(before))
        if is_start:
            defines_variable = self._is_assigned(i)
        else:
            defines_variable = self._is_defined(before, after)
        if word in WORDS or (word in ("Mesh", "Geometry") and after == "."):
            pass  # a command or an option
        elif word == "Mesh" and is_start and after in ("1", "2"):
            pass  # the statement Mesh 1; or Mesh 2;
        elif defines_variable:
            self.variables.add(word)
        elif is_start or is_kind or word not in self.variables:
            raise self._error(word, i, did_you_mean(word, WORDS))

    def _is_defined(self, before: str, after: str) -> bool:
        """Return whether a word is a variable of For i In {1:4} or DefineConstant[i = 1]."""
        is_counted = f" {before}".endswith(" For") and after == "In"
        return is_counted or ("DefineConstant" in self.statement and after in "=,][()~")

    def _is_assigned(self, i: int) -> bool:
        """Return whether x = …, x[1] += … or x~{1} = … stands at i."""
        depth = 0
        for j in range(i + 1, len(self.tokens)):
            text = self.tokens[j].text
            depth += (text in "([{") - (text in ")]}")
            if text == ";" or (depth == 0 and text not in ")]}~"):
                return text in _ASSIGNMENTS
        return False
