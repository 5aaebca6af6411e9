"""Which commands a .geo file may hold: geometry, names, sizes; nothing that reads, writes or runs.

A .geo file is a program for Gmsh's interpreter, which can also run commands of the system and write
files. `check_geo` allows the words of a list and refuses all others. It returns the tokens that it
has read, without comments, as a new text, so that Gmsh reads exactly what was checked: for Gmsh a
zero byte ends a comment, and a text ends by itself after 1023 characters.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

from fecloth.errors import MeshError, did_you_mean

MOST_STATEMENTS = 1_000_000  # with all repetitions of loops
MOST_CHARACTERS = 20_000_000
LONGEST_TEXT = 200  # characters of a name

_TOKEN = re.compile(
    r"""(?P<space>[ \t\r\n\f]+|//[^\n]*|/\*.*?\*/)
    |(?P<text>"[^"'\\\n\r]*"|'[^"'\\\n\r]*')
    |(?P<number>\d+\.\d*(?:[eE][-+]?\d+)?|\.\d+(?:[eE][-+]?\d+)?|\d+(?:[eE][-+]?\d+)?)
    |(?P<word>[A-Za-z_][A-Za-z_0-9]*)
    |(?P<sign>\+\+|--|[-+*/=!<>]=|&&|\|\||[-+*/=!<>%^?:;,.(){}\[\]\#~])""",
    re.VERBOSE | re.DOTALL,
)
_NUMBER = re.compile(r"-?[0-9.]+(?:[eE][-+]?[0-9]+)?")
_CONTROL = re.compile(r"[\x00-\x08\x0b\x0e-\x1f\x7f]|\r(?!\n)")
_LOOP_WORDS = re.compile(r"\b(If|ElseIf|Else|EndIf|For|EndFor|Return)\b")


def _words(text: str) -> frozenset[str]:
    return frozenset(text.split())


WORDS = _words(
    """
    Point Line Curve Circle Ellipse Spline BSpline Bezier CatmullRom Compound Loop Wire Plane
    Surface Ruled Rectangle Disk Volume Boundary CombinedBoundary PointsOf Physical
    BooleanUnion BooleanDifference BooleanIntersection BooleanFragments BooleanFuse BooleanCut
    BooleanCommon BooleanCoherence Coherence Delete Recursive Duplicata Reverse All
    Translate Rotate Dilate Symmetry Affine Extrude Layers Fillet Chamfer
    In Using Progression Bump Transfinite Recombine Left Right Alternate AlternateLeft
    AlternateRight Periodic MeshSize Characteristic Length MeshAlgorithm Smoother Background Field
    BoundaryLayer SetFactory DefineConstant DefineNumber If ElseIf Else EndIf For EndFor
    Abs Fabs Acos Asin Atan Atan2 Ceil Cos Cosh Exp Floor Fmod Hypot Log Log10 Max Min Modulo Rand
    Round Sin Sinh Sqrt Step Tan Tanh Pi LinSpace LogSpace Unique List
    newreg newp newl newc newll newcl news newsl newv newf
    """
)
FIELDS = _words(
    """
    Attractor AttractorAnisoCurve Ball BoundaryLayer Box Constant Curvature Cylinder Distance Extend
    Frustum Gradient Intersect IntersectAniso Laplacian LonLat MathEval MathEvalAniso Max
    MaxEigenHessian Mean Min MinAniso Param Restrict Threshold
    """
)
_FORMULA = re.compile(r"F[XYZ]?|M[123][123]")  # the texts of MathEval, MathEvalAniso and Param
OPTIONS = {
    "Mesh": _words(
        """
        Algorithm AngleToleranceFacetOverlap CharacteristicLengthExtendFromBoundary
        CharacteristicLengthFactor CharacteristicLengthFromCurvature CharacteristicLengthFromPoints
        CharacteristicLengthMax CharacteristicLengthMin ElementOrder MeshSizeExtendFromBoundary
        MeshSizeFactor MeshSizeFromCurvature MeshSizeFromParametricPoints MeshSizeFromPoints
        MeshSizeMax MeshSizeMin MinimumCircleNodes MinimumCirclePoints MinimumCurveNodes
        MinimumCurvePoints MshFileVersion Optimize RandomFactor RandomSeed RecombineAll
        RecombinationAlgorithm SaveAll Smoothing SubdivisionAlgorithm Points Lines SurfaceEdges
        SurfaceFaces
    """
    ),
    "Geometry": _words(
        """
        AutoCoherence CopyMeshingMethod Tolerance ToleranceBoolean OldNewReg Points Lines Curves
        Surfaces PointNumbers LineNumbers CurveNumbers SurfaceNumbers ExtrudeReturnLateralEntities
    """
    ),
}
ATTRIBUTES = _words(
    "Name Label Help Units Min Max Step Range Choices Visible ReadOnly Closed Highlight"
)
_NAMED = ("Name", "Label", "Help", "Units", "Closed", "Highlight")  # attributes with a text
_FACTORIES = ("Built-in", "OpenCASCADE")
_ASSIGNMENTS = ("=", "+=", "-=", "*=", "/=", "++", "--")
_CLOSING = {"(": ")", "[": "]", "{": "}"}


class Token(NamedTuple):
    """A word, number, text or sign of a file, and its line."""

    kind: str
    text: str
    line: int


def check_geo(text: str, where: str) -> str:
    """Return a .geo file without its comments, if it holds known commands only.

    Allowed are points, curves, surfaces, Boolean operations, physical groups, sizes, fields without
    files or processes, SetFactory, DefineConstant, arithmetic, If, and For with bounds that are
    numbers.
    """
    tokens = list(_tokens(text, where))
    _Checker(tokens, where).check()
    lines: list[list[str]] = [[] for _ in range(tokens[-1].line if tokens else 0)]
    for token in tokens:
        lines[token.line - 1].append(token.text)
    return "\n".join(" ".join(words) for words in lines) + "\n"


def _refused(what: str, line: int, where: str, suggestion: str = "") -> MeshError:
    allowed = "is not among the commands that are allowed in a .geo file"
    trust = "If you trust the file, pass --trust-geo, or trust=True to Cloth.read."
    remedy = f"{suggestion} {trust}".strip()
    return MeshError(f"{what} in line {line}", allowed, where, remedy)


def _tokens(text: str, where: str) -> Iterator[Token]:
    if len(text) > MOST_CHARACTERS:
        raise MeshError(f"{len(text)} characters", f"must be at most {MOST_CHARACTERS}", where)
    if match := _CONTROL.search(text):
        line = text.count("\n", 0, match.start()) + 1
        raise _refused(f"the control character {match[0][0]!r}", line, where)
    place, line = 0, 1
    while place < len(text):
        match = _TOKEN.match(text, place)
        if not match:
            raise _refused(f"the character {text[place]!r}", line, where)
        kind, word = str(match.lastgroup), match[0]
        if kind == "text":
            if len(word) > LONGEST_TEXT or _LOOP_WORDS.search(word):
                raise _refused(f"the text {word[:40]}", line, where)
            word = f'"{word[1:-1]}"'
        if kind != "space":
            yield Token(kind, word, line)
        place, line = match.end(), line + match[0].count("\n")


@dataclass
class _Checker:
    """One pass over the tokens of a file."""

    tokens: list[Token]
    where: str
    variables: set[str] = field(default_factory=set)
    loops: list[tuple[str, int]] = field(default_factory=list)  # variable, repetitions
    allowed: set[int] = field(default_factory=set)  # places of words and texts seen in context
    starts: set[int] = field(default_factory=lambda: {0})  # places at which a statement starts
    statements: int = 0
    pairs: dict[int, int] = field(default_factory=dict)  # places of brackets, opening to closing

    def check(self) -> None:
        """Raise `MeshError` for the first token that is not allowed."""
        self._match_brackets()
        for i, token in enumerate(self.tokens):
            if token.text == ";":
                self.starts.add(i + 1)
                self._count(token)
            elif token.kind == "text" and i not in self.allowed:
                raise self._error(f"the text {token.text}", i)
            elif token.text == "." and i not in self.allowed:
                raise self._error("a point", i)
            elif token.kind == "word" and i not in self.allowed:
                self._word(i)

    def _error(self, what: str, i: int, suggestion: str = "") -> MeshError:
        return _refused(what, self.tokens[i].line, self.where, suggestion)

    def _at(self, i: int) -> str:
        return self.tokens[i].text if i < len(self.tokens) else ""

    def _allow_text(self, i: int) -> None:
        if i < len(self.tokens) and self.tokens[i].kind == "text":
            self.allowed.add(i)

    def _count(self, token: Token) -> None:
        repetitions = 1
        for _, count in self.loops:
            repetitions *= count
        self.statements += repetitions
        if self.statements > MOST_STATEMENTS:
            what = f"more than {MOST_STATEMENTS} statements, with all repetitions of For,"
            raise _refused(what, token.line, self.where)

    def _word(self, i: int) -> None:
        word = self._at(i)
        if word in OPTIONS and self._at(i + 1) == ".":
            self._option(i)
        elif handler := _HANDLERS.get(word):
            handler(self, i)
        elif word == "Mesh" and i in self.starts and self._at(i + 1) in ("1", "2"):
            pass  # Mesh 2;
        elif word in WORDS:
            if word in ("Else", "EndIf"):
                self.starts.add(i + 1)
        elif i in self.starts:
            self._assign(i)
        elif word not in self.variables:
            raise self._error(word, i, did_you_mean(word, WORDS))

    def _assign(self, i: int) -> None:
        """Check a statement that starts with a word of the file's own: it must be an assignment."""
        word, j = self._at(i), i + 1
        while self._at(j) == "~":  # name~{1} is a variable of its own
            j = self._closing(j + 1) + 1
        if self._at(j) in ("[", "("):
            j = self._closing(j) + 1
        if self._at(j) not in _ASSIGNMENTS:
            raise self._error(word, i, did_you_mean(word, WORDS))
        if word in (name for name, _ in self.loops):
            raise self._error(f"an assignment to {word}, over which For runs,", i)
        self.variables.add(word)

    def _closing(self, i: int) -> int:
        """Return the place of the bracket that closes the one at i."""
        if i not in self.pairs:
            raise self._error(f"{self._at(i)!r} without a bracket", min(i, len(self.tokens) - 1))
        return self.pairs[i]

    def _match_brackets(self) -> None:
        opened: list[int] = []
        for i, token in enumerate(self.tokens):
            if token.text in _CLOSING:
                opened.append(i)
            elif token.text in _CLOSING.values():
                if not opened or _CLOSING[self._at(opened[-1])] != token.text:
                    raise self._error(f"the bracket {token.text!r}, which closes none,", i)
                self.pairs[opened.pop()] = i
        if opened:
            raise self._error(f"the bracket {self._at(opened[-1])!r}, not closed,", opened[-1])

    def _option(self, i: int) -> None:
        """Mesh.MeshSizeMin = …"""
        group, name = self._at(i), self._at(i + 2)
        if name not in OPTIONS[group] or self._at(i + 3) != "=":
            raise self._error(f"{group}.{name}", i, did_you_mean(name, OPTIONS[group]))
        self.allowed |= {i + 1, i + 2}

    def _physical(self, i: int) -> None:
        """Physical Curve("name", 1) = …"""
        if self._at(i + 1) not in ("Point", "Line", "Curve", "Surface", "Volume"):
            raise self._error(f"Physical {self._at(i + 1)}", i)
        if self._at(i + 2) == "(":
            self._allow_text(i + 3)

    def _factory(self, i: int) -> None:
        """SetFactory("OpenCASCADE")"""
        if self._at(i + 1) != "(" or self._at(i + 2).strip('"') not in _FACTORIES:
            raise self._error(f"SetFactory({self._at(i + 2)})", i)
        self.allowed.add(i + 2)

    def _field(self, i: int) -> None:
        """Field[1] = Distance; Field[1].SizeMin = …; Background Field = 1"""
        if i and self._at(i - 1) in ("Background", "BoundaryLayer"):
            return
        if self._at(i + 1) != "[":
            raise self._error(f"Field {self._at(i + 1)}", i)
        j = self._closing(i + 1) + 1
        if self._at(j) == "=" and self._at(j + 1) in FIELDS:
            self.allowed.add(j + 1)
        elif self._at(j) == "." and self._at(j + 2) in ("=", "+=", "-="):
            self.allowed |= {j, j + 1}
            if _FORMULA.fullmatch(self._at(j + 1)):
                self._allow_text(j + 3)
        else:
            raise self._error(f"Field[…] {self._at(j)} {self._at(j + 1)}", i)

    def _constant(self, i: int) -> None:
        """DefineConstant[ h = {0.1, Min 0, Name "h"} ], DefineNumber[ 0.1, Name "h" ]"""
        if self._at(i + 1) not in ("[", "("):
            raise self._error(f"{self._at(i)} {self._at(i + 1)}", i)
        for j in range(i + 2, self._closing(i + 1)):
            token, last = self.tokens[j], self._at(j - 1)
            if token.text in ("DefineConstant", "DefineNumber"):
                raise self._error(f"{token.text} inside {self._at(i)}", j)
            if token.kind == "word" and token.text in ATTRIBUTES:
                self.allowed.add(j)
            elif token.kind == "word" and self._at(j + 1) in ("=", ",", "]", "[", "(", ")", "~"):
                if self._at(i) == "DefineConstant" and last in ("[", "(", ","):
                    self.variables.add(token.text)
            elif token.kind == "text":
                is_choice = last == "=" and self.tokens[j - 2].kind == "number"
                if last in _NAMED or is_choice:
                    self.allowed.add(j)

    def _for(self, i: int) -> None:
        """For i In {1:4}, or For (1:4:2): the bounds are numbers."""
        name, j = "", i + 1
        if self._at(j + 1) == "In":
            name, j = self._at(j), j + 2
        end = self._closing(j) if self._at(j) in _CLOSING else j
        bounds = _numbers([self._at(k) for k in range(j + 1, end)])
        if bounds is None or (name and self.tokens[i + 1].kind != "word"):
            raise self._error(
                "For with bounds that are not numbers", i, "Write them as For i In {1:4}."
            )
        first, last, step = bounds
        count = max(0, int(min((last - first) / step, 1e15) + 1e-9) + 1)
        if name:
            self.variables.add(name)
            self.allowed.add(i + 1)
        self.loops.append((name, count))
        self.starts.add(end + 1)

    def _end_for(self, i: int) -> None:
        if not self.loops:
            raise self._error("EndFor without For", i)
        self.loops.pop()
        self.starts.add(i + 1)

    def _if(self, i: int) -> None:
        if self._at(i + 1) != "(":
            raise self._error(f"{self._at(i)} without a condition in brackets", i)
        self.starts.add(self._closing(i + 1) + 1)


_HANDLERS = {
    "Physical": _Checker._physical,
    "SetFactory": _Checker._factory,
    "Field": _Checker._field,
    "DefineConstant": _Checker._constant,
    "DefineNumber": _Checker._constant,
    "For": _Checker._for,
    "EndFor": _Checker._end_for,
    "If": _Checker._if,
    "ElseIf": _Checker._if,
}


def _numbers(words: list[str]) -> tuple[float, float, float] | None:
    """Return a, b, c of the words ``a : b`` or ``a : b : c``, c = 1; None for anything else."""
    parts = " ".join(words).replace("- ", "-").split(" : ")
    if len(parts) not in (2, 3) or not all(map(_NUMBER.fullmatch, parts)):
        return None
    first, last, step = (*map(float, parts), 1.0)[:3]
    return (first, last, step) if step and max(map(abs, (first, last, step))) < 1e15 else None
