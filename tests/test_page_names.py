"""Names and numbers in the pages are those of the package."""

import ast
import builtins
import contextlib
import dataclasses
import importlib
import inspect
import re
import tomllib
from functools import cache

import pytest
from support.pages import NAMES, ROOT, SPANS, Section, anchors, read

import fecloth as fc
from fecloth.cli import main as cli
from fecloth.integrators.step import Opening
from fecloth.quantities import formula_functions
from fecloth.scene import table_model
from fecloth.simulation.steps import StepInfo
from fecloth.study.fitting.file import KEYS, OF_EXPERIMENTS

# what a call or a name in a code span may begin with, beside fecloth's own
ROOTS = {"system": fc.System, "cloth": fc.Cloth, "fabric": fc.Fabric, "state": fc.State}
ROOTS |= {"result": fc.Result, "info": StepInfo, "StepInfo": StepInfo}
ROOTS |= {"method": fc.Newmark, "opening": Opening}
ROOTS |= {
    "dataclasses": dataclasses,
    "fc": fc,
    "fecloth": fc,
    "C": None,
    "frequency": None,
}  # frequency(2) is a quantity
ROOTS |= dict.fromkeys((*dir(builtins), *formula_functions.FUNCTIONS))
TEXT = "\n".join(map(read, NAMES))
# what the version brings, without the former names at its end
NEWS = read("CHANGELOG.md").split("\n## ")[1].split("\n### Names and defaults")[0]
SPANS = [*SPANS, *Section("CHANGELOG.md", "news", NEWS).spans]
FILE = re.compile(r"\.(py|toml|csv|json|log|html|npz|pvd|vtu|geo|msh)$")


# --- names ----------------------------------------------------------------------------------------


@cache
def classes():
    """The names of all classes in pages, sources and studies."""
    sources = [path for at in ("fecloth", "studies") for path in (ROOT / at).rglob("*.py")]
    texts = "\n".join([TEXT, *(path.read_text() for path in sources)])
    return set(re.findall(r"^class (\w+)", texts, re.MULTILINE))


def object_of(dotted):
    """The object of fecloth of that name, None for a class elsewhere; KeyError if there is none."""
    first, *rest = dotted.split(".")
    if dotted in classes() and not hasattr(fc, dotted):
        return None
    at = ROOTS[first] if first in ROOTS else getattr(fc, first, None)
    if first == "study" and rest and hasattr(fc.study.Study, rest[0]):
        at = fc.study.Study  # what `fc.study.of` returns; else it is the package
    for name in rest:
        known = getattr(at, "__dataclass_fields__", {}) | getattr(at, "__annotations__", {})
        if not hasattr(at, name) and name in known:
            return None
        try:
            at = getattr(at, name)
        except AttributeError:
            try:
                at = importlib.import_module(f"{at.__name__}.{name}")
            except (ImportError, AttributeError):
                raise KeyError(f"fecloth has no {dotted}") from None
    if at is None and first not in ROOTS:
        raise KeyError(f"fecloth has no {dotted}")
    return at


def calls_in(span):
    """(name, call) of every call in a code span that is Python."""
    with contextlib.suppress(SyntaxError):
        tree = ast.parse(span)
        calls = [node for node in ast.walk(tree) if isinstance(node, ast.Call)]
        return [(ast.unparse(call.func), call) for call in calls]
    return []


@pytest.mark.parametrize("span", sorted({span for span in SPANS if calls_in(span)}))
def test_calls_have_these_arguments(span):
    for name, call in calls_in(span):
        if callable(target := object_of(name)):
            given = [a for a in call.args if not isinstance(a, ast.Constant | ast.Starred)]
            keywords = {k.arg: None for k in call.keywords}
            inspect.signature(target).bind_partial(*given, **keywords)


def test_names_of_the_package_exist():
    for span in set(SPANS):
        first = span.split(".")[0]
        dotted = re.fullmatch(r"\w+(\.\w+)+", span) and not FILE.search(span)
        of_ours = first in ROOTS or inspect.ismodule(getattr(fc, first, None))
        if (dotted and of_ours) or re.fullmatch(r"[A-Z]+[a-z]\w*|[A-Z]{2,}\d", span):
            object_of(span)


def last_key(table):
    """Of `output.format = "vtkhdf"`: format."""
    ((key, value),) = table.items()
    return key if not isinstance(value, dict) or key in schema_keys() else last_key(value)


def schema_keys():
    """Every key that some table of a scene may have."""
    classes, keys = [table_model.Table], {"preset", "kes", "fast"}
    while classes:
        table = classes.pop()
        classes += table.__subclasses__()
        keys |= set(table.model_fields)
    return keys


def test_keys_of_scenes_exist():
    for span in SPANS:
        with contextlib.suppress(tomllib.TOMLDecodeError):
            if " = " in span and (given := tomllib.loads(span)):
                assert last_key(given) in {*schema_keys(), *KEYS, *OF_EXPERIMENTS, "file"}, span


# --- what it says ---------------------------------------------------------------------------------


def test_files_that_it_names_exist():
    named = {s for s in SPANS if re.fullmatch(r"(studies|meshes|tests|fecloth)/[\w./-]*", s)}
    assert named
    for name in named:
        assert (ROOT / name).exists(), name


@pytest.mark.parametrize("page", NAMES)
def test_links_lead_somewhere(page):
    for link in re.findall(r"\]\(([^):]+)\)", read(page)):
        path, _, anchor = link.partition("#")
        target = (ROOT / page).parent / path if path else ROOT / page
        assert target.exists(), link
        if anchor:
            assert anchor in anchors(target.resolve().relative_to(ROOT).as_posix()), link


def test_exit_codes():
    known = dict(re.findall(r"^ +(\d)  (\w+)", cli.STATUS, re.MULTILINE))
    lines = re.findall(r"Exit status: ([^.]*)\.", TEXT)
    assert lines
    for line in lines:
        told = dict(re.findall(r"(\d) ([\w ]+)", " ".join(line.split())))
        assert told.keys() == known.keys()
        assert told["0"] == "done"
        assert told["2"] == "bad input"


def test_the_page_of_meshes_names_each_of_them():
    named = re.findall(r"^\| `(\w+)` \|", read("meshes/README.md"), re.MULTILINE)
    assert sorted(named) == sorted(p.stem for p in (ROOT / "meshes").glob("*.geo"))


def test_the_page_of_studies_names_each_of_them():
    text = read("studies/README.md")
    for path in (ROOT / "studies").glob("*/__main__.py"):
        assert f"`python -m studies.{path.parent.name}" in text


def test_the_map_names_each_package():
    text = read("fecloth/README.md")
    for path in (ROOT / "fecloth").glob("*/__init__.py"):
        assert f"`fecloth/{path.parent.name}/`" in text


def test_the_version_is_the_same_everywhere():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert project["version"] == fc.__version__
    assert f"## {fc.__version__}" in read("CHANGELOG.md")
    assert f"version: {fc.__version__}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")
