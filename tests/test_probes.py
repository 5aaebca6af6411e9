"""Outside `terms/` and `integrators/` nobody asks a term or method for an ability by its name.

What a term or method is stands in `TermTraits` and `MethodTraits`, and what it can in `BoundTerm`
and `Integrator`. So no module has a list of names of terms or methods, and none looks whether one
has an attribute of a name.
"""

import ast
from pathlib import Path

import pytest

import fecloth
from fecloth import terms
from fecloth.integrators import EXPLICIT, METHODS
from fecloth.integrators.protocol import MethodTraits
from fecloth.terms.protocol import ALWAYS, BoundTerm
from fecloth.terms.traits import TermTraits

PACKAGE = Path(fecloth.__file__).parent
NAMES = {*terms.__all__, "Condition", "MembraneLaw", *METHODS, *EXPLICIT}
NAMES |= {kind.__name__ for kind in {**METHODS, **EXPLICIT}.values()}
# attributes of terms and methods, of their traits, and others that were once asked for by name
ASKED = {name for name in vars(BoundTerm) if not name.startswith("_")}
ASKED |= {*ALWAYS, *TermTraits.__dataclass_fields__, "no_space_error", "traits"}
ASKED |= {*MethodTraits.__dataclass_fields__, "step", "numerical", "check", "check_start"}
ASKED |= {"method", "choose", "rtol", "longest", "rho_inf", "near", "kernels", "function", "moduli"}
ASKED |= {"stiffness", "strain", "rest", "plate", "friction", "gap", "bind", "stencil", "send"}
OTHERS = {"_current_case"}  # whose attributes have such names, too
VALUES = {"term", "bound", "over", "law", "method", "steps"}  # what variables of these are called
HOMES = ("terms", "integrators")


def sources():
    for path in sorted(PACKAGE.rglob("*.py")):
        if path.relative_to(PACKAGE).parts[0] not in HOMES:
            yield path


def probes(text):
    """The lines of a module that ask a term or method for an attribute by a literal name."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            asks = node.func.id in ("hasattr", "getattr") and len(node.args) >= 2
            literal = asks and isinstance(node.args[1], ast.Constant)
            literal = literal and named(node.args[0]) not in OTHERS
            if literal and (node.args[1].value in ASKED or named(node.args[0]) in VALUES):
                yield ast.unparse(node)


def named(node):
    """The last name of ``x`` or ``x.y``."""
    return node.id if isinstance(node, ast.Name) else getattr(node, "attr", "")


def lists(text):
    """The displays of a module that hold the names of two terms or methods, or their classes."""
    for node in ast.walk(ast.parse(text)):
        parts = [*getattr(node, "elts", []), *filter(None, getattr(node, "keys", []))]
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.BitOr):
            parts = [node.left, node.right]
        if isinstance(node, ast.Tuple) and isinstance(node.ctx, ast.Store):
            continue
        values = {part.value if isinstance(part, ast.Constant) else named(part) for part in parts}
        if len(values & NAMES) > 1:
            yield ast.unparse(node)


@pytest.mark.stories
def test_terms_and_methods_say_what_they_are():
    texts = {str(path.relative_to(PACKAGE)): path.read_text() for path in sources()}
    found = [(name, said) for name, text in texts.items() for said in (*probes(text), *lists(text))]
    assert found == []


@pytest.mark.parametrize(
    "line",
    [
        'hasattr(term, "limit")',
        'getattr(self.bound, "anything", None)',
        'getattr(steps, "method", steps)',
        'any(hasattr(one, "supply") for one in system.bound)',
    ],
)
def test_a_probe_is_found(line):
    assert list(probes(line))
    assert not list(probes('hasattr(os, "fork") or getattr(cloth, name) or term.limit'))


@pytest.mark.parametrize(
    "line",
    [
        'BENDING = ("HingeBending", "PlateBending")',
        'CHEAPER = {"PlateBending": 1, "HingeBending": 2}',
        'USUAL = ["bdf2", "newmark"]',
        "isinstance(method, (fc.BDF2, fc.Newmark))",
        "isinstance(term, StVK | NeoHookean)",
    ],
)
def test_a_list_is_found(line):
    assert list(lists(line))
    assert not list(lists('("StVK", 1), ["linear", "bdf2"], isinstance(term, terms.StVK)'))
