"""The layout: a package imports only from those before it in the order of fecloth/README.md."""

import ast
import os
import re
import subprocess
import sys
import tokenize
from functools import cache
from pathlib import Path

import pytest

import fecloth

PACKAGE = Path(fecloth.__file__).parent
PACKAGES = """errors validation compiled quantities linalg mesh fabric terms system
nonlinear integrators stability output view simulation homogenisation verify scene runs distributed
study bench cli"""
ORDER = PACKAGES.split()
ROOT_FILES = {"__init__", "__main__", "errors", "validation", "homogenisation", "verify"}


@cache
def imports_of(source: Path) -> set[str]:
    """Packages of fecloth that a file imports from, at its top or inside its functions."""
    packages = set()
    for node in ast.walk(ast.parse(source.read_bytes())):
        names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
        if isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{source}: write the import as `from fecloth.x.y import z`"
            names = [node.module]
            if node.module == "fecloth":
                names = [f"fecloth.{alias.name}" for alias in node.names]
        packages |= {name.split(".")[1] for name in names if name.startswith("fecloth.")}
    return packages


@cache
def files_imported_by(source: Path, package: Path) -> set[Path]:
    """Files of a package that a file imports, also inside functions and for annotations alone."""
    files = set()
    for node in ast.walk(ast.parse(source.read_bytes())):
        if isinstance(node, ast.ImportFrom) and node.module:
            names = [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
        elif isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        else:
            continue
        files |= {package.parent.joinpath(*name.split(".")).with_suffix(".py") for name in names}
    return {file for file in files if file.is_file() and file.is_relative_to(package)}


def files_in_circles(package: Path) -> set[Path]:
    """Files that import themselves by way of others: what is left without all the others."""
    imports = {source: files_imported_by(source, package) for source in package.rglob("*.py")}
    while free := {source for source, needed in imports.items() if not needed}:
        imports = {s: needed - free for s, needed in imports.items() if s not in free}
    needed_by_others = set().union(*imports.values(), set())
    while idle := imports.keys() - needed_by_others:
        imports = {s: needed for s, needed in imports.items() if s not in idle}
        needed_by_others = set().union(*imports.values(), set())
    return set(imports)


def closure_of(source: Path, package: Path) -> set[Path]:
    """The files that one must have to read a file whole, with the file itself."""
    seen: set[Path] = set()
    ahead = {source}
    while ahead:
        file = ahead.pop()
        seen.add(file)
        ahead |= files_imported_by(file, package) - seen
    return seen


def tokens_of(source: Path) -> int:
    """Tokens of code in a file, without comments, docstrings and layout."""
    layout = {"NL", "NEWLINE", "INDENT", "DEDENT", "COMMENT", "ENCODING", "ENDMARKER"}
    count = 0
    before = "NEWLINE"
    with tokenize.open(source) as stream:
        for token in tokenize.generate_tokens(stream.readline):
            name = tokenize.tok_name[token.type]
            is_docstring = name == "STRING" and before in layout
            count += name not in layout and not is_docstring
            before = name
    return count


def test_the_loop_over_steps_can_be_read_whole():
    """It knows nothing of doubts, `Auto`, room, stability limits or fused steps."""
    files = closure_of(PACKAGE / "simulation" / "steps.py", PACKAGE)
    assert len(files) <= 90
    assert sum(map(tokens_of, files)) <= 96_000
    names = {file.relative_to(PACKAGE).as_posix() for file in files}
    apart = ("method_choice", "no_room", "stability_limited", "fused_march", "step_failures")
    assert not {f"simulation/{name}.py" for name in apart} & names
    assert not {name for name in names if name.startswith(("simulation/doubts", "stability"))}


def package_of(source: Path) -> str:
    return source.relative_to(PACKAGE).parts[0].removesuffix(".py")


@pytest.mark.parametrize("package", ORDER)
def test_a_package_imports_only_from_those_before_it(package):
    allowed = set(ORDER[: ORDER.index(package) + 1])
    for source in PACKAGE.rglob("*.py"):
        if package_of(source) == package:
            above = {name for name in imports_of(source) if name in ORDER} - allowed
            assert not above, f"{source.relative_to(PACKAGE)} imports {sorted(above)}"


def test_every_file_is_in_a_package_of_the_order():
    for source in PACKAGE.rglob("*.py"):
        package = package_of(source)
        assert package in ORDER or package in ("__init__", "__main__"), source
    assert {path.stem for path in PACKAGE.glob("*.py")} <= ROOT_FILES


def test_every_file_of_tests_has_a_name_of_its_own():
    """Pytest imports them by this name, wherever they stand."""
    names = [path.name for path in Path(__file__).parent.rglob("test_*.py")]
    assert sorted(names) == sorted(set(names))


def test_no_two_files_import_each_other():
    assert files_in_circles(PACKAGE) == set()


def test_dir_shows_only_the_public_names():
    assert sorted(dir(fecloth)) == sorted(fecloth.__all__)
    for name in fecloth.__all__:
        getattr(fecloth, name)


def test_import_loads_no_numerical_library():
    code = "import sys, fecloth; print(*{'numpy', 'scipy', 'numba', 'skfem'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []


def test_every_ignored_type_error_is_named_and_explained():
    for source in PACKAGE.rglob("*.py"):
        for line in source.read_text().splitlines():
            if "# type: ignore" in line:
                assert re.search(r"# type: ignore\[[a-z, -]+\]  # \w", line), f"{source}: {line}"


# --- the tests themselves -------------------------------------------------------------------------

# packages that take a tenth of a second or more to import, and few tests need
HEAVY = """pyvista vtkmodules matplotlib.pyplot hypothesis pypardiso distributed IPython sphinx
playwright pxr mujoco torch warp newton petsc4py mpi4py"""
COLLECT = f"""
import sys, pytest
options = ["--collect-only", "-q", "-o", "addopts=--doctest-modules --ignore=fecloth/__main__.py"]
assert pytest.main([*options, "-p", "no:cacheprovider"]) == 0
print("imported:", *(name for name in {HEAVY.split()} if name in sys.modules))
"""


@pytest.mark.stories
def test_collecting_the_tests_imports_no_heavy_package():
    """They are imported by the tests that need them, else each worker spends seconds on them."""
    environment = os.environ | {"PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}
    run = subprocess.run(
        [sys.executable, "-c", COLLECT],
        cwd=PACKAGE.parent,
        env=environment,
        capture_output=True,
        text=True,
    )
    assert run.returncode == 0, run.stderr
    assert run.stdout.splitlines()[-1] == "imported:"
