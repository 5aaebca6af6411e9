"""`simplify`: changes of results, variants, predictions, resolution, the reduced scene."""

import tomllib
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from support.rundirs import rows_of

import fecloth as fc
from fecloth.cli import main as cli
from fecloth.errors import InputError
from fecloth.scene.probe_tables import Interest
from fecloth.scene.scene import load_scene, scene_of
from fecloth.simulation.quantity_values import RunRecord, relative_difference
from fecloth.study.measured_runs import measure
from fecloth.study.result import read_tolerance
from fecloth.study.scene_problem import SceneProblem
from fecloth.study.simplification.outcome import Findings, Outcome, find_resolutions
from fecloth.study.simplification.result import make_verdict
from fecloth.study.simplification.simplify import combine_variants, simplify
from fecloth.study.simplification.variants import FINER, Variant, list_variants
from studies.simplify.numbers import Numbers
from studies.simplify.predictions import find_limits, predict_change

pytestmark = [pytest.mark.stories, pytest.mark.usefixtures("counted_work")]  # seconds decide
STUDIES = Path(__file__).parents[2] / "studies"
SCENES = STUDIES / "scenes" / "needs"


def make_answer(h, t, columns, u, probes=()):
    cloth = fc.Cloth.rectangle(1.0, 1.0, h, pattern="right")
    columns = {name: np.array(values) for name, values in columns.items()}
    return RunRecord(np.array(t), columns, cloth, {"displacement": u(cloth.X)}, probes)


def changes(full, other, interest):
    return {one.text: relative_difference(one, full, other) for one in interest.all}


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
    data = load_scene(path).to_tables()
    tried = list_variants(data, Interest(end=("displacement",)))
    for variant in tried:
        simpler = variant.apply(data)
        assert simpler != data, variant.name
        scene_of(simpler)
    assert data == load_scene(path).to_tables()  # no variant has changed it
    names = [variant.name for variant in tried]
    assert {"without StVK", "h × 2"} <= set(names)
    rubs = any(term.get("friction") for term in data["terms"])
    assert ("equilibrium" in names) == ("time" in data and not rubs)
    assert ("Springs for StVK" in names) == (data["cloth"].get("element") != "P2")
    assert ("dt × 2" in names) == (
        path.stem not in ("dome", "inflated_disk", "lifted_strip")  # which take one step
    )
    assert "equilibrium" not in [one.name for one in list_variants(data, Interest(path=("sag",)))]


def test_contact_may_lose_its_friction_and_widen_its_gap():
    data = load_scene(STUDIES / "scenes" / "drop.toml").to_tables()
    simpler = {one.name: one.apply(data) for one in list_variants(data, Interest(end=("sag",)))}
    for i, name in ((4, "Obstacle"), (5, "SelfContact")):
        assert data["terms"][i]["type"] == name
        smooth, wider = (simpler[f"{what} {name}"] for what in ("no friction of", "gap × 2 of"))
        assert smooth["terms"][i] == data["terms"][i] | {"friction": 0.0}
        assert wider["terms"][i] == data["terms"][i] | {"gap": 0.002}
        assert len(simpler[f"without {name}"]["terms"]) == len(data["terms"]) - 1
        for changed in (smooth, wider):
            assert [t for k, t in enumerate(changed["terms"]) if k != i] == [
                t for k, t in enumerate(data["terms"]) if k != i
            ]


def test_p2_becomes_p1_and_adaptive_steps_get_a_looser_tolerance():
    data = load_scene(SCENES / "taut.toml").to_tables()
    data["cloth"]["element"], data["mass"], data["terms"] = "P2", "consistent", data["terms"][::2]
    data["time"] = {"method": "bdf2", "dt": "auto", "rtol": 0.01, "t_end": 0.1}
    simpler = {one.name: one.apply(data) for one in list_variants(data, Interest(end=("sag",)))}
    assert simpler["explicit"]["mass"] == simpler["P1 for P2"]["mass"] == "lumped"
    assert simpler["pointwise strain of StVK"]["terms"][0]["strain"] == "pointwise"
    assert not {"Springs for StVK", "HingeBending for PlateBending"} & set(simpler)
    assert scene_of(simpler["rtol × 4"]).time.rtol == 0.04


@pytest.mark.parametrize("element", ["P1", "P2"])
def test_a_plate_becomes_hinges_or_is_left_out_with_its_clamps(element):
    """Each simpler scene can be built and marched by a step."""
    data = make_strip(terms=[{"type": "StVK"}, {"type": "PlateBending"}]).to_tables()
    data["cloth"] |= {"element": element, "h": 0.2}
    data["pins"][0]["clamp"] = True
    tried = list_variants(data, Interest(end=("sag",)))
    named = {one.name: one for one in tried}
    siblings = {"HingeBending for PlateBending", "QuadraticBending for PlateBending"}
    assert siblings & set(named) == (siblings if element == "P1" else set())
    assert ("pointwise strain of StVK" in named) == (element == "P2")
    for name in siblings & set(named) | {"without PlateBending", "explicit"}:
        built = scene_of(named[name].apply(data)).build()
        assert bool(built.system.panel.clamps) == (name == "explicit")
        next(fc.march(*_march(built)))
    assert data["pins"][0]["clamp"]


def make_strip(**changed):
    """Return the scene of a strip of 1 m × 0.2 m between two pinned ends, or with one."""
    data = load_scene(SCENES / "taut.toml").to_tables()
    data["cloth"] |= {"height": 0.2, "h": 0.05}
    data["fabric"] |= {"poisson_ratio": 0.0}
    data["probes"], data["interest"] = [], {"end": ["sag"]}
    return scene_of({**data, "pins": [{"where": "left"}, {"where": "right"}], **changed})


def test_the_predicted_sag_across_is_that_of_the_equilibrium():
    numbers = Numbers.of(make_strip())
    assert numbers.case == "across"
    built = numbers.built
    sag = -fc.equilibrium(built.system, built.start).x[:, 2].min()
    assert numbers.sag * numbers.L == pytest.approx(sag, rel=0.02)


def test_loads_across_or_along_the_cloth():
    one = [{"where": "left"}]
    assert Numbers.of(make_strip(pins=one)).case == "hung"
    along = Numbers.of(make_strip(pins=one, start={"position": ["0", "Y", "-X"]}))
    assert (along.case, along.without_bending()) == ("along", 0.0)
    built = along.built
    hung = fc.equilibrium(built.system, built.start).x[:, 2].min() + 1
    assert along.moved * along.L == pytest.approx(-hung, rel=0.02)


def test_long_damped_steps_have_no_time_error_at_rest():
    numbers = Numbers.of(load_scene(STUDIES / "scenes" / "hanging_strip.toml"))
    assert numbers.time_error(100.0) < 1e-9
    kinds = {
        variant.name: variant
        for variant in list_variants(numbers.scene.to_tables(), Interest(path=("tip",)))
    }
    assert predict_change(kinds["dt × 2"], numbers) < 1e-3
    assert predict_change(kinds["explicit"], numbers) == 1.0  # without damping it swings forever


def test_a_scene_without_loads_has_no_predictions():
    scene = make_strip(terms=[{"type": "StVK"}])
    found = list_variants(scene.to_tables(), Interest(end=("sag",)))
    assert {predict_change(one, Numbers.of(scene)) for one in found} == {None}


def test_the_reduced_scene_is_within_the_tolerance(tmp_path):
    found = simplify(SCENES / "taut.toml", "2%", folder=tmp_path, repeats=1)
    data = tomllib.loads((tmp_path / "reduced.toml").read_text())
    assert [term["type"] for term in data["terms"]] == ["StVK", "Gravity"]
    assert found.scene == tmp_path / "reduced.toml"
    (without,) = [row for row in found.table if row["variant"] == "without Gravity"]
    assert (without["path of middle [%]"], without["verdict"]) == (100, "needed")
    paths = []
    for path in (SCENES / "taut.toml", found.scene):
        built = load_scene(path).build()
        run = fc.run(*_march(built), probes=built.probes)
        times = np.linspace(0.01, 0.1, 10)
        paths.append(np.interp(times, run.times, run.observed["middle.z"]))
    change = np.linalg.norm(paths[1] - paths[0]) / np.linalg.norm(paths[0])
    assert 0 < change < 0.02
    assert 0 < found.change < 0.02
    assert found.resolved


def _march(built):
    return built.system, built.method, built.start, built.dt, built.t_end


ORDERS = {"sag": {"mesh": 2.0, "dt": 2.0}}


def judge(kind_changes, tolerance=0.01):
    """Return the verdicts on variants of taut.toml with given changes, the words, the taken."""
    data = load_scene(SCENES / "taut.toml").to_tables()
    found = [
        (variant, Outcome(variant.name, "ok", changes={"sag": kind_changes[name]}, saved=0.5))
        for variant in list_variants(data, Interest(path=("middle",)))
        if (name := variant.name) in kind_changes
    ]
    checks = [trial for trial in found if trial[0].is_check]
    resolutions = find_resolutions(checks, ORDERS, tolerance)
    findings = Findings(found, tolerance, resolutions)
    verdicts = {variant.name: findings.judge(variant, outcome) for variant, outcome in found}
    taken = {variant.name for variant in findings.candidates()}
    words = make_verdict(findings, "", None)
    return verdicts, words.splitlines(), taken


def test_a_scene_that_is_not_resolved_keeps_its_mesh():
    """The finer mesh changes more than the tolerance: a coarser one agrees only by chance."""
    changes = {
        "h × 0.5": 0.03,
        "h × 1.5": 0.0045,
        "h × 2": 0.0023,
        "dt × 0.5": 1e-4,
        "dt × 2": 1e-3,
    }
    verdicts, words, taken = judge(changes)
    assert words[0] == (
        "not resolved to 1 %: the error of the mesh is about 4 % (sag); h of about 0.05 m in "
        "place of 0.1 m would do"
    )
    assert verdicts["h × 0.5"] == "not resolved"
    assert verdicts["h × 2"] == verdicts["h × 1.5"] == "by chance"
    assert (verdicts["dt × 0.5"], verdicts["dt × 2"]) == ("resolved", "not needed")
    assert taken == {"dt × 2"}


def test_an_error_above_the_tolerance_whose_change_is_below_it_is_not_resolved():
    """Half of h shows three quarters of the error: 0.9 % of 1.2 %."""
    verdicts, words, taken = judge({"h × 0.5": 0.009, "h × 1.5": 0.008})
    assert words[0].startswith("not resolved to 1 %: the error of the mesh is about 1.2 %")
    assert (verdicts["h × 1.5"], taken) == ("by chance", set())


def test_changes_are_combined_while_they_stay_within_the_tolerance():
    """The first two together do; the third adds too much, the fourth makes the scene slower."""
    changes, seconds = {"a": 4e-3, "b": 5e-3, "c": 2e-3, "d": 0.0}, dict.fromkeys("abc", -0.2)

    def run_one(name, change):
        parts = name.split(" + ")
        total = sum(changes[one] for one in parts)
        spent = 1 + sum(seconds.get(one, 0.5) for one in parts)
        return Outcome(name, "ok", changes={"sag": total}, seconds=spent, saved=1 - spent)

    whole = {"cpu_seconds": 1.0}
    original = SimpleNamespace(full=whole, tolerance=0.01, run_one=run_one)
    tried = [Variant(x, "without", x, x, lambda data, x=x: data | {x: 1}) for x in "abcd"]
    change, attempts = combine_variants(original, tried)
    assert change.apply({}) == {"a": 1, "b": 1}
    assert [(one.name, fits) for one, fits in attempts] == [
        ("a", True),
        ("a + b", True),
        ("a + b + c", False),
        ("a + b + d", False),
    ]


def test_a_resolved_scene_may_have_larger_triangles():
    changes = {"h × 0.5": 0.001, "h × 1.5": 0.0045, "h × 2": 0.0023, "without HingeBending": 1e-5}
    verdicts, words, taken = judge(changes)
    assert (
        words[0] == "not needed: HingeBending (changes sag by 0.001 %, costs 50 % of the seconds)"
    )
    assert verdicts["h × 0.5"] == "resolved"
    assert taken == {"h × 1.5", "h × 2", "without HingeBending"}
    verdicts, _, taken = judge(changes | {"h × 1.5": 0.011})
    assert (verdicts["h × 1.5"], verdicts["h × 2"]) == ("needed", "by chance")
    assert taken == {"without HingeBending"}


@pytest.mark.parametrize("order", [1.0, 2.0, 4.0])
def test_the_size_that_would_do_has_the_error_of_the_tolerance(order):
    """Of values 1 + c hᵖ the error of every h is known."""
    h, c, tolerance = 0.1, 3.0, 1e-5

    def value(size):
        return 1 + c * size**order

    check = Variant("h × 0.5", "mesh", FINER, "mesh", dict, is_check=True, size=h)
    run = Outcome("h × 0.5", "ok", changes={"sag": abs(value(h / 2) - value(h))})
    (found,) = find_resolutions([(check, run)], {"sag": {"mesh": order}}, tolerance)
    assert found.error == pytest.approx(value(h) - 1, rel=1e-9)
    assert value(found.needed) - 1 == pytest.approx(tolerance, rel=1e-9)
    assert not found.is_resolved
    failed = Outcome("h × 0.5", "failed", "Newton's method failed")
    (found,) = find_resolutions([(check, failed)], {}, tolerance)
    assert not found.is_resolved
    assert "is not known: h × 0.5: Newton's method failed" in str(found)


def outcome_of(seconds, whole, name="x"):
    return Outcome(name, "ok", changes={"sag": 1e-3}, seconds=seconds, saved=1 - seconds / whole)


@pytest.mark.parametrize(("part", "slower"), [(0.8, False), (1.25, True)])
def test_a_run_is_slower_that_takes_five_per_cent_and_20_ms_more(part, slower):
    for seconds, whole in ((1000.0 + part * 50.0, 1000.0), (1e-3 + part * 0.02, 1e-3)):
        outcome = outcome_of(seconds, whole)
        assert outcome.whole == pytest.approx(whole)
        assert outcome.is_slower == slower
        findings = Findings([(Variant("x", "without", "x", "x", dict), outcome)], 0.01)
        assert findings.judge(*findings.trials[0]).endswith("saves nothing") == slower
        assert bool(findings.candidates()) != slower  # a term may go that saves nothing


@pytest.mark.parametrize(("saved", "is_candidate"), [(0.05 * 0.8, False), (0.05 * 1.25, True)])
def test_a_cheaper_term_must_save_five_per_cent(saved, is_candidate):
    variant = Variant("y for x", "cheaper", "y", "x", dict)
    findings = Findings([(variant, outcome_of(1 - saved, 1.0))], 0.01)
    assert bool(findings.candidates()) == is_candidate


@pytest.mark.parametrize(
    ("kinds", "seconds", "fits"),
    [
        ("without", 1.0 + 0.07 * 0.8, True),  # 5 % and 20 ms
        ("without", 1.0 + 0.07 * 1.25, False),
        ("cheaper", 1.0 + 0.05 * 0.8, True),
        ("cheaper", 1.0 + 0.05 * 1.25, False),
        ("cheaper cheaper", 1.0 - 0.05 * 1.25, True),  # in place of the first, which takes 1 s
        ("cheaper cheaper", 1.0 - 0.05 * 0.8, False),
        ("without cheaper", 0.1, None),  # what is left out is not replaced
    ],
)
def test_a_change_is_taken_that_costs_nothing_and_a_second_one_of_its_part_that_saves(
    kinds, seconds, fits
):
    names = [f"{kind} {k}" for k, kind in enumerate(kinds.split())]
    spent = dict.fromkeys(names, 1.0) | {names[-1]: seconds}

    def run_one(name, change):
        return outcome_of(spent[name], 1.0, name)

    original = SimpleNamespace(full={"cpu_seconds": 1.0}, tolerance=0.01, run_one=run_one)
    variants = [Variant(name, name.split()[0], "x", "x", lambda data: data) for name in names]
    _, attempts = combine_variants(original, variants)
    taken = {outcome.name: fits for outcome, fits in attempts}
    assert taken.get(names[-1]) == fits


def test_a_failing_variant_is_no_candidate():
    variant = list_variants(load_scene(SCENES / "taut.toml").to_tables(), Interest(end=("sag",)))[0]
    failed = (variant, Outcome("x", "failed", "it broke"))
    findings = Findings([failed], 0.01)
    assert findings.candidates() == []
    assert findings.judge(*failed) == "needed"


STATIC = """
title = "a hanging strip"
cloth = { shape = "rectangle", width = 1.0, height = 0.25, h = 0.125, pattern = "right" }
fabric = { areal_density = 0.2, tensile_stiffness = 20.0, bending_rigidity = 1e-5 }
terms = [
  { type = "StVK" }, { type = "HingeBending" },
  { type = "Gravity", acceleration = [9.81, 0, 0] }, { type = "MassDamping", rate = 1.0 },
]
pins = [{ where = "left" }]
equilibrium = { load_steps = 2 }
interest = { quantities = ["displacement"] }
"""


@pytest.fixture
def static(tmp_path):
    file = tmp_path / "strip.toml"
    file.write_text(STATIC)
    return file


def test_a_static_scene(static):
    """Bending and damping do nothing to it; the error of its mesh is that against h/8."""
    found = simplify(static, 0.01, repeats=1)
    rows = {row["variant"]: row for row in found.table}
    for name in ("without HingeBending", "without MassDamping", "one load step"):
        assert rows[name]["change [%]"] < 1e-4, name
    assert rows["without Gravity"]["verdict"] == "needed"
    assert "dt × 2" not in rows
    reduced = tomllib.loads(found.reduced)
    assert "time" not in reduced
    assert "HingeBending" not in [term["type"] for term in reduced["terms"]]
    ends = [_solve(static, h) for h in (0.125, 0.125 / 8)]
    apart = ends[0][0].l2_difference(ends[1][0], ends[0][1], ends[1][1])
    size = ends[1][0].l2_difference(ends[1][0], ends[1][1], 0 * ends[1][1])
    line = found.verdict.splitlines()[0]
    assert line.startswith("not resolved to 1 %: the error of the mesh is about")
    estimated = float(line.split("about ")[1].split(" %")[0]) / 100
    assert estimated == pytest.approx(apart / size, rel=0.05)


def _solve(scene, h):
    built = load_scene(scene, [f"cloth.h={h}"]).build()
    end = fc.equilibrium(built.system, built.start)
    return built.cloth, end.x - built.start.x


def test_an_equilibrium_in_place_of_a_motion_to_rest_is_a_scene():
    """It has the same end; the motion would have to last for ever."""
    data = make_strip(terms=[{"type": "StVK"}, {"type": "Gravity"}]).to_tables()
    data["cloth"]["h"] = 0.1
    named = {one.name: one for one in list_variants(data, Interest(end=("sag",)))}
    setup = SceneProblem(scene_of(named["equilibrium"].apply(data)), "strip").setup()
    moved = measure(setup, [])["displacement"]
    expected = fc.equilibrium(setup.system, setup.start).x - setup.start.x
    np.testing.assert_allclose(moved, expected, atol=1e-9)


def test_what_the_predictions_do_not_cover_is_said():
    assert find_limits(Numbers.of(make_strip())) == []
    bent = make_strip(start={"position": ["X", "Y", "0.1*X**2"]})
    assert find_limits(Numbers.of(bent)) == ["the cloth does not start flat"]
    assert find_limits(Numbers.of(make_strip(terms=[{"type": "StVK"}]))) == [
        "no load acts at the start"
    ]


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"tolerance": "0%"}, "must lie between 0 and 100 %"),
        ({"tolerance": "much"}, "tolerance = much"),
        ({"quantity": "tipp.z"}, "unknown quantity"),
        ({"quantity": len}, "a function as quantity"),
        ({"quantity": "sag"}, "sag = 0: cannot show what changes it"),
        ({"most_seconds": 1e-3}, "predicted time above"),
    ],
)
def test_mistakes(static, more, message):
    with pytest.raises(InputError, match=message):
        simplify(static, **more)


def test_tolerances_are_numbers_or_percent():
    assert read_tolerance("1%") == read_tolerance("0.01") == read_tolerance(0.01) == 0.01


def test_the_command(static, tmp_path, capsys):
    """Its folder has the reduced scene, the page, the rows and the figure."""
    folder = tmp_path / "out"
    arguments = ["simplify", str(static), "--tolerance", "0.1%", "-o", str(folder)]
    assert cli.main(arguments) == 0
    first = capsys.readouterr().out.splitlines()[0]
    assert first.startswith("not resolved to 0.1 %: the error of the mesh is about")
    rows = rows_of(folder / "results.csv")
    assert {row["verdict"] for row in rows} >= {"needed", "not needed", "not resolved"}
    assert all(row["status"] == "ok" for row in rows if row["verdict"] != "needed")
    load_scene(folder / "reduced.toml").build()
    for name in ("report.html", "figure.png", "figure.svg"):
        assert (folder / name).stat().st_size > 1000
    assert str(tmp_path) not in (folder / "report.html").read_text()


def test_a_membrane_with_a_rest_of_its_own_may_become_springs():
    cloth = {"element": "P1", "h": 0.1}
    listed = [{"type": "BaraffWitkin", "rest": [0.9, 1.0]}, {"type": "HingeBending", "rest": 0.1}]
    data = {"cloth": cloth, "terms": listed, "equilibrium": {}}
    names = [one.name for one in list_variants(data, Interest(end=("sag",)))]
    assert "Springs for BaraffWitkin" in names
    assert "QuadraticBending for HingeBending" not in names
