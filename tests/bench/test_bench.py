"""`fecloth bench`: its files, the quantities, and adapters that are right, wrong, or fail."""

import json
from copy import deepcopy

import numpy as np
import pytest

import fecloth as fc
from fecloth.bench import quantities
from fecloth.bench.cases import CASES, at_level
from fecloth.bench.runner import bench, load_adapter, run_level
from studies.engines import references
from studies.engines.fecloth_p1 import cut_clamped, make_system

KEYS = {"asks", "known", "source", "static", "mesh", "x", "v", "pins", "motion", "gravity"}
KEYS |= {"name", "loads", "fabric", "times", "quantity", "reference"}
FABRIC = {"areal_density", "tensile_stiffness", "poisson_ratio", "shear_stiffness"}
FABRIC |= {"bending_rigidity", "grain"}
ADAPTER = """
import numpy as np
VERSION, SETTINGS = "toy 1", "none"
def exact(case):
    t = case["times"][:, None]
    X, Y = case["X"].T
    c, s = np.cos(2 * np.pi * t), np.sin(2 * np.pi * t)
    return np.stack([t + c * X - s * Y, s * X + c * Y, 2 * t - 4.905 * t**2 + 0 * X], axis=-1)
def late(case):
    case["X"] += 1.0  # what an adapter changes is its own
    return exact({**case, "X": case["X"] - 1.0}) + [0.03, 0.0, -0.04]
def raises(case):
    raise ZeroDivisionError("a hint")
def lost(case):
    return exact(case) * np.nan
def short(case):
    return exact(case)[1:]
def run(case):
    raise NotImplementedError("no cloth")
"""


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "toy.py"
    path.write_text(ADAPTER)
    return path


@pytest.mark.parametrize("name", CASES)
def test_files_have_the_keys_of_the_page_and_state_a_case(name):
    said = CASES[name]
    assert set(said) - {"gradients"} == KEYS
    assert set(said["fabric"]) == FABRIC
    assert set(said["reference"]) == {"value", "uncertainty", "unit", "scale"}
    assert len(said["mesh"]["sizes"]) >= 3
    counts = []
    for level in range(3):
        case = at_level(said, level)
        X, triangles, n = case["X"], case["triangles"], len(case["X"])
        corners = X[triangles]
        assert (np.linalg.det(corners[:, 1:] - corners[:, :1]) > 0).all()
        assert sorted(np.unique(triangles)) == list(range(n))
        assert case["x"].shape == case["v"].shape == (n, 3)
        assert case["level"] == level
        assert (np.diff(case["times"], prepend=0.0) > 0).all()
        assert not case["static"] or len(case["times"]) == 1
        assert (len(case["pins"]) > 0) == (name != "flight")
        if case["motion"] is not None:
            assert case["motion"].shape == (len(case["times"]), len(case["pins"]), 3)
        assert all(len(load["nodes"]) and len(load["force"]) == 3 for load in case["loads"])
        counts.append(len(triangles))
    assert counts[0] < counts[1] < counts[2]


def test_what_is_asked_of_positions():
    case = at_level(CASES["shear"], 0)
    X, Y = case["X"].T
    u = np.stack([np.stack([k * X, 0 * X, 2.0 + k * Y], axis=1) for k in (0.0, 0.5)])
    case["times"] = np.array([0.0, 0.5])
    assert quantities.mean(case, u, 0) == pytest.approx([0.0, 0.25])
    assert quantities.point(case, u, 2, [0.3, 0.4]) == pytest.approx([2.0, 2.2])
    beside = quantities.point(case, u, 0, [0.3, 0.4], [0.7, 0.4])
    assert beside == pytest.approx([0.0, -0.2])
    assert quantities.away(case, u, ["t*X", "0", "2"]) == pytest.approx([0.0, 0.5])


def test_a_period_is_twice_the_time_between_zeros():
    case = at_level(CASES["string"], 0)
    case["times"] = t = np.linspace(0.01, 1.0, 100)
    u = np.zeros((100, len(case["X"]), 3))
    u[:, :, 2] = np.cos(2 * np.pi * t / 0.7)[:, None]
    assert quantities.period(case, u, 2) == pytest.approx(0.7, rel=1e-4)
    assert np.isnan(quantities.period(case, u[:20], 2))  # one zero


def test_an_exact_adapter_has_no_error_and_a_wrong_one_its_own(file):
    said, scale = CASES["flight"], CASES["flight"]["reference"]["scale"]
    exact = run_level(load_adapter(f"{file}:exact"), said, 1)
    assert exact["error"] < 1e-14
    assert (exact["status"], exact["adapter"], exact["version"]) == ("ok", "toy:exact", "toy 1")
    assert exact["uncertainty"] == said["reference"]["uncertainty"] / scale
    wrong = run_level(load_adapter(f"{file}:late"), said, 1)
    assert wrong["error"] == pytest.approx(0.05 / scale)


@pytest.mark.stories
@pytest.mark.parametrize(
    ("function", "status"),
    [
        ("raises", "failed: ZeroDivisionError: a hint"),
        ("lost", "failed: ValueError: the away of these positions is not a finite number"),
        ("short", "positions have the shape (9, 7, 3), not (times, n, 3) = (10, 7, 3)"),
        ("run", "cannot: no cloth"),
    ],
)
def test_failures_are_shown_as_failures(file, function, status, capsys, tmp_path):
    given = {"describe": False, "levels": 1, "as_json": True, "output": str(tmp_path / "out")}
    ended = bench(["flight"], [f"{file}:{function}"], **given)
    (line,) = capsys.readouterr().out.splitlines()
    row = json.loads(line)
    if function == "short":
        n = len(at_level(CASES["flight"], 0)["X"])
        status = status.replace("7", str(n))
    assert status in row["status"]
    assert row["error"] is None
    assert ended == (0 if function == "run" else 3)
    assert status[:20] in (tmp_path / "out" / "table.md").read_text()


def test_a_command_prints_lines_and_leaves_a_table_and_charts(file, tmp_path, run_command):
    out, two = tmp_path / "out", ["--adapter", f"{file}:exact", "--adapter", f"{file}:run"]
    rows = [
        json.loads(line)
        for line in run_command(
            "bench", *two, "flight", "wave", "--json", "--levels", "2", "-o", out
        ).out.splitlines()
    ]
    of_flight = [row for row in rows if row["case"] == "flight"]
    assert [(row["adapter"], row["level"]) for row in of_flight] == [
        ("toy:exact", 0),
        ("toy:exact", 1),
        ("toy", 0),
    ]
    assert {"case", "level", "error", "cpu_seconds"} <= set(rows[0])
    table = (out / "table.md").read_text()
    assert "- toy:exact: toy 1. none" in table
    assert table.count("| flight |") == 3
    assert {path.name for path in out.iterdir()} == {"table.md", "flight.png", "wave.png"}


def test_rows_are_apart_from_what_an_adapter_prints_and_stay_when_it_is_stopped(
    file, tmp_path, run_command
):
    (tmp_path / "beside.py").write_text(
        "import toy\n"
        "def run(case):\n"
        "    print('step 1')\n"
        "    if case['level'] == 1:\n"
        "        raise KeyboardInterrupt\n"
        "    return toy.exact(case)\n"
    )
    words = ["bench", "--adapter", str(tmp_path / "beside.py:run"), "flight", "--json"]
    said = run_command(*words, "-o", str(tmp_path / "out"), status=4)
    assert [json.loads(line)["level"] for line in said.out.splitlines()] == [0]
    assert "step 1" in said.err
    assert (tmp_path / "out" / "table.md").read_text().count("| flight |") == 1


def test_the_list_has_all_cases_with_what_is_known(run_command):
    said = run_command("bench", "--list").out
    assert all(f"| {name} | {CASES[name]['asks']}" in said for name in CASES)
    assert "| -613.125 ± 0.018 µm | ρ g L⁴/(8 B)" in said


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--adapter", "none.py:run"], "must be FILE.py:FUNCTION"),
        (["--adapter", "toy.py:walk"], "must be FILE.py:FUNCTION, and fails with KeyError: 'walk'"),
        (["--adapter", "toy.py:VERSION"], "toy.py:VERSION = 'toy 1': must be a function"),
        (
            ["--adapter", "wrong.py:run"],
            "wrong.py:run': must be FILE.py:FUNCTION, and fails with Syn",
        ),
        (
            ["--adapter", "ends.py:run"],
            "ends.py:run': must be FILE.py:FUNCTION, and fails with Sys",
        ),
        (["--adapter", "toy.py:run", "-o", "toy.py"], "File exists: '"),
        (["--adapter", "toy.py:run", "fligth"], "did you mean 'flight'"),
    ],
)
def test_mistakes_are_answered(file, words, message, run_command, monkeypatch):
    monkeypatch.chdir(file.parent)
    (file.parent / "wrong.py").write_text("def run(case)\n")
    (file.parent / "ends.py").write_text("import sys\nsys.exit(3)\n")
    assert message.lower() in run_command("bench", *words, status=2).err.lower()


# --- gradients ------------------------------------------------------------------------------------

GRADIENTS = [(name, key) for name, said in CASES.items() for key in said.get("gradients", ())]
EPSILON = 1e-3


def changed(name, key, factor):
    """A case with another constant of its fabric, and its known value with its uncertainty."""
    said = deepcopy(CASES[name])
    said["fabric"][key] = (np.array(said["fabric"][key]) * factor).tolist()
    return np.array(getattr(references, name)(said))


@pytest.mark.parametrize(("name", "key"), GRADIENTS)
def test_known_gradients_are_those_of_the_closed_forms(name, key):
    difference = changed(name, key, 1 + EPSILON) - changed(name, key, 1 - EPSILON)
    value, uncertainty = difference / (2 * EPSILON * np.max(CASES[name]["fabric"][key]))
    stated = CASES[name]["gradients"][key]
    assert stated["value"] == pytest.approx(value, rel=1e-6)
    assert stated["uncertainty"] == pytest.approx(abs(uncertainty), rel=1e-2)


@pytest.mark.parametrize("name", ["hanging", "elastica"])
def test_sensitivity_finds_the_known_gradients(name):
    said = CASES[name]
    case = at_level(said, 2)
    cloth, nodes = cut_clamped(case)

    def made(**constants):
        both = {"tensile_stiffness": lambda Y: [Y, Y]}
        fabric = {key: both.get(key, float)(value) for key, value in constants.items()}
        system = make_system(case | {"fabric": case["fabric"] | fabric}, fc.StVK(), cloth, nodes)
        return cloth, system, None, system.state(case["x"][nodes])

    def value(result):
        u = np.zeros((1, *case["x"].shape))
        u[0, nodes] = result.x - case["x"][nodes]
        given = said["quantity"]
        return getattr(quantities, given["name"])(case, u, **given["arguments"]).item()

    starts = {key: float(np.max(said["fabric"][key])) for key in said["gradients"]}
    answer = fc.sensitivity(made, starts, value)
    known = [said["gradients"][key]["value"] for key in starts]
    assert answer.derivative == pytest.approx(known, rel=2e-3)
