"""`front`: the search for the cheapest setting, the limit, the table, and what it answers."""

import itertools
import math
from dataclasses import dataclass, field

import numpy as np
import pytest

import fecloth as fc
from fecloth.study.fronts.bench import SHORTEST_LIMIT
from fecloth.study.fronts.limit import LEAST_PART_OF_ORDER, shrinks
from fecloth.study.fronts.search import Search
from fecloth.study.fronts.settings import Line, Setting, Settings, make_lines
from fecloth.study.problem import StudyProblem
from fecloth.study.uncertainty import estimate_uncertainty

pytestmark = pytest.mark.usefixtures("counted_work")  # seconds decide


def strip(h, stiffness=20.0, pattern="right"):
    """A strip that hangs in its plane."""
    cloth = fc.Cloth.rectangle(1.0, 0.25, h, pattern=pattern)
    terms = [fc.StVK(), fc.Gravity((9.81, 0, 0))]
    system = fc.System(cloth, fc.Fabric(0.2, stiffness, 0.3), terms, pins=["left"])
    return cloth, system, None, system.rest()


TIP = (fc.Probe("tip", "right"),)


# --- the search, on power laws -------------------------------------------------------------------


@dataclass(eq=False)
class PowerLaws:
    """A bench whose settings have the error a h^p + b dt^q and the seconds c h^-2 dt^-1."""

    in_space: float
    in_time: float
    speeds: dict[str, float]
    left: float = math.inf
    seconds: float = math.inf
    quantities: tuple = ("tip",)
    rows: dict = field(default_factory=dict)
    settings: Settings = field(
        default_factory=lambda: Settings(StudyProblem.of(motion, h=0.1, dt=0.1, t_end=1.0), 0.25)
    )

    def sizes(self, setting):
        return 2 ** (-setting.i / 2), 2.0**-setting.j

    def error(self, setting):
        h, dt = self.sizes(setting)
        return self.in_space * h**2 + self.in_time * dt**2

    def seconds_of(self, setting):
        h, dt = self.sizes(setting)
        return 0.01 * self.speeds[setting.line.method] / (h**2 * dt)

    def run(self, setting, most=math.inf):
        row = {"status": "ok", "cpu_seconds": self.seconds_of(setting), "setting": setting}
        if row["cpu_seconds"] > most:
            return {"status": "time limit", "cause": "late"}
        self.rows[setting] = row
        self.left -= row["cpu_seconds"]
        return row

    def is_ok(self, setting):
        return self.rows.get(setting, {}).get("status") == "ok"

    def took(self, setting):
        return self.rows[setting]["cpu_seconds"]

    def allows(self, seconds):
        return seconds <= max(self.left / 3, SHORTEST_LIMIT)


class KnownLimit:
    """A limit of which each row knows its distance."""

    def __init__(self, bench, uncertainty=0.0):
        self.bench = bench
        self.uncertainty = np.array([uncertainty])

    def error(self, row):
        return np.array([self.bench.error(row["setting"])])


def motion(h, dt):
    """The strip, in time."""
    cloth, system, _, start = strip(h)
    return cloth, system, fc.BDF2(), start


def cheapest_of_all(bench, tolerance, uncertainty=0.0):
    """The least seconds of all settings up to 14 refinements of each size."""
    settings = (
        Setting(Line(method), i, j)
        for method, i, j in itertools.product(bench.speeds, range(14), range(14))
    )
    met = [s for s in settings if bench.error(s) + uncertainty <= tolerance]
    return min(map(bench.seconds_of, met))


@pytest.mark.parametrize("tolerance", [0.3, 0.01, 0.003])
@pytest.mark.parametrize(("in_space", "in_time"), [(1.0, 1.0), (1.0, 0.01), (0.02, 1.0)])
def test_the_search_finds_the_cheapest_of_all_settings(in_space, in_time, tolerance):
    bench = PowerLaws(in_space, in_time, {"bdf2": 1.0, "newmark": 3.0})
    search = Search(bench, KnownLimit(bench), tolerance)
    search.add_lines([Line("newmark"), Line("bdf2")])
    assert search.run() == ""
    assert bench.took(search.cheapest) == cheapest_of_all(bench, tolerance)
    assert search.error(search.cheapest) <= tolerance
    most = 4 * bench.took(search.cheapest)
    assert all(row["cpu_seconds"] <= most for row in bench.rows.values())  # dear ones did not run


def test_a_search_ends_when_its_time_is_up_and_says_what_is_next():
    bench = PowerLaws(1.0, 1.0, {"bdf2": 100.0}, left=30.0)
    search = Search(bench, KnownLimit(bench), 1e-6)
    search.add_lines([Line("bdf2")])
    assert search.run() == "the time is up"
    assert search.cheapest is None
    assert search.next not in bench.rows
    assert bench.left > 0


def test_a_setting_that_takes_longer_than_expected_waits_for_cheaper_ones():
    """The line "newmark" is 1000 times slower: it is cut off, and its time is not spent."""
    bench = PowerLaws(1.0, 1.0, {"bdf2": 1.0, "newmark": 1000.0})
    search = Search(bench, KnownLimit(bench), 0.05)
    search.add_lines([Line("newmark"), Line("bdf2")])
    assert search.run() == ""
    assert {setting.line.method for setting in bench.rows} == {"bdf2"}


def test_only_settings_within_the_longest_time_count():
    bench = PowerLaws(1.0, 1.0, {"bdf2": 1.0})
    search = Search(bench, KnownLimit(bench), 0.01, longest=0.5)
    search.add_lines([Line("bdf2")])
    search.run()
    assert search.cheapest is None
    assert all(row["cpu_seconds"] <= 4 * 0.5 for row in bench.rows.values())


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

    def soft(h):
        cloth = fc.Cloth.rectangle(1.0, 0.25, h, pattern="right")
        terms = [fc.StVK(), fc.Gravity((9.81, 0, 0))]
        system = fc.System(cloth, fc.Fabric(0.2, 2e5, 0.0), terms, pins=["left"])
        return cloth, system, None, system.rest()

    def sinking(result):
        return float(result.state.x[:, 0].max()) - 1.0

    answer = fc.study.front(soft, sinking, tolerance=0.01, h=0.25, probes=TIP)
    exact = 0.2 * 9.81 / 2 / 2e5
    assert abs(answer.limit.limit - exact) <= answer.limit.uncertainty + 1e-4 * exact
    row = answer.cheapest("1%")
    assert row["at most %"] <= 1.0
    assert row["seconds"] == min(r["seconds"] for r in answer.table if r.get("at most %", 9) <= 1.0)


# --- the result ----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def hanging(counted_work):
    return fc.study.front(strip, "tip.x", tolerance=2e-3, h=0.25, probes=TIP)


def test_each_row_has_its_setting_its_error_and_its_seconds(hanging):
    rows = [row for row in hanging.table if row["status"] == "ok"]
    size = hanging.size
    for row in rows:
        value = fc.study.sweep(strip, {"h": [row["h"]]}, "tip.x", h=0.25, probes=TIP)
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
    scene.write_text(
        'cloth = { shape = "rectangle", width = 1.0, height = 0.25, h = 0.1, pattern = "right" }\n'
        "fabric = { areal_density = 0.2, tensile_stiffness = 20.0, poisson_ratio = 0.3 }\n"
        'terms = [{ type = "StVK" }, { type = "Gravity", acceleration = [9.81, 0, 0] },'
        ' { type = "PointForce", where = "right", force = [0, 1e-9, 0] }]\n'
        'pins = [{ where = "left" }]\nequilibrium = {}\n'
        'probes = [{ name = "tip", where = "right" }]\n'
    )
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
    problem = StudyProblem.of(motion, h=0.1, dt=0.1, t_end=1.0)
    settings = Settings.of(problem)
    steps = [1.0 / settings.choice(Setting(Line(), 0, j))["dt"] for j in range(3)]
    assert steps == pytest.approx([4, 8, 16])


def test_a_function_varies_by_its_sizes_and_what_is_asked_for():
    problem = StudyProblem.of(strip, h=0.05)
    assert make_lines(problem, None, None) == [Line()]
    named = make_lines(problem, None, None, patterns=["cross", "right"])
    assert [line.pattern for line in named] == ["cross", "right"]
