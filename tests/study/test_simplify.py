"""Simplification of scenes: changes of results, variants, predictions, the reduced scene."""

import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

import fecloth as fc
from fecloth.errors import InputError
from fecloth.scene.probe_tables import Interest
from fecloth.scene.scene import load_scene
from fecloth.scene.toml_text import to_toml
from fecloth.study.simplification.cases import Answer, changes, data_of, scene_of
from fecloth.study.simplification.dimensionless import Numbers
from fecloth.study.simplification.predictions import predict_change
from fecloth.study.simplification.report import judge_variant
from fecloth.study.simplification.search import sort_candidates, unresolved_sizes
from fecloth.study.simplification.variants import variants
from studies.simplify import __main__ as simplify

STUDIES = Path(__file__).parents[2] / "studies"
SCENES = STUDIES / "scenes" / "needs"


def make_answer(h, t, columns, u, probes=()):
    cloth = fc.Cloth.rectangle(1.0, 1.0, h, pattern="right")
    columns = {name: list(values) for name, values in columns.items()}
    row = {"times": list(t), "columns": columns, "moved": u(cloth.X).tolist()}
    return Answer(row, cloth, probes)


def test_changes_of_fields_paths_ends_and_periods():
    def out_of_plane(slope):
        return lambda X: np.column_stack([0 * X, slope * X[:, 0]])

    def columns(t, omega, size):
        swing = {f"tip.{c}": 3.0 + 0 * t for c in "xy"} | {"tip.z": 7 + size * np.cos(omega * t)}
        return swing | {"sag": size * t, "area": 1.0 + 0 * t}

    t, fewer = np.linspace(0, 4, 4001), np.linspace(0, 4, 2001)
    full = make_answer(0.25, t, columns(t, 6.0, 1.0), out_of_plane(0.2), ("tip",))
    other = make_answer(0.5, fewer, columns(fewer, 6.3, 1.0), out_of_plane(0.21), ("tip",))
    interest = Interest(end=("displacement", "sag", "area"), path=("sag",), period=("tip.z",))
    found = changes(full, other, interest)
    assert found["displacement"] == pytest.approx(0.05, rel=1e-9)
    assert found["sag"] == found["area"] == 0
    assert found["path of sag"] == pytest.approx(0, abs=1e-12)
    assert found["period of tip.z"] == pytest.approx(0.3 / 6.3, rel=0.02)
    larger = make_answer(0.5, fewer, columns(fewer, 6.0, 1.1), out_of_plane(0.2), ("tip",))
    interest = Interest(path=("tip",), end=("sag", "tip.z"))
    assert list(changes(full, larger, interest).values()) == pytest.approx([0.1] * 3, rel=1e-5)


def test_a_path_of_one_step_is_compared_at_the_end():
    t = np.array([0.0, 1.0, 2.0])
    full = make_answer(0.5, t, {"sag": t}, lambda X: np.zeros((len(X), 3)))
    other = make_answer(0.5, t[::2], {"sag": 1.25 * t[::2]}, lambda X: np.zeros((len(X), 3)))
    assert changes(full, other, Interest(path=("sag",))) == {"path of sag": pytest.approx(0.25)}


def test_a_removed_term_has_a_zero_column_and_no_oscillation_has_no_period():
    t = np.linspace(0, 1, 11)
    full = make_answer(0.5, t, {"StVK": t}, lambda X: np.zeros((len(X), 3)))
    without = make_answer(0.5, t, {}, lambda X: np.zeros((len(X), 3)))
    assert changes(full, without, Interest(end=("StVK", "displacement"))) == {
        "StVK": 1.0,
        "displacement": 0.0,
    }
    with pytest.raises(InputError, match="passes its middle less than twice"):
        changes(full, full, Interest(period=("StVK",)))


@pytest.mark.parametrize(
    "path",
    [*SCENES.glob("*.toml"), *(STUDIES / "scenes").glob("*.toml")],
    ids=lambda path: path.stem,
)
def test_every_simpler_scene_is_a_scene(path):
    data = data_of(load_scene(path))
    tried = variants(data, Interest(end=("displacement",)))
    for variant in tried:
        simpler = variant.apply(data)
        assert variant.static or simpler != data, variant.name
        scene_of(to_toml(simpler))
    assert data == data_of(load_scene(path))  # no variant has changed it
    names = [variant.name for variant in tried]
    assert {"without StVK", "h × 2"} <= set(names)
    assert ("equilibrium" in names) == ("time" in data)
    assert ("Springs for StVK" in names) == (data["cloth"].get("element") != "P2")
    assert ("dt × 2" in names) == (
        path.stem not in ("dome", "inflated_disk")  # which take one step
    )
    assert "equilibrium" not in [one.name for one in variants(data, Interest(path=("sag",)))]


def test_p2_becomes_p1_and_adaptive_steps_get_a_looser_tolerance():
    data = data_of(load_scene(SCENES / "taut.toml"))
    data["cloth"]["element"], data["mass"], data["terms"] = "P2", "consistent", data["terms"][::2]
    data["time"] = {"method": "bdf2", "dt": "auto", "rtol": 0.01, "t_end": 0.1}
    simpler = {one.name: one.apply(data) for one in variants(data, Interest(end=("sag",)))}
    assert simpler["explicit"]["mass"] == simpler["P1 for P2"]["mass"] == "lumped"
    assert simpler["pointwise strain of StVK"]["terms"][0]["strain"] == "pointwise"
    assert not {"Springs for StVK", "HingeBending for PlateBending"} & set(simpler)
    assert scene_of(to_toml(simpler["rtol × 4"])).time.rtol == 0.04


@pytest.mark.parametrize("element", ["P1", "P2"])
def test_a_plate_becomes_hinges_or_is_left_out_with_its_clamps(element):
    """Each simpler scene can be built and marched by a step."""
    data = data_of(make_strip(terms=[{"type": "StVK"}, {"type": "PlateBending"}]))
    data["cloth"] |= {"element": element, "h": 0.2}
    data["pins"][0]["clamp"] = True
    tried = variants(data, Interest(end=("sag",)))
    named = {one.name: one for one in tried}
    siblings = {"HingeBending for PlateBending", "QuadraticBending for PlateBending"}
    assert siblings & set(named) == (siblings if element == "P1" else set())
    assert ("pointwise strain of StVK" in named) == (element == "P2")
    for name in siblings & set(named) | {"without PlateBending", "explicit"}:
        built = scene_of(to_toml(named[name].apply(data))).build()
        assert bool(built.system.panel.clamps) == (name == "explicit")
        next(fc.march(*_march(built)))
    assert data["pins"][0]["clamp"]


def make_strip(**changed):
    """Return the scene of a strip of 1 m × 0.2 m between two pinned ends, or with one."""
    data = data_of(load_scene(SCENES / "taut.toml"))
    data["cloth"] |= {"height": 0.2, "h": 0.05}
    data["fabric"] |= {"poisson_ratio": 0.0}
    data["probes"], data["interest"] = [], {"end": ["sag"]}
    return scene_of(to_toml({**data, "pins": [{"where": "left"}, {"where": "right"}], **changed}))


def test_the_predicted_sag_across_is_that_of_the_equilibrium():
    numbers = Numbers.of(make_strip())
    assert numbers.case == "across"
    built = numbers.built
    sag = -fc.equilibrium(built.system, built.state).x[:, 2].min()
    assert numbers.sag * numbers.L == pytest.approx(sag, rel=0.02)


def test_loads_across_or_along_the_cloth():
    one = [{"where": "left"}]
    assert Numbers.of(make_strip(pins=one)).case == "hung"
    along = Numbers.of(make_strip(pins=one, start={"position": ["0", "Y", "-X"]}))
    assert (along.case, along.without_bending()) == ("along", 0.0)
    built = along.built
    hung = fc.equilibrium(built.system, built.state).x[:, 2].min() + 1
    assert along.moved * along.L == pytest.approx(-hung, rel=0.02)


def test_long_damped_steps_have_no_time_error_at_rest():
    numbers = Numbers.of(load_scene(STUDIES / "scenes" / "hanging_strip.toml"))
    assert numbers.time_error(100.0) < 1e-9
    kinds = {one.name: one for one in variants(data_of(numbers.scene), Interest(path=("tip",)))}
    assert predict_change(kinds["dt × 2"], numbers) < 1e-3
    assert predict_change(kinds["explicit"], numbers) == 1.0  # without damping it swings forever


def test_a_scene_without_loads_has_no_predictions():
    scene = make_strip(terms=[{"type": "StVK"}])
    found = variants(data_of(scene), Interest(end=("sag",)))
    assert {predict_change(one, Numbers.of(scene)) for one in found} == {None}


def test_the_reduced_scene_is_within_the_tolerance(tmp_path, monkeypatch):
    arguments = [
        "simplify",
        "--quick",
        "--scene",
        str(SCENES / "taut.toml"),
        "--out",
        str(tmp_path),
    ]
    monkeypatch.setattr(sys, "argv", arguments)
    assert simplify.main() == 0
    data = tomllib.loads((tmp_path / "reduced.toml").read_text())
    assert [term["type"] for term in data["terms"]] == ["StVK", "Gravity"]
    assert (tmp_path / "needs.png").exists()
    assert "| without Gravity | 1 | 1 |" in (tmp_path / "report.md").read_text()
    paths = []
    for path in (SCENES / "taut.toml", tmp_path / "reduced.toml"):
        built = load_scene(path).build()
        run = fc.run(*_march(built), probes=built.probes)
        times = np.linspace(0.01, 0.1, 10)
        paths.append(np.interp(times, run.times, run.observed["middle.z"]))
    change = np.linalg.norm(paths[1] - paths[0]) / np.linalg.norm(paths[0])
    assert 0 < change < 0.01


def _march(built):
    return built.system, built.method, built.state, built.dt, built.t_end


def judge(kind_changes, tolerance=0.01):
    """Return the verdicts on variants of taut.toml with given changes, and the unresolved ones."""
    task = simplify.Task("taut", data_of(load_scene(SCENES / "taut.toml")), tolerance, None)
    found = []
    for variant in variants(task.data, task.interest):
        if variant.name in kind_changes:
            change = kind_changes[variant.name]
            found.append((variant, {"status": "ok", "change": change, "saved": 0.5, "of": "sag"}))
            found[-1][1]["variant"] = variant.name
    verdicts = {variant.name: judge_variant(task, variant, found) for variant, _ in found}
    taken = {variant.name for variant in sort_candidates(task, found)}
    return verdicts, [line["variant"] for line in unresolved_sizes(task, found)], taken


def test_a_scene_that_is_not_resolved_keeps_its_mesh():
    """The finer mesh changes more than the tolerance: a coarser one agrees only by chance."""
    changes = {
        "h × 0.5": 0.02,
        "h × 1.5": 0.0045,
        "h × 2": 0.0023,
        "dt × 0.5": 1e-4,
        "dt × 2": 1e-3,
    }
    verdicts, unresolved, taken = judge(changes)
    assert unresolved == ["h × 0.5"]
    assert verdicts["h × 0.5"] == "NOT RESOLVED"
    assert verdicts["h × 2"] == verdicts["h × 1.5"] == "by chance"
    assert (verdicts["dt × 0.5"], verdicts["dt × 2"]) == ("resolved", "can go")
    assert taken == {"dt × 2"}


def test_a_resolved_scene_may_have_larger_triangles():
    changes = {"h × 0.5": 0.001, "h × 1.5": 0.0045, "h × 2": 0.0023, "without HingeBending": 1e-5}
    verdicts, unresolved, taken = judge(changes)
    assert unresolved == []
    assert verdicts["h × 0.5"] == "resolved"
    assert taken == {"h × 1.5", "h × 2", "without HingeBending"}
    verdicts, _, taken = judge(changes | {"h × 1.5": 0.011})
    assert (verdicts["h × 1.5"], verdicts["h × 2"]) == ("needed", "by chance")
    assert taken == {"without HingeBending"}


def test_a_failing_variant_is_a_row_with_its_cause():
    task = simplify.Task("taut", data_of(load_scene(SCENES / "taut.toml")), 0.01, None)
    row = {"scene": "taut", "variant": "x", "status": "failed", "cause": "it broke"}
    assert task.compare(row)["cause"] == "it broke"
    variant = variants(task.data, task.interest)[0]
    assert sort_candidates(task, [(variant, task.compare(row))]) == []
    assert simplify.parse_tolerance("1%") == simplify.parse_tolerance("0.01") == 0.01
