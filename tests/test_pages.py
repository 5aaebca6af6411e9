"""What the pages tell a reader to type works: every block, command and option in them.

A command that `FILLED` and `SHORTER` do not know how to run fails by its name.
"""

import contextlib
import io
import os
import re
import runpy
import shutil
import tomllib
import webbrowser
from functools import lru_cache
from pathlib import Path
from unittest import mock

import pytest
from support.pages import COMMANDS, LINES, README, ROOT, SECTIONS, SPANS, read, words

from fecloth.cli import main as cli
from fecloth.scene.scene import load_scene
from fecloth.scene.toml_text import to_toml

TESTED = (ROOT / "tests" / "studies" / "test_studies.py").read_text(encoding="utf-8")
CI = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
STUDY = re.compile(r"\bpython3? -m studies\.([\w.]+)")
STUDIES = sorted({STUDY.search(c)[1] for c in COMMANDS if STUDY.search(c)})
OURS = [c for c in COMMANDS if re.match(r"(\.venv/bin/)?fecloth \w+ \S", c)]
# a command's name
BARE = re.compile(
    r"fecloth (demo|run|view|render|export|check|mesh|info|converge|compare|chart|front|stability"
    r"|simplify|tune|sweep|sensitivity|budget|fit|modes|new|bench|--version)"
)
SCENE = ["cloth", "fabric", "terms", "time"]  # what a block needs to be a scene; else a fragment
# what stands for a name of the reader's own, by command and word; and what makes runs short
FILLED = {"DIR": "out/SCENE", "my.toml": "SCENE.toml", "mesh FILE": "meshes/square.geo"}
FILLED |= {
    "front 1%": "10%",  # fewer runs
    "tune max tip.z": "min tip.z",  # the cloth of the test falls from z = 0
    "render FILE": "swing.gif",
    "export FILE": "cloth.usda",
    "NAME": "Wind",
    "view NAME": "velocity",
    "demo NAME": "sag",
    "demo DIR": "out/demo",
    "FABRIC": "interlock",
    "A.toml": "SCENE.toml",
    "B.toml": "SCENE.toml",
}
FILLED |= {"fabric.tensile_stiffness=1e2:1e4:log:3": "fabric.tensile_stiffness=1e2:1e4:log:2"}
# the fabric of that scene is orthotropic, which most springs do not know
FILLED |= {"terms.0.type=StVK,Springs": "terms.0.type=StVK,BaraffWitkin"}
ELSEWHERE = (  # commands that continuous integration runs, and those that need a network
    "python3 -m venv .venv",
    ".venv/bin/pip install",
    ".venv/bin/pre-commit install",
    *("python -m build", "twine upload", "pip install shtab", "pip install 'fecloth["),
    *(". .venv/bin/activate", "pip install '.["),
    ".venv/bin/python -m pytest -q",
    "pytest",
    "python tests/support/key_reference.py",  # see tests/scene/test_key_reference.py
    *("python tests/support/transcripts.py", "python tests/mutants.py"),
    "python docs/extensions/",  # see tests/test_site.py
)
SHORTER = {
    "studies/scenes/flag.toml": ["cloth.h=0.1", "time.t_end=0.24"],
    "studies/scenes/sag.toml": ["cloth.h=0.25"],
    "studies/scenes/drape.toml": ["cloth.h=0.02", "time.t_end=0.1"],
    "napkin.toml": ["cloth.h=0.05", "time.t_end=0.1"],
    "SCENE.toml": ["cloth.h=0.2", "time.t_end=0.05", "output.restart_steps=10"],
    "FRONT.toml": ["time.t_end=0.05"],
}
FRONTS = ("chart", "front", "tune")  # studies that run many settings: of a scene of few seconds
MINIMAL = """
cloth = { shape = "rectangle", width = 1.0, height = 1.0, h = 0.25 }
fabric = { areal_density = 0.2, tensile_stiffness = 1000.0, bending_rigidity = 1e-5 }
terms = [{ type = "StVK" }, { type = "Gravity" }]
pins = [{ where = "left" }]
probes = [{ name = "tip", where = "right" }]
time = { method = "backward_euler", dt = 0.01, t_end = 0.1 }
"""
FRONT = f"""
{MINIMAL}
interest.end = ["tip.z"]
"""


def is_scene(text):
    with contextlib.suppress(tomllib.TOMLDecodeError):  # told by the test of that block
        return set(SCENE) <= set(tomllib.loads(text))


def blocks(language):
    result = [(f"{s.page}, {s.title}", b) for s in SECTIONS for b in s.blocks]
    return [pytest.param(b, id=title) for title, b in result if b.language == language]


def filled(command):
    """A command's words but the first, with the reader's own names filled in, and made short."""
    name, *given = words(command)[1:]
    given = [word for word in given if word != "--watch"]  # it needs a display
    given = [FILLED.get(f"{name} {word}", FILLED.get(word, word)) for word in given]
    if name in FRONTS:
        given = [word.replace("SCENE.toml", "FRONT.toml") for word in given]
    for scene in (word for word in given if word.endswith(".toml") and name not in ("mesh", "fit")):
        assert scene in SHORTER, f"{scene}: say in SHORTER how a test runs it"
        given += [word for value in SHORTER[scene] for word in ("--set", value)]
    if name == "tune" and "--methods" not in given:
        given += ["--elements", "P1", "--methods", "bdf2", "--quantity", "tip.z"]
    if name == "demo":
        given += [word for v in SHORTER[f"studies/scenes/{given[0]}.toml"] for word in ("--set", v)]
    given += {"converge": ["--levels", "3"]}.get(name, [])
    given += ["--overwrite"] if name == "new" else []
    if "--resume" in given:  # a run that has come to its end goes on to a later one
        given += ["--set", "time.t_end=0.06"]
    return [name, *given]


def target(given):
    """Where a command with these words writes."""
    named = given[given.index("-o") + 1] if "-o" in given else ""
    return Path(named or (f"out/{Path(given[1]).stem}" if given[0] in ("demo", "run") else "."))


# --- a clone, as far as a reader uses it ----------------------------------------------------------


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """A clone with the scene of the pages and the runs that they name."""
    folder = tmp_path_factory.mktemp("clone")
    for name in ("studies", "meshes"):
        (folder / name).symlink_to(ROOT / name)
    given = [block for section in SECTIONS for block in section.blocks]
    scenes = [b.text for b in given if b.language == "toml" and not b.file and is_scene(b.text)]
    (folder / "SCENE.toml").write_text(max(scenes, key=len, default=""), encoding="utf-8")
    (folder / "FRONT.toml").write_text(FRONT, encoding="utf-8")
    for block in (b for b in given if b.file):
        (folder / block.file).write_text(block.text, encoding="utf-8")
    with contextlib.chdir(folder):
        cli.main(["new", "my", "--test", "tension"])
        shutil.copy("my_fit.toml", "FIT.toml")
        for command in ["fecloth run SCENE.toml", *OURS]:
            with contextlib.suppress(AssertionError):  # told by the test of that command
                given = filled(command)
                if given[0] == "run" and "--resume" not in given and not target(given).exists():
                    cli.main(given)
    return folder


@pytest.fixture
def clone(runs, tmp_path, monkeypatch):
    """The working directory: a copy of `runs`."""
    shutil.copytree(runs, tmp_path, symlinks=True, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    monkeypatch.setattr(webbrowser, "open", lambda page: True)
    return tmp_path


# --- blocks ---------------------------------------------------------------------------------------


@pytest.mark.stories
@pytest.mark.parametrize("page", sorted({s.page for s in SECTIONS if "```python" in s.text}))
def test_python_blocks_run(page, clone, capsys):
    """In order, in one namespace a page; and the files that they name are there."""
    names = {"__name__": "page"}
    for block in (b for s in SECTIONS if s.page == page for b in s.blocks):
        if block.language == "python":
            exec(compile(block.text, page, "exec"), names)
            for name in re.findall(r"\"(out/[\w/.]+)\"", block.text):
                assert list(clone.glob(f"{name}*")), f"{name} is not there"
    assert not re.search(r"\bnan\b", capsys.readouterr().out)


@pytest.mark.stories
@pytest.mark.parametrize("block", blocks("toml"))
def test_toml_blocks_build(block, clone):
    """Scenes as they are, fragments in the place of what a minimal scene has there."""
    data = tomllib.loads(block.text)
    if not is_scene(block.text):
        minimal = tomllib.loads(MINIMAL)
        if "equilibrium" in data:  # in place of the time
            del minimal["time"]
        if "cloths" in data:  # in place of one cloth
            del minimal["cloth"], minimal["probes"]  # its sets have other names
        if "seams" in data:  # between two pieces, for the names of their edges
            cloth = minimal.pop("cloth")
            minimal |= {"cloths": {"front": cloth, "back": cloth}, "pins": [], "probes": []}
        data = merged(minimal, data)
    (clone / "block.toml").write_text(to_toml(data), encoding="utf-8")
    scene = load_scene(clone / "block.toml")
    if "expect" in data:
        scene.require_expectations()
    assert len(scene.build().system.bound) == len(data["terms"])


def merged(base, more):
    """Tables key by key; a fabric or cloth that says what it is replaces the other."""
    whole = {"preset", "areal_density", "shape"}
    return base | {
        key: merged(base[key], value)
        if isinstance(value, dict) and key in base and not whole & set(value)
        else value
        for key, value in more.items()
    }


# --- commands -------------------------------------------------------------------------------------


def distinct(commands):
    """One of the commands that are the same once they are filled in, wherever they write."""
    result = {}
    for command in commands:
        with contextlib.suppress(AssertionError):  # told by the test of that command
            given = filled(command)
            is_study = given[0] in ("simplify", "tune")
            at = given.index("-o") if is_study and "-o" in given else len(given)
            result.setdefault((*given[:at], *given[at + 2 :]), command)
            continue
        result[command] = command
    return result.values()


@pytest.mark.stories
@pytest.mark.parametrize("command", distinct(OURS))
def test_commands_run(command, clone, monkeypatch):
    monkeypatch.setattr("fecloth.study.measured_runs.LONG_ENOUGH", 0.0)  # each is run once
    given = filled(command)
    if given[0] in ("demo", "run") and "--resume" not in given:
        shutil.rmtree(target(given), ignore_errors=True)
    assert cli.main(given) == 0
    assert target(given).exists()


@pytest.mark.parametrize("line", [line for line in LINES if re.match(r"(\S*/)?fecloth \w", line)])
def test_documented_options_exist(line):
    assert options_in(line) <= fecloth_options(line.split()[1])


def options_in(text):
    return set(re.findall(r"--[a-z][\w-]*", text))


def answer(run, *words):
    """What a program says to --help."""
    said = io.StringIO()
    argv, environment = (
        mock.patch("sys.argv", [*(words or ["study"]), "--help"]),
        mock.patch.dict(os.environ),
    )
    with argv, environment, contextlib.redirect_stdout(said), pytest.raises(SystemExit):
        run()
    return said.getvalue()


@lru_cache
def study_options(study):
    """The options of a study that has some."""
    path = ROOT / "studies" / study.replace(".", "/")
    file = path / "__main__.py" if path.is_dir() else path.with_suffix(".py")
    if not re.search(r"\.(Parser|parse_arguments)\(", file.read_text()):
        return set()
    return options_in(answer(lambda: runpy.run_module(f"studies.{study}", run_name="__main__")))


def fecloth_options(name):
    return options_in(answer(lambda: cli.main([name, "--help"])))


@pytest.mark.filterwarnings("ignore:.*found in sys.modules")
@pytest.mark.parametrize("command", [c for c in COMMANDS if STUDY.search(c)])
def test_studies_are_run_by_ci_and_have_the_options(command):
    study = STUDY.search(command)[1]
    assert f'"{study}"' in TESTED or f"studies.{study}" in TESTED
    assert options_in(command) <= study_options(study)


def test_options_named_alone_exist():
    named = {option for span in SPANS if span.startswith("--") for option in options_in(span)}
    known = [study_options(study) for study in STUDIES]
    known += [fecloth_options(words(command)[1]) for command in OURS]
    assert named <= set().union(*known)


def test_ci_installs_as_the_readme_says():
    """.ci/run takes these lines from here: it evaluates the first that matches its patterns."""
    patterns = re.findall(r"grep -m1 '(.*)' README.md", CI)
    lines = [next(line for line in README.splitlines() if re.search(p, line)) for p in patterns]
    assert [line.split()[-1] for line in lines] == ["out/sag", "-q"]


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_is_run_by_a_test(command):
    known = command in OURS or STUDY.search(command) or BARE.fullmatch(command)
    assert known or command.startswith(ELSEWHERE)


@pytest.mark.stories
def test_files_of_a_run_are_those_of_the_table(runs):
    text = read("fecloth/runs/README.md")
    (table,) = re.findall(r"^\| file \| what \|\n(?:\|.*\n)+", text, re.MULTILINE)
    cells = [row.split("|")[1] for row in table.splitlines()[2:]]
    told = {name for cell in cells for name in re.findall(r"`([^`]+)`", cell)}
    folder = runs / "out" / "SCENE"
    assert all(list(folder.glob(name)) for name in told)
    there = {p.name for p in folder.iterdir()} - {"frames", "run.pvd", "run.vtu.series"}
    assert {name.split("/")[0] for name in told} - {"frames", "run.pvd", "run.vtu.series"} == there
