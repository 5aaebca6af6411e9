"""`fecloth new`: which files it writes, that they fit together and run, and what it refuses."""

import csv
import re
import tomllib
from pathlib import Path

import pytest

from fecloth.cli.main import main
from fecloth.scene.scene import load_scene
from fecloth.simulation.quantity import parse_quantity
from fecloth.study.parameters import choose_parameters
from fecloth.study.problem import StudyProblem

TESTS = {"tension": "", "cantilever": "", "drape": ".geo"}
COARSE = {  # settings that make the runs short
    "tension": ["cloth.h=12.5 mm", "equilibrium.load_steps=2"],
    "cantilever": [f"cloths.{name}.h=12 mm" for name in ("short", "middle", "long")],
    "drape": ["cloth.h=25 mm", "equilibrium.load_steps=5"],
}


@pytest.fixture(params=TESTS)
def written(request, tmp_path, monkeypatch, run_command):
    """The name of a test, in a folder with the files of a specimen."""
    monkeypatch.chdir(tmp_path)
    assert (
        "next: fecloth run cloths/my cotton.toml"
        in run_command("new", "cloths/my cotton.toml", "--test", request.param).out
    )
    monkeypatch.chdir(tmp_path / "cloths")
    return request.param


def table(path):
    """The names and units of the columns of a CSV file, and its rows."""
    lines = [line for line in path.read_text(encoding="utf-8").splitlines() if line[:1] != "#"]
    head, *rows = csv.reader(lines)
    units = [re.fullmatch(r"(.*?)(?: \[(.*)\])?", name).groups() for name in head]
    return dict(units), [list(map(float, row)) for row in rows]


def test_the_files_of_a_specimen_fit_together(written, tmp_path):
    endings = [".csv", ".toml", "_fit.toml", *filter(None, [TESTS[written]])]
    folder = tmp_path / "cloths"
    assert sorted(p.name for p in folder.iterdir()) == sorted(f"my cotton{e}" for e in endings)
    assert not any("NAME" in path.read_text(encoding="utf-8") for path in folder.iterdir())
    fit = tomllib.loads((folder / "my cotton_fit.toml").read_text(encoding="utf-8"))
    (experiment,) = fit["experiments"]
    scene = load_scene(folder / experiment["scene"])
    columns, rows = table(folder / experiment["data"])
    assert len(rows) >= 3
    assert all(len(row) == len(columns) for row in rows)
    assert "made-up" in (folder / experiment["data"]).read_text(encoding="utf-8")
    chosen = choose_parameters(StudyProblem.of(scene), fit["parameters"], {})
    assert {each.name: each.value for each in chosen} == fit["parameters"]
    problem = StudyProblem.of(scene)
    along = experiment.get("along")
    pairs = experiment["quantity"] | (along if isinstance(along, dict) else {})
    for column, text in pairs.items():
        problem.check_quantity(parse_quantity(text))
        assert columns[column] == {"m": "mm", "N": "N", "": "-"}[parse_quantity(text).unit()]
    assert along is None or list(along.values()) == ["grip.x"]


@pytest.mark.stories
def test_a_drape_on_its_pedestal_is_near_the_clamped_one(tmp_path, monkeypatch):
    """Clamped, the ring leaves the support level; laid, the cloth may rise off it: 0.02 here."""
    monkeypatch.chdir(tmp_path)
    ends = []
    for name, options in (("clamped", []), ("laid", ["--pedestal"])):
        assert main(["new", name, "--test", "drape", *options]) == 0
        assert main(["run", f"{name}.toml", "--quiet", "--set", "cloth.h=25 mm"]) == 0
        with Path(f"out/{name}/observed.csv").open(encoding="utf-8") as file:
            *_, end = csv.DictReader(file)
        ends.append(end)
    clamped, laid = (float(end["drape_coefficient"]) for end in ends)
    assert laid == pytest.approx(clamped, abs=0.04)
    assert 0.0 < float(ends[1]["least_distance:Obstacle.1"]) < 1e-3
    assert sorted(path.name for path in tmp_path.glob("laid*")) == [
        f"laid{ending}" for ending in (".csv", ".toml", "_fit.toml")
    ]


@pytest.mark.stories
def test_the_scene_of_a_specimen_runs(written, run_command):
    changes = [word for change in COARSE[written] for word in ("--set", change)]
    words = run_command("run", "my cotton.toml", "--quiet", *changes).err
    assert "warning" not in words


def test_files_that_exist_are_kept(written, run_command):
    data = Path("my cotton.csv")
    data.write_text("mine", encoding="utf-8")
    again = ["new", "my cotton", "--test", written]
    assert "exists: needs --overwrite" in run_command(*again, status=2).err
    assert data.read_text(encoding="utf-8") == "mine"
    assert main([*again, "--overwrite"]) == 0
    assert table(data)[1]


SCENES = {  # settings that make the runs short
    "cloth": ["cloth.h=12.5 cm", "time.t_end=20 ms"],
    "drop": ["cloth.h=10 cm", "time.t_end=10 ms"],
    "static": ["cloth.h=25 cm"],
    "geo": ["cloth.h=20 cm", "time.t_end=20 ms"],
}


@pytest.mark.stories
@pytest.mark.parametrize("kind", SCENES)
def test_a_new_scene_runs_at_once(kind, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["new", "my first", "--kind", kind]) == 0
    endings = [".geo", ".toml"] if kind == "geo" else [".toml"]
    assert sorted(p.name for p in tmp_path.iterdir()) == [f"my first{e}" for e in endings]
    assert capsys.readouterr().out.endswith("next: fecloth run my first.toml\n")
    text = (tmp_path / "my first.toml").read_text(encoding="utf-8")
    assert "NAME" not in text
    assert text.startswith("# ")
    changes = [word for change in SCENES[kind] for word in ("--set", change)]
    assert main(["run", "my first.toml", "--quiet", *changes]) == 0
    assert (tmp_path / "out/my first/report.html").is_file()
    scene = load_scene("my first.toml")
    for text in scene.interest.quantities:
        StudyProblem.of(scene).check_quantity(parse_quantity(text))


def test_a_new_scene_names_sets_that_its_cloth_has(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["new", "a"]) == 0
    line = re.search(r"^where = .*# (.*), or inside", Path("a.toml").read_text("utf-8"), re.M)
    cloth = load_scene("a.toml").mesh()
    assert all(len(cloth.nodes(name)) for name in line[1].split(", "))


def test_without_an_option_it_is_a_cloth(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["new", "a"]) == 0
    assert main(["new", "b", "--kind", "cloth"]) == 0
    a, b = ((tmp_path / f"{name}.toml").read_text(encoding="utf-8") for name in "ab")
    assert a.replace(" a.toml", "").replace("out/a", "") == b.replace(" b.toml", "").replace(
        "out/b", ""
    )
