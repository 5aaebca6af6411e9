"""`front`: the search for the cheapest setting, the limit, the table, and what it answers."""

import math

import pytest
from support.scene_texts import STRIP
from support.strips import TIP, moving_strip, strip

import fecloth as fc
from fecloth.study.fronts.limit import LEAST_PART_OF_ORDER, shrinks
from fecloth.study.fronts.settings import Line, Setting, Settings, make_lines
from fecloth.study.problem import StudyProblem
from fecloth.study.uncertainty import estimate_uncertainty

pytestmark = pytest.mark.usefixtures("counted_work")  # seconds decide


# --- the limit -----------------------------------------------------------------------------------


def values_with(order, levels=4):
    """Values whose error falls with an order from level to level."""
    return [1.0 + 2.0 ** (-order * k) for k in range(levels)]


@pytest.mark.parametrize(("part", "known"), [(1.02, True), (0.98, False)])
def test_changes_shrink_as_the_order_says_from_half_of_it_on(part, known):
    theory = 2.0
    order = part * LEAST_PART_OF_ORDER * theory
    estimate = estimate_uncertainty([8.0, 4.0, 2.0, 1.0], values_with(order), theory)
    assert shrinks(estimate) == known


@pytest.mark.parametrize("values", [[1.0, 2.0, 1.0, 2.0], [1.0, 2.0, 4.0, 8.0]])
def test_values_that_oscillate_or_diverge_have_no_limit(values):
    assert not shrinks(estimate_uncertainty([8.0, 4.0, 2.0, 1.0], values, 2.0))


def test_the_limit_of_a_front_is_the_closed_form():
    """Without a Poisson ratio the end of a strip sinks by ρ g L² / 2Y, for small loads."""

    def sinking(result):
        return float(result.state.x[:, 0].max()) - 1.0

    answer = fc.study.front(strip, sinking, tolerance=0.01, h=0.25, stiffness=2e5, probes=TIP)
    exact = 0.2 * 9.81 / 2 / 2e5
    assert abs(answer.limit.limit - exact) <= answer.limit.uncertainty + 1e-4 * exact
    row = answer.cheapest("1%")
    assert row["at most %"] <= 1.0
    assert row["seconds"] == min(r["seconds"] for r in answer.table if r.get("at most %", 9) <= 1.0)


# --- the result ----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def hanging(counted_work):
    return fc.study.front(strip, "tip.x", tolerance=2e-3, h=0.25, nu=0.3, probes=TIP)


def test_each_row_has_its_setting_its_error_and_its_seconds(hanging):
    rows = [row for row in hanging.table if row["status"] == "ok"]
    size = hanging.size
    for row in rows:
        value = fc.study.sweep(strip, {"h": [row["h"]]}, "tip.x", h=0.25, nu=0.3, probes=TIP)
        error = abs(value.table["tip.x"][0] - hanging.limit.limit)
        assert row["error"] == pytest.approx(error, abs=1e-12)
        assert row["error %"] == pytest.approx(100 * row["error"] / size)
        assert row["seconds"] > 0
    assert max(row["h"] for row in rows) > 0.2  # coarser than half of the cloth's width is


def test_the_cheapest_row_depends_on_the_tolerance(hanging):
    loose, tight = hanging.cheapest(0.05), hanging.cheapest(2e-3)
    assert loose["seconds"] < tight["seconds"]
    assert tight["at most %"] <= 0.2 < loose["at most %"]
    assert hanging.cheapest(1e-12) is None


def test_the_front_is_written_and_drawn(hanging, tmp_path):
    page = hanging.report(tmp_path).read_text()
    assert "Limit: tip.x" in page
    texts = [text.get_text() for text in hanging.figure().axes[0].texts]
    assert any("mm" in text for text in texts)  # the points say h


def test_a_term_that_changes_nothing_is_needless(tmp_path):
    scene = tmp_path / "strip.toml"
    force = ', { type = "PointForce", where = "right", force = [0, 1e-9, 0] }]\npins'
    scene.write_text(STRIP.replace("]\npins", force))
    result = fc.study.front(scene, "tip.x", ["h", "terms"], "1%")
    assert "without PointForce" in result.needless("1%")
    assert "without Gravity" not in result.needless("1%")


# --- settings ------------------------------------------------------------------------------------


def test_the_first_meshes_are_as_coarse_as_the_cloth_allows():
    settings = Settings.of(StudyProblem.of(strip, h=0.05))
    assert settings.coarsest == 0.25  # a quarter of the length, and the width
    line = Line()
    sizes = [settings.choice(Setting(line, i))["h"] for i in range(3)]
    assert sizes == pytest.approx([0.25, 0.25 / math.sqrt(2), 0.125], rel=1e-5)


def test_the_steps_begin_with_four():
    problem = StudyProblem.of(moving_strip, h=0.1, dt=0.1, t_end=1.0)
    settings = Settings.of(problem)
    steps = [1.0 / settings.choice(Setting(Line(), 0, j))["dt"] for j in range(3)]
    assert steps == pytest.approx([4, 8, 16])


def test_a_function_varies_by_its_sizes_and_what_is_asked_for():
    problem = StudyProblem.of(strip, h=0.05)
    assert make_lines(problem, None, None) == [Line()]
    named = make_lines(problem, None, None, patterns=["cross", "right"])
    assert [line.pattern for line in named] == ["cross", "right"]
