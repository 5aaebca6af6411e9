"""`simplify`: variants, resolution, verdicts, the reduced scene."""

import tomllib
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import fecloth as fc
from fecloth.scene.scene import load_scene, scene_of
from fecloth.simulation.quantity import parse_quantity
from fecloth.simulation.quantity_values import relative_difference
from fecloth.study.command import StudyFailed
from fecloth.study.measured_runs import measure
from fecloth.study.problem import StudyProblem
from fecloth.study.simplification_result import Trial, describe_trials
from fecloth.study.simplifying import combine, is_worth, judge, simplify
from fecloth.study.term_variants import Variant, list_variants, simpler_steps, simpler_terms
from studies.evidence.simplify.numbers import Numbers

pytestmark = [pytest.mark.stories, pytest.mark.usefixtures("counted_work")]  # seconds decide
STUDIES = Path(__file__).parents[2] / "studies"
SCENES = STUDIES / "scenes" / "needs"


def variants_of(scene, quantity="sag"):
    """Return the variants of a scene by their names, and its problem."""
    problem = StudyProblem.of(scene)
    listed = list_variants(problem, [parse_quantity(quantity)])
    return {variant.name: variant for variant in listed}, problem


def changes(full, other, interest):
    return {each.text: relative_difference(each, full, other) for each in interest.all}


@pytest.mark.parametrize("name", ["needs/taut", "needs/cantilever", "needs/wind", "drop", "dome"])
def test_every_simpler_scene_is_a_scene(name):
    named, problem = variants_of(STUDIES / "scenes" / f"{name}.toml")
    data = problem.tables
    for variant in named.values():
        simpler = problem.at(variant.values).tables
        assert simpler != data, variant.name
    assert {"without StVK", "h × 2", "h × 0.5", "Springs for StVK"} <= named.keys()
    rubs = any(term.get("friction") for term in data["terms"])
    assert ("equilibrium" in named) == ("time" in data and not rubs)
    assert ("dt × 2" in named) == (name != "dome")  # which takes one step
    paths = [parse_quantity("path of sag")]
    assert "equilibrium" not in [variant.name for variant in simpler_steps(problem, paths)]


def test_contact_may_lose_its_friction_and_widen_its_gap():
    named, problem = variants_of(STUDIES / "scenes" / "drop.toml")
    terms = problem.tables["terms"]
    for i, name in ((4, "Obstacle"), (5, "SelfContact")):
        changed = {
            f"no friction of {name}": [terms[i] | {"friction": 0.0}],
            f"gap × 2 of {name}": [terms[i] | {"gap": 0.002}],
            f"without {name}": [],
        }
        for variant, term in changed.items():
            simpler = problem.at(named[variant].values).tables["terms"]
            assert simpler == [*terms[:i], *term, *terms[i + 1 :]], variant
            assert named[variant].slot == f"terms.{i}"


def test_p2_becomes_p1_and_adaptive_steps_get_a_looser_tolerance():
    data = load_scene(SCENES / "taut.toml").to_tables()
    data["cloth"]["element"], data["mass"], data["terms"] = "P2", "consistent", data["terms"][::2]
    data["time"] = {"method": "bdf2", "dt": "auto", "rtol": 0.01, "t_end": 0.1}
    named, problem = variants_of(scene_of(data))
    scenes = {name: problem.at(variant.values).tables for name, variant in named.items()}
    assert scenes["explicit"]["mass"] == scenes["P1 for P2"]["mass"] == "lumped"
    assert scenes["pointwise strain of StVK"]["terms"][0]["strain"] == "pointwise"
    assert not {"Springs for StVK", "dt × 2"} & set(named)
    assert scenes["rtol × 4"]["time"]["rtol"] == 0.04
    assert scenes["rtol × 0.25"]["time"]["rtol"] == 0.0025


@pytest.mark.parametrize("element", ["P1", "P2"])
def test_a_plate_becomes_hinges_or_is_left_out_with_its_clamps(element):
    """Each simpler scene can be built and marched by a step."""
    data = make_strip(terms=[{"type": "StVK"}, {"type": "PlateBending"}]).to_tables()
    data["cloth"] |= {"element": element, "h": 0.2}
    data["pins"][0]["clamp"] = True
    named, problem = variants_of(scene_of(data))
    siblings = {"HingeBending for PlateBending", "QuadraticBending for PlateBending"}
    assert siblings & set(named) == (siblings if element == "P1" else set())
    for name in siblings & set(named) | {"without PlateBending", "explicit"}:
        built = problem.at(named[name].values).source.scene.build()
        assert bool(built.system.panel.clamps) == (name == "explicit")
        next(fc.march(*_march(built)))
    assert problem.tables["pins"][0]["clamp"]


def test_variants_of_two_terms_are_combined_by_their_values():
    named, problem = variants_of(SCENES / "taut.toml")
    names = ("without HingeBending", "Springs for StVK", "h × 2", "dt × 4")
    values = {key: value for name in names for key, value in named[name].values.items()}
    data = problem.at(values).tables
    assert [term["type"] for term in data["terms"]] == ["Springs", "Gravity"]
    assert (data["cloth"]["h"], data["time"]["dt"]) == (0.2, 0.1 / 12)
    assert {v.leaves_out_membrane for v in simpler_terms(problem) if v.by == "StVK"} == {True}
    assert not any(v.leaves_out_membrane for v in simpler_terms(problem) if v.by != "StVK")


def test_a_scene_without_a_term_expects_none_of_its_columns():
    data = load_scene(SCENES / "taut.toml").to_tables()
    data["expect"] = {"HingeBending": {"value": 0.0, "absolute": 1.0}}
    named, problem = variants_of(scene_of(data))
    problem.at(named["without HingeBending"].values).setup()
    problem.at(named["QuadraticBending for HingeBending"].values).setup()


def test_a_bent_rest_shape_is_not_replaced_and_a_stretched_one_is():
    terms = [{"type": "BaraffWitkin", "rest": [0.9, 1.0]}, {"type": "HingeBending", "rest": 0.1}]
    names = variants_of(make_strip(terms=terms))[0].keys()
    assert "Springs for BaraffWitkin" in names
    assert "QuadraticBending for HingeBending" not in names


def test_pins_that_move_and_friction_have_no_equilibrium_of_their_own():
    assert "equilibrium" in variants_of(make_strip())[0]
    moving = make_strip(pins=[{"where": "left", "motion": ["0", "0", "0.1*t"]}])
    assert "equilibrium" not in variants_of(moving)[0]


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


def test_the_reduced_scene_is_within_the_tolerance(tmp_path):
    result = simplify(SCENES / "taut.toml", "2%", folder=tmp_path, repeats=1)
    data = tomllib.loads((tmp_path / "reduced.toml").read_text())
    assert [term["type"] for term in data["terms"]] == ["StVK", "Gravity"]
    assert result.scene == tmp_path / "reduced.toml"
    (without,) = [row for row in result.table if row["variant"] == "without Gravity"]
    assert (without["path of middle [%]"], without["verdict"]) == (100, "needed")
    paths = []
    for path in (SCENES / "taut.toml", result.scene):
        built = load_scene(path).build()
        run = fc.run(*_march(built), probes=built.probes)
        times = np.linspace(0.01, 0.1, 10)
        paths.append(np.interp(times, run.times, run.observed["middle.z"]))
    change = np.linalg.norm(paths[1] - paths[0]) / np.linalg.norm(paths[0])
    assert 0 < change < 0.02
    assert 0 < result.change < 0.02
    assert result.resolved


def _march(built):
    return built.system, built.method, built.start, built.dt, built.t_end


def original_of(tolerance=0.01, order=2.0, **more):
    """Return what `judge` and `combine` need of the run of a problem of one second."""
    problem = SimpleNamespace(orders=lambda quantity: (order, order))
    quantities = (parse_quantity("sag"),)
    return SimpleNamespace(
        tolerance=tolerance, seconds=1.0, quantities=quantities, row={"problem": problem}, **more
    )


def trial_of(variant, change, seconds=0.5, verdict=""):
    cells = {"cpu_seconds": seconds, "saved [%]": 100 * (1 - seconds), "status": "ok"}
    words = f"changes sag by {100 * change:g} %"
    return Trial(variant, {"sag": change}, cells, words, verdict)


def judge_changes(changes, tolerance=0.01):
    """Return the verdicts on variants of taut.toml with given changes, and the words."""
    named, _ = variants_of(SCENES / "taut.toml")
    trials = [trial_of(named[name], change) for name, change in changes.items()]
    judged = judge(trials, original_of(tolerance))
    verdicts = {trial.variant.name: trial.verdict for trial in judged}
    return verdicts, describe_trials(judged, tolerance)


def test_a_scene_that_is_not_resolved_keeps_its_mesh():
    """The finer mesh changes more than the tolerance: a coarser one agrees only by chance."""
    changes = {"h × 0.5": 0.03, "h × 1.5": 0.0045, "h × 2": 0.0023, "dt × 0.5": 1e-4}
    verdicts, words = judge_changes(changes | {"dt × 2": 1e-3})
    assert words[0] == (
        "not resolved to 1 %: the error of the mesh is about 4 % (sag); h of about 0.05 m in "
        "place of 0.1 m would do"
    )
    assert verdicts["h × 0.5"] == "not resolved"
    assert verdicts["h × 2"] == verdicts["h × 1.5"] == "by chance"
    assert (verdicts["dt × 0.5"], verdicts["dt × 2"]) == ("resolved", "not needed")


def test_a_resolved_scene_may_have_larger_triangles():
    changes = {"h × 0.5": 0.001, "h × 1.5": 0.0045, "h × 2": 0.0023, "without HingeBending": 1e-5}
    verdicts, words = judge_changes(changes | {"without Gravity": 0.5, "explicit": 0.2})
    assert words == [
        "not needed: HingeBending (changes sag by 0.001 %)",
        "can be cheaper: h × 2 (changes sag by 0.23 %), h × 1.5 (changes sag by 0.45 %)",
        "needed: Gravity (changes sag by 50 %)",
        "changes too much: explicit (changes sag by 20 %)",
    ]
    assert verdicts["h × 0.5"] == "resolved"
    assert verdicts["h × 1.5"] == verdicts["h × 2"] == "not needed"
    verdicts, _ = judge_changes(changes | {"h × 1.5": 0.011})
    assert (verdicts["h × 1.5"], verdicts["h × 2"]) == ("needed", "by chance")


@pytest.mark.parametrize("order", [1.0, 2.0, 4.0])
def test_the_size_that_would_do_has_the_error_of_the_tolerance(order):
    """Of values 1 + c hᵖ the error of every h is known."""
    h, c, tolerance = 0.1, 3.0, 1e-5
    variant = Variant("h × 0.5", "mesh", {}, "h", 0.5, size=h)
    check = trial_of(variant, c * h**order - c * (h / 2) ** order)
    (judged,) = judge([check], original_of(tolerance, order))
    assert judged.verdict == "not resolved"
    error, would_do = judged.words.split("; ")
    stated = float(error.split("about ")[1].split(" %")[0]) / 100
    assert stated == pytest.approx(c * h**order, rel=0.05)  # of two digits
    needed = float(would_do.split("about ")[1].split(" m")[0])
    assert c * needed**order == pytest.approx(tolerance, rel=0.05 * order)
    (judged,) = judge([check], original_of(1.01 * c * h**order, order))
    assert judged.verdict == "resolved"
    failed = Trial(variant, {}, {"status": "failed", "cause": "x"}, words="failed: x")
    (judged,) = judge([failed], original_of())
    assert judged.verdict == "not resolved"
    assert judged.words == "the error of the mesh is not known: h × 0.5 failed: x"


def test_changes_are_combined_while_they_stay_within_the_tolerance():
    """The first two together do; the third adds too much, the fourth saves no seconds."""
    changes, seconds = {"a": 4e-3, "b": 5e-3, "c": 2e-3, "d": 0.0}, dict.fromkeys("abc", -0.2)

    def run(variants):
        parts = variants[0].name.split(" + ")
        total = sum(changes[part] for part in parts)
        spent = 1 + sum(seconds.get(part, 0.0) for part in parts)
        return [trial_of(variants[0], total, spent)]

    variants = [Variant(name, name, {name: 1}, "h") for name in "abcd"]
    saved = dict(zip("abcd", (0.9, 0.8, 0.1, 1e-20), strict=True))  # the order of trying
    alone = [trial_of(v, changes[v.name], 1 - saved[v.name], "not needed") for v in variants]
    alone[0].cells["cpu_seconds"] = 0.8
    taken, combinations = combine(original_of(run=run), alone)
    assert [variant.name for variant in taken] == ["a", "b"]
    assert [(trial.variant.name, trial.verdict) for trial in combinations] == [
        ("a + b", "combined"),
        ("a + b + c", "combined, not taken"),
        ("a + b + d", "combined, not taken"),
    ]
    assert combinations[0].variant.values == {"a": 1, "b": 1}


def test_a_better_variant_of_a_slot_takes_its_place_unless_a_term_is_left_out():
    def run(variants):
        raise AssertionError  # each has run alone

    first, second = (Variant(name, "mesh", {}, "h") for name in ("h × 1.5", "h × 2"))
    better = trial_of(second, 5e-3, 0.4, "not needed")
    dropped = Variant("without x", "mesh", {}, "without", "x")
    for variant, taken in ((first, second), (dropped, dropped)):
        trials = [trial_of(variant, 1e-4, 0.6, "not needed"), better]
        assert combine(original_of(run=run), trials)[0] == [taken]


@pytest.mark.parametrize(("saved", "is_saving"), [(0.05 * 0.8, False), (0.05 * 1.25, True)])
def test_a_cheaper_term_must_save_five_per_cent_and_a_dropped_one_nothing(saved, is_saving):
    cheaper = Variant("y for x", "x", {}, "cheaper", "y")
    dropped = Variant("without x", "x", {}, "without", "x")
    for variant, verdict in ((cheaper, is_saving), (dropped, True)):
        trial = trial_of(variant, 1e-3, 1 - saved)
        assert is_worth(variant, trial, 1.0, 0.01) == verdict
        (judged,) = judge([trial], original_of())
        assert (judged.verdict == "not needed") == verdict
        assert not is_worth(variant, trial_of(variant, 0.011, 0.1), 1.0, 0.01)


def test_a_failing_variant_is_needed():
    variant = Variant("without x", "x", {}, "without", "x")
    failed = Trial(variant, {}, {"status": "failed", "cause": "it broke"}, "failed: it broke")
    judged = judge([failed], original_of())
    assert judged[0].verdict == "needed"
    assert combine(original_of(), judged) == ([], [])
    assert not is_worth(variant, failed, 1.0, 0.01)


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
    result = simplify(static, 0.01, repeats=1)
    rows = {row["variant"]: row for row in result.table}
    for name in ("without HingeBending", "without MassDamping", "one load step"):
        assert rows[name]["change [%]"] < 1e-4, name
    assert rows["without Gravity"]["verdict"] == "needed"
    assert "dt × 2" not in rows
    reduced = tomllib.loads(result.reduced)
    assert "time" not in reduced
    assert "HingeBending" not in [term["type"] for term in reduced["terms"]]
    ends = [_solve(static, h) for h in (0.125, 0.125 / 8)]
    apart = ends[0][0].l2_difference(ends[1][0], ends[0][1], ends[1][1])
    size = ends[1][0].l2_difference(ends[1][0], ends[1][1], 0 * ends[1][1])
    line = result.verdict.splitlines()[0]
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
    named, problem = variants_of(scene_of(data))
    setup = problem.at(named["equilibrium"].values).setup()
    moved = measure(setup, [])["displacement"]
    expected = fc.equilibrium(setup.system, setup.start).x - setup.start.x
    np.testing.assert_allclose(moved, expected, atol=1e-9)


def test_a_scene_that_fails_itself_ends_the_study(static):
    static.write_text(STATIC.replace("tensile_stiffness = 20.0", "tensile_stiffness = 1e-6"))
    with pytest.raises(StudyFailed, match="the scene itself fails"):
        simplify(static)
