"""Change single formulas and thresholds of the package and see which changes the tests notice.

    python tests/mutants.py --number 60 --seed 1

A mutant is a clone of the last commit in which one expression differs: a sign, a factor 2, ``min``
for ``max``, ``<`` for ``<=``, or a term that is dropped. Per mutant, the tests of its package run
first, then all of the first layer, then the stories; the first failure ends it. A mutant that
survives all is printed with its line: write the test that it lacks, or, where no result can differ
(an equivalent mutant), draw again with ``--skip``. CI does not run this: it takes hours.
"""

import argparse
import ast
import os
import random
import subprocess
import sys
import tempfile
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
LAYERS = (("layer one", "not study and not stories"), ("stories", "stories"))

# What has words, prices or other people's formats, and no formulas of cloth.
WORDS = ("cli", "view", "output", "bench", "errors.py", "validation.py")
PRICES = ("cost", "price", "byte", "gain", "speed", "seconds")

LONGEST = 1800
"""Seconds after which a run of tests that does not end counts as failed."""

SWAPPED = {ast.Lt: "<=", ast.LtE: "<", ast.Gt: ">=", ast.GtE: ">"}
OPPOSITE = {"min": "max", "max": "min", "minimum": "maximum", "maximum": "minimum"}


class Mutant(NamedTuple):
    file: str
    """Path below the root of the repository."""
    start: int
    """Byte where the changed expression begins."""
    end: int
    kind: str
    before: str
    after: str
    line: int

    def __str__(self) -> str:
        return f"{self.file}:{self.line} {self.kind}: {self.before} → {self.after}"


def changes(node: ast.expr) -> Iterator[tuple[str, str]]:
    """Kind and new text of each change of one expression."""
    match node:
        case ast.BinOp(left, ast.Add() | ast.Sub() as sign, right):
            a, b = ast.unparse(left), ast.unparse(right)
            yield "sign", f"({a} {'-' if isinstance(sign, ast.Add) else '+'} ({b}))"
            yield "term dropped", f"({a})"
        case ast.BinOp(_, ast.Mult() | ast.Div(), _):
            yield "factor 2", f"(2 * ({ast.unparse(node)}))"
        case ast.UnaryOp(ast.USub(), operand) if not isinstance(operand, ast.Constant):
            yield "sign", f"({ast.unparse(operand)})"
        case ast.Compare(left, [operator], [right]) if type(operator) in SWAPPED:
            a, b = ast.unparse(left), ast.unparse(right)
            yield "threshold", f"({a} {SWAPPED[type(operator)]} {b})"
        case ast.Call(ast.Name(name) | ast.Attribute(attr=name) as function) if name in OPPOSITE:
            called = ast.unparse(function).removesuffix(name) + OPPOSITE[name]
            given = [*map(ast.unparse, node.args), *map(ast.unparse, node.keywords)]
            yield "min for max", f"{called}({', '.join(given)})"


def is_left_out(node: ast.AST) -> bool:
    """Say whether the inside of `node` is no formula: words, indices, types, prices."""
    if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
        return any(word in node.name.lower() for word in PRICES)
    return isinstance(node, (ast.JoinedStr, ast.Raise, ast.Slice, ast.arg, ast.Import))


def formulas(node: ast.AST) -> Iterator[ast.expr]:
    """All expressions below `node` that may be formulas or thresholds."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.Subscript):
            yield from formulas(child.value)
        elif not is_left_out(child):
            if isinstance(child, ast.expr) and not is_text(child):
                yield child
            yield from formulas(child)


def is_text(node: ast.expr) -> bool:
    """Say whether an operation joins words or lists rather than numbers."""
    return any(
        isinstance(part, (ast.JoinedStr, ast.List, ast.Tuple))
        or (isinstance(part, ast.Constant) and isinstance(part.value, (str, bytes)))
        for part in ast.walk(node)
    )


def mutants(root: Path = ROOT) -> list[Mutant]:
    """All mutants of the package."""
    every = []
    for path in sorted((root / "fecloth").rglob("*.py")):
        inside = path.relative_to(root / "fecloth")
        if inside.parts[0] in WORDS or any(word in inside.name for word in PRICES):
            continue
        source = path.read_bytes()
        begins = [0]
        for line in source.splitlines(keepends=True):
            begins.append(begins[-1] + len(line))
        for node in formulas(ast.parse(source)):
            start = begins[node.lineno - 1] + node.col_offset
            end = begins[node.end_lineno - 1] + node.end_col_offset
            name = str(path.relative_to(root))
            before = ast.unparse(node)
            for kind, after in changes(node):
                every.append(Mutant(name, start, end, kind, before, after, node.lineno))
    return every


def drawn(every: list[Mutant], number: int, seed: int) -> list[Mutant]:
    """Draw `number` mutants, as many of each kind, each expression of a kind as likely."""
    draw = random.Random(seed)
    kinds = defaultdict(list)
    for mutant in every:
        kinds[mutant.kind].append(mutant)
    shuffled = [draw.sample(kinds[kind], len(kinds[kind])) for kind in sorted(kinds)]
    return [shuffled[i % len(shuffled)][i // len(shuffled)] for i in range(number)]


def nearest_tests(root: Path, file: str) -> list[str]:
    """Folders of tests from that of the mutant's own package to that of the package above all."""
    folders = [Path(file).parent, *Path(file).parent.parents]
    nearest = [Path("tests") / each.relative_to("fecloth") for each in folders[:-2]]
    return [str(each) for each in nearest if (root / each).is_dir()]


def is_killed(root: Path, tests: list[str], marks: str, processes: str) -> str:
    """The first test that fails, or nothing."""
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-n", processes, "-m", marks, *tests]
    command += ["-p", "no:cacheprovider"]
    environment = {**os.environ, "PYTHONPATH": str(root)}
    try:
        ran = subprocess.run(
            command, cwd=root, env=environment, capture_output=True, text=True, timeout=LONGEST
        )
    except subprocess.TimeoutExpired:
        return f"no end after {LONGEST} s"
    if ran.returncode in (0, 5):  # 5: no test has these marks
        return ""
    failed = [line for line in ran.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))]
    return failed[0] if failed else f"exit status {ran.returncode}"


def fate(root: Path, mutant: Mutant, processes: str, is_sample: bool) -> tuple[str, str]:
    """Layer in which the mutant dies and the test that kills it, or "survives".

    A sample runs only the tests of the mutant's package in the first layer.
    """
    path = root / mutant.file
    source = path.read_bytes()
    path.write_bytes(source[: mutant.start] + mutant.after.encode() + source[mutant.end :])
    try:
        for layer, marks in LAYERS:
            for tests in ([each] for each in nearest_tests(root, mutant.file)):
                if killer := is_killed(root, tests, marks, processes):
                    return layer, killer
            if is_sample:
                break
            if killer := is_killed(root, [], marks, processes):
                return layer, killer
    finally:
        path.write_bytes(source)
    return "survives", ""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--number", type=int, default=60)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--skip", type=int, nargs="*", default=[], help="equivalent ones")
    parser.add_argument("--processes", default="auto", help="as in pytest -n")
    parser.add_argument("--sample", action="store_true", help="tests of its package alone")
    parser.add_argument("--list", action="store_true", help="draw them and run nothing")
    options = parser.parse_args()
    every = mutants()
    chosen = drawn(every, options.number + len(options.skip), options.seed)
    print(f"{options.number} of {len(every)} mutants, seed {options.seed}", flush=True)
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder) / "fecloth"
        clone = ["git", "clone", "--quiet", "--shared", str(ROOT), str(root)]
        subprocess.run(clone, check=True)
        for number, mutant in enumerate(chosen):
            if number in options.skip:
                continue
            ended = () if options.list else fate(root, mutant, options.processes, options.sample)
            print(number, mutant, *ended, sep=" | ", flush=True)


if __name__ == "__main__":
    main()
