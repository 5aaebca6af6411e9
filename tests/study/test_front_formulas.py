"""The formulas and thresholds of fronts and of `tune`, on plain numbers without runs."""

import itertools
import math
from dataclasses import replace
from types import SimpleNamespace

import pytest
from support.plain_bench import PlainBench, PlainLimit
from support.strips import TIP, moving_strip

import fecloth as fc
from fecloth.errors import InputError
from fecloth.simulation.time_error_words import LARGEST_STATED
from fecloth.study import tuning
from fecloth.study.fronts import bench, limit
from fecloth.study.fronts.bench import Bench, check_sizes
from fecloth.study.fronts.front import Plan
from fecloth.study.fronts.limit import Ladder, Limit, find_limit, is_second_order
from fecloth.study.fronts.search import Search
from fecloth.study.fronts.settings import Line, Setting, Settings
from fecloth.study.problem import StudyProblem
from fecloth.study.runs import Runs
from fecloth.study.tuning import Goal, Reduced, search_within_budget
from fecloth.study.uncertainty import estimate_uncertainty

LINE = Line("bdf2")
OTHER = Line("implicit_midpoint")


@pytest.fixture
def plain_records(monkeypatch):
    """Records of the limit are plain values."""
    plain = {
        "record_at": lambda row, quantity: row["value"],
        "is_number": lambda quantity, record: True,
        "value_of": lambda quantity, record: 1.0 + {"x": 1, "y": 10}[quantity] * (record - 1.0),
        "size_of": lambda quantity, record: abs(record),
        "difference_of": lambda quantity, a, b: abs(b - a),
        "check_sizes": lambda quantities, row, where: None,
    }
    for name, function in plain.items():
        monkeypatch.setattr(limit, name, function)


def ladder_of(plain, *levels):
    ladder = Ladder(plain, LINE)
    ladder.levels = [Setting(LINE, *level) for level in levels]
    for level in ladder.levels:
        plain.run(level)
    return ladder


# --- the ladder -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("by_dt", "i", "j"),
    [(1.0, 2, 2), (16.0, 2, 4), (1 / 16, 6, 2), (4.0**9, 2, 6), (4.0**-9, 10, 2), (3.0, 2, 3)],
)
def test_the_first_level_has_errors_of_the_same_size(by_dt, i, j, plain_records):
    """A dt whose error is 16 times larger is halved twice: it is of second order.

    The coarse setting has h² = 1/4 and dt² = 1/16.
    """
    ladder = Ladder(PlainBench(a=1e-6, b=4e-6 * by_dt), LINE)
    ladder.begin(math.inf)
    assert ladder.levels == [Setting(LINE, i, j)]


def test_a_level_halves_h_and_dt(plain_records):
    for plain, finer in ((PlainBench(), (4, 3)), (PlainBench(has_dt=False), (4, 2))):
        ladder = ladder_of(plain, (2, 2))
        ladder.go_on()
        assert ladder.levels[-1] == Setting(LINE, *finer)


@pytest.mark.parametrize(
    ("levels", "growth"), [([(2, 2)], 4.0), ([(0, 0), (2, 1)], 8.0), ([(0, 0), (0, 0)], 2.0)]
)
def test_the_time_of_a_level_grows_as_before(levels, growth, plain_records):
    assert ladder_of(PlainBench(), *levels).growth == growth
    assert ladder_of(PlainBench(), (0, 0), (9, 9)).growth == 16.0


def test_the_seconds_to_an_uncertainty_follow_the_order(plain_records):
    ladder = ladder_of(PlainBench(), (0, 0), (2, 1), (4, 2))
    took = 64.0
    uncertainty = ladder.limit.uncertainty.max()
    assert ladder.seconds_to(uncertainty / 3.9) == took * 8
    assert ladder.seconds_to(uncertainty / 4.1) == took * 8**2
    assert ladder.seconds_to(2 * uncertainty) == took * 8
    assert ladder_of(PlainBench(), (0, 0), (2, 1)).seconds_to(1.0) == 8.0 * 8
    assert ladder_of(PlainBench(), (0, 0)).seconds_to(1.0) == 1.0 * 4**2


def test_a_ladder_that_does_not_shrink_needs_two_further_levels(plain_records):
    plain = PlainBench(worth=lambda setting: 1.0 + setting.j % 2)
    ladder = ladder_of(plain, (0, 0), (2, 1), (4, 2))
    assert ladder.seconds_to(1e-3) == 64.0 * 8**2


def test_the_estimate_is_the_published_one_of_the_last_four_levels(plain_records):
    levels = [(2 * k, k) for k in range(5)]
    plain = PlainBench(worth=lambda setting: 1.0 + 4.0**-setting.j + (setting.j == 0))
    ladder = ladder_of(plain, *levels)
    values = [1.0 + 4.0**-k for k in range(1, 5)]
    expected = estimate_uncertainty([16.0, 8.0, 4.0, 2.0], values, 2.0)
    assert ladder.limit.estimates == (expected,)
    assert ladder.limit.uncertainty == pytest.approx([expected.uncertainty / values[-1]])
    assert ladder.limit.error({"value": 1.5}) == pytest.approx([0.5 / values[-1]], rel=1e-3)


@pytest.mark.parametrize(("has_h", "has_dt", "theory"), [(1, 1, 1.0), (0, 1, 1.0), (1, 0, 1.0)])
def test_the_theory_is_the_least_order_of_what_is_refined(has_h, has_dt, theory, plain_records):
    plain = PlainBench(orders=(2.0, 1.0), has_h=bool(has_h), has_dt=bool(has_dt))
    assert ladder_of(plain, (0, 0))._theory("x") == theory
    plain.orders = (1.0, 2.0)
    assert ladder_of(plain, (0, 0))._theory("x") == (1.0 if has_h else 2.0)


def test_changes_of_a_field_are_summed_up(plain_records, monkeypatch):
    """The sums to the finest level fall as the error does: 1, 1/4, 1/16 have the order 2."""
    monkeypatch.setattr(limit, "is_number", lambda quantity, record: False)
    ladder = ladder_of(PlainBench(), (0, 0), (2, 1), (4, 2))
    (estimate,) = ladder.limit.estimates
    assert estimate.order == pytest.approx(2.0)
    values = [1.0 + 2.0 * 4.0**-k for k in range(3)]
    assert estimate.uncertainty == pytest.approx(1.25 * (values[-1] - 1.0))
    distance = ladder.limit.error({"value": values[-1] + 0.1})  # to the finest level
    assert distance == pytest.approx([0.1 / values[-1]])


# --- the limit ------------------------------------------------------------------------------------


@pytest.mark.parametrize("tolerance", [0.1, 1e-3])
def test_the_limit_is_refined_to_two_fifths_of_the_tolerance(tolerance, plain_records):
    result = find_limit(PlainBench(), [LINE], tolerance)
    assert result.uncertainty.max() <= 0.4 * tolerance
    before = Limit(result.quantities, result.settings[:-1], result.rows[:-1], result.estimates)
    assert len(result.rows) == 3 or not _is_within(before, 0.4 * tolerance)
    assert abs(result.estimates[0].limit - 1.0) <= result.uncertainty.max()


def test_the_limit_is_refined_for_the_quantity_that_is_least_known(plain_records):
    """The quantity y changes ten times as much as x."""
    result = find_limit(PlainBench(quantities=("x", "y")), [LINE], 0.01)
    assert result.uncertainty[0] < 0.2 * result.uncertainty[1] <= 0.2 * 0.004


def _is_within(result, wanted):
    """Whether the limit of fewer levels was within the wanted uncertainty."""
    values = [row["value"] for row in result.rows[-4:]]
    sizes = [2.0 ** (len(values) - k) for k in range(len(values))]
    return estimate_uncertainty(sizes, values, 2.0).uncertainty / values[-1] <= wanted


def test_the_limit_takes_three_fifths_of_the_time(plain_records):
    plain = PlainBench(seconds=1e4)
    find_limit(plain, [LINE], 1e-9)
    *_, (last, _) = plain.asked
    assert plain.spent > 0.6e4 >= plain.spent - plain.took(last)


def test_the_ladder_of_the_faster_line_goes_on(plain_records):
    plain = PlainBench(b=4.0, speed={OTHER: 3.0})
    result = find_limit(plain, [OTHER, LINE], 1e-3)
    assert {setting.line for setting in result.settings} == {LINE}
    finest = {line: max(s.i for s in plain.rows if s.line == line) for line in (LINE, OTHER)}
    assert finest[OTHER] < finest[LINE]


def test_a_line_that_starts_four_times_slower_has_no_level(plain_records):
    plain = PlainBench(b=4.0, speed={OTHER: 4.1})
    find_limit(plain, [LINE, OTHER], 0.1)
    assert OTHER not in {setting.line for setting in plain.rows}
    plain = PlainBench(b=4.0, speed={OTHER: 3.9})
    find_limit(plain, [LINE, OTHER], 0.1)
    assert OTHER in {setting.line for setting in plain.rows}


def test_only_methods_of_second_order_have_ladders():
    assert is_second_order(Line("bdf2"))
    assert is_second_order(Line("central_difference"))
    assert is_second_order(Line())
    assert not is_second_order(Line("backward_euler"))
    assert not is_second_order(Line("auto"))


def test_without_three_levels_the_finest_one_is_the_limit_of_unknown_uncertainty(plain_records):
    plain = PlainBench(left=0.0)
    result = find_limit(plain, [LINE], 0.01)
    assert not result.is_known
    assert len(result.rows) == 1
    assert result.error({"value": 2 * result.finest["value"]}) == pytest.approx([1.0])


# --- the bench ------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def problem():
    return StudyProblem.of(moving_strip, h=0.25, dt=0.01, t_end=0.1, probes=TIP)


@pytest.fixture
def small_bench(problem):
    quantities = problem.choose_quantities("tip.x")
    return Bench(Settings.of(problem), quantities, Runs(jobs=2), 120.0)


def row_of(seconds=1.0, **more):
    ends = {"tip.x": [1.0, 1.2], "tip.y": [0.1, 0.1], "tip.z": [0.0, 0.0]}
    row = {"status": "ok", "cpu_seconds": seconds, "case_seconds": seconds, "time_error": 0.0}
    return row | {"ends": ends} | more


@pytest.fixture
def measured(monkeypatch):
    """The runs of a bench give the row in this list; it gets the limits of their time."""
    rows, limits = [], []

    def run(runs, quantities, how):
        limits.append(how.time_limit)
        return [rows[-1] | {"problem": runs[0].problem}]

    monkeypatch.setattr(bench, "run_quantities", run)
    monkeypatch.setattr(bench, "record_at", lambda row, quantity: row)
    monkeypatch.setattr(bench, "size_of", lambda quantity, row: row.get("size", 1.0))
    return rows, limits


@pytest.mark.parametrize(("part", "status"), [(0.99, "ok"), (1.0, "not resolved")])
def test_a_run_that_does_not_resolve_its_steps_proves_nothing(part, status, small_bench, measured):
    measured[0].append(row_of(time_error=part * LARGEST_STATED))
    setting = Setting(Line())
    assert small_bench.run(setting)["status"] == status
    assert small_bench.is_ok(setting) == (status == "ok")
    assert small_bench.took(setting) == (1.0 if status == "ok" else math.inf)


def test_a_run_may_take_a_third_of_the_time_that_is_left(small_bench, measured, monkeypatch):
    """Beside half a second, and 0.2 ms for each triangle, for its set-up."""
    small_bench = replace(small_bench, before=60.0, begin=bench.time.process_time())
    monkeypatch.setattr(bench.time, "process_time", lambda: small_bench.begin)
    assert small_bench.left == 60.0
    assert small_bench.allows(20.0)
    assert not small_bench.allows(20.1)
    measured[0].append(row_of())
    small_bench.run(Setting(Line(), 2))
    triangles = small_bench.settings.problem_of(Setting(Line(), 2)).work.triangles
    assert measured[1] == [pytest.approx(20.0 + 0.5 + 2e-4 * triangles, abs=0.011)]
    assert triangles > 8
    empty = replace(small_bench, before=120.0)
    assert empty.allows(1.0)  # which every run may take
    assert not empty.allows(1.01)


def test_the_time_of_runs_from_the_store_counts(small_bench, measured):
    measured[0].append(row_of(seconds=30.0))
    small_bench.run(Setting(Line()))
    assert 30.0 <= small_bench.spent < 31.0
    assert small_bench.left == pytest.approx(90.0, abs=1.0)
    alone = replace(small_bench, runs=Runs(jobs=1))
    alone.run(Setting(Line()))
    assert 30.0 <= alone.spent < 31.0
    other = small_bench.with_settings(small_bench.settings)
    assert other.spent >= 30.0
    assert not other.rows


def test_a_run_that_was_stopped_early_may_run_again(small_bench, measured):
    measured[0].append({"status": "time limit", "cause": "late"})
    setting = Setting(Line())
    small_bench.run(setting, most=2.0)
    assert setting not in small_bench.rows
    small_bench.run(setting)
    assert small_bench.late() == [setting]


def test_levels_run_with_a_hundredth_of_the_tolerance_of_the_solver(small_bench, measured):
    """Their seconds count as the seconds of all other runs, and their rows are others."""
    measured[0].append(row_of(seconds=30.0))
    sharper = small_bench.with_sharper_solver()
    setting = Setting(Line())
    problem = sharper.run(setting)["problem"]
    own = small_bench.settings.problem_of(setting).first.newton or fc.Newton()
    assert problem.first.newton.tolerance == pytest.approx(own.residual / 100)
    assert not small_bench.is_ok(setting)
    assert 30.0 <= small_bench.spent < 31.0
    assert sharper.with_sharper_solver() is sharper
    static = SimpleNamespace(problem=SimpleNamespace(is_static=True), sharper=None)
    bench_of_equilibrium = replace(small_bench, settings=static)
    assert bench_of_equilibrium.with_sharper_solver() is bench_of_equilibrium


@pytest.mark.parametrize(
    ("size", "ends", "is_zero"),
    [
        (1.1e-12, 0.0, False),
        (0.9e-12, 0.0, True),
        (1.1e-6, 1.0, False),
        (0.9e-6, 1.0, True),
    ],
)
def test_a_quantity_below_a_part_of_its_vector_is_zero(size, ends, is_zero, problem, measured):
    """The vector of a probe is from its start to its end, so that a place is no size."""
    (quantity,) = problem.choose_quantities("tip.y")
    moved = {"tip.x": [5.0, 5.0 + ends], "tip.y": [0.0, size], "tip.z": [0.0, 0.0]}
    row = {"size": size, "ends": moved, "problem": problem}
    if is_zero:
        with pytest.raises(InputError, match="has no relative error"):
            check_sizes([quantity], row, "scene")
    else:
        check_sizes([quantity], row, "scene")


# --- the search -----------------------------------------------------------------------------------


def search_of(errors, tolerance=0.01):
    """A search after settings with these errors have run, by the refinements of h."""
    plain = PlainBench(quantities=("x", "y"))
    for i, pair in enumerate(errors):
        plain.rows[Setting(LINE, i)] = {"status": "ok", "errors": pair}
    return Search(plain, PlainLimit(0.001, 0.002), tolerance)


def test_error_and_uncertainty_of_each_quantity_are_added():
    search = search_of([(0.0095, 0.002)])
    assert search.bound(Setting(LINE)) == pytest.approx(0.0105)
    assert search.error(Setting(LINE)) == 0.0095
    assert not search.meets(Setting(LINE))
    assert search_of([(0.0085, 0.0075)]).meets(Setting(LINE))
    assert not search_of([(0.0085, 0.0085)]).meets(Setting(LINE))


@pytest.mark.parametrize(
    ("before", "now", "helps"),
    [
        (0.10, 0.096, False),  # by 4 % only
        (0.10, 0.094, True),
        (0.10, 0.104, False),
        (0.0201, 0.0199, True),  # near the tolerance
        (0.0205, 0.0203, False),
    ],
)
def test_a_refinement_that_changes_little_does_not_help(before, now, helps):
    search = search_of([(before, 0.0), (now, 0.0)])
    assert search._helps(Setting(LINE, 1), Setting(LINE, 0)) == helps


def test_a_finer_setting_promises_the_time_by_its_missing_halvings():
    """An error of 64 tolerances needs 3 halvings, each 1.6 times the time."""
    search = search_of([(0.64, 0.0)])
    search._add_finer(Setting(LINE), 1.0)
    promises = {(entry[3].i, entry[3].j): entry[0] for entry in search.queue}
    assert promises == {(1, 0): pytest.approx(1.6**3), (0, 1): pytest.approx(1.6**3)}
    assert [entry[2] for entry in search.queue] == [1.6, 1.6]
    near = search_of([(0.011, 0.0)])
    near._add_finer(Setting(LINE), 1.0)
    assert near.queue[0][0] == pytest.approx(1.6)  # at least one


def test_a_failed_setting_is_refined_once_and_a_refused_one_twice():
    search = search_of([])
    refused = {"status": "refused", "cause": "too coarse"}
    for i in range(2):
        search.bench.rows[Setting(LINE, i)] = dict(refused)
    search.bench.is_ok = lambda setting: False
    assert search._helps(Setting(LINE, 0), Setting(LINE, -1))
    assert not search._helps(Setting(LINE, 1), Setting(LINE, 0))


@pytest.mark.parametrize(("left", "runs"), [(3.7, True), (3.5, False)])
def test_a_search_keeps_three_runs_of_the_cheapest_setting(left, runs):
    """With 0.6 s for the next setting, whose promise is below the 1 s of the cheapest."""
    search = search_of([(0.001, 0.001)])
    search.bench.left = left
    search.bench.allows = lambda seconds: True
    search._push(0.6, 0.6, Setting(OTHER))
    asked = []
    search.bench.run = lambda setting, most: asked.append((setting, most))
    search.bench.rows[Setting(OTHER)] = {"status": "time limit"}
    assert search.run() == ("" if runs else "the time is up")
    if runs:  # then the finer neighbours of the cheapest, which need 1.6 s each
        finer = [(Setting(LINE, 1, 0), 4 * 1.6), (Setting(LINE, 0, 1), 4 * 1.6)]
        assert asked == [(Setting(OTHER), 4 * 0.6), *finer]
    else:
        assert asked == []


@pytest.mark.parametrize(("finer", "meets"), [(0.02, False), (0.009, True)])
def test_a_setting_does_not_count_if_a_finer_one_exceeds_the_tolerance(finer, meets):
    """As where the errors of a coarse setting in space and in time cancel."""
    search = search_of([(0.001, 0.001), (finer, 0.001)])
    search.bench.allows = lambda seconds: False
    assert search.run() == ""
    assert (Setting(LINE) in search.by_chance) != meets
    assert (search.cheapest == Setting(LINE)) == meets


def searched(plain, tolerance, **more):
    """A search over the lines of a bench, and why it has ended."""
    search = Search(plain, PlainLimit(0.0), tolerance, **more)
    search.add_lines(list(plain.speed))
    return search, search.run()


@pytest.mark.parametrize("tolerance", [0.3, 0.01, 0.003])
@pytest.mark.parametrize(("in_space", "in_time"), [(1.0, 1.0), (1.0, 0.01), (0.02, 1.0)])
def test_the_search_finds_the_cheapest_of_all_settings(in_space, in_time, tolerance):
    """Of up to 14 refinements of each size."""
    plain = PlainBench(in_space, in_time, {OTHER: 0.03, LINE: 0.01})
    search, why = searched(plain, tolerance)
    assert why == ""
    every = [Setting(*each) for each in itertools.product(plain.speed, range(14), range(14))]
    met = [setting for setting in every if plain.value(setting) - 1.0 <= tolerance]
    assert plain.took(search.cheapest) == min(map(plain.took, met))
    assert search.error(search.cheapest) <= tolerance
    most = 4 * plain.took(search.cheapest)
    assert max(map(plain.took, plain.rows)) <= most  # dear ones did not run


def test_a_search_ends_when_its_time_is_up_and_says_what_is_next():
    plain = PlainBench(speed={LINE: 1.0}, left=30.0)
    search, why = searched(plain, 1e-6)
    assert why == "the time is up"
    assert search.cheapest is None
    assert search.next not in plain.rows
    assert plain.left > 0


def test_a_setting_that_takes_longer_than_expected_waits_for_cheaper_ones():
    """The other line is 2000 times slower: it is cut off, and its time is not spent."""
    plain = PlainBench(speed={OTHER: 20.0, LINE: 0.01})
    assert searched(plain, 0.05)[1] == ""
    assert {setting.line for setting in plain.rows} == {LINE}


def test_only_settings_within_the_longest_time_count():
    plain = PlainBench(speed={LINE: 0.01})
    assert searched(plain, 0.01, longest=0.5)[0].cheapest is None
    assert max(map(plain.took, plain.rows)) <= 4 * 0.5


# --- settings and plans ---------------------------------------------------------------------------


def test_tolerances_of_chosen_steps_begin_with_a_tenth(problem):
    settings = replace(Settings.of(problem), coarsest=0.25)
    sizes = [settings.choice_of_sizes(Setting(Line("auto"), 0, j)) for j in range(3)]
    assert [size["rtol"] for size in sizes] == [0.1, 0.025, 0.00625]
    assert "dt" not in sizes[0]


def test_h_is_refined_down_to_the_finest_one(problem):
    settings = Settings.of(problem, finest=0.125)
    assert settings.can_be_finer(Setting(Line(), 1)) == (True, True)
    assert settings.can_be_finer(Setting(Line(), 2)) == (False, True)


def test_given_values_are_the_only_ones(problem):
    axes = {"h": [0.1, 0.2], "dt": [0.01]}
    plan = Plan(problem, (), axes, 0.01, 1.0, Runs())
    settings = replace(Settings.of(problem), values=plan.values)
    setting = Setting(Line(), 1, 0)
    assert settings.choice_of_sizes(setting) == {"h": 0.1, "dt": 0.01}
    assert settings.can_be_finer(setting) == (False, False)
    assert Plan(problem, (), {}, 0.01, 1.0, Runs()).values == {"h": [0.25], "dt": [0.01]}
    assert Plan(problem, (), {"h": None, "dt": None}, 0.01, 1.0, Runs()).values == {}


# --- tune -----------------------------------------------------------------------------------------


def test_with_a_budget_tolerances_get_smaller_until_none_is_met(monkeypatch):
    """0.1, 0.032, 0.01, …: the last search in which a setting met its tolerance counts."""
    tried = []

    def search_lines(plan, bench, limit, lines, longest):
        tried.append(plan.tolerance)
        assert longest == 2.0
        return SimpleNamespace(cheapest=plan.tolerance > 2e-3, at=plan.tolerance), ""

    monkeypatch.setattr(tuning, "search_lines", search_lines)
    monkeypatch.setattr(tuning, "find_limit", lambda bench, lines, tolerance, report: None)
    plan = Plan(SimpleNamespace(), (), {}, 0.1, 1.0, Runs())
    monkeypatch.setattr(Plan, "lines", lambda self: [])
    best, why = search_within_budget(plan, SimpleNamespace(say=print), Goal(budget=2.0))
    assert tried == pytest.approx([10 ** (-1 - k / 2) for k in range(5)])
    assert best.at == pytest.approx(10**-2.5)
    assert why == ""


def test_what_changed_gaps_make_is_taken_from_the_tolerance(monkeypatch, problem):
    """0.4 % of 1 %: the limit and the search have the rest."""
    tolerances = []

    def search_lines(plan, bench, limit, lines):
        tolerances.append(plan.tolerance)
        raise KeyboardInterrupt

    gaps = Reduced(problem, {"gap": 0.004})
    monkeypatch.setattr(StudyProblem, "has_contact", True)
    monkeypatch.setattr(tuning, "narrow_gaps", lambda reduced, bench, tolerance: gaps)
    monkeypatch.setattr(
        tuning, "find_limit", lambda bench, lines, tolerance, report: tolerances.append(tolerance)
    )
    monkeypatch.setattr(tuning, "search_lines", search_lines)
    plan = Plan(problem, problem.choose_quantities("tip.x"), {}, 0.01, 1.0, Runs(quiet=True))
    with pytest.raises(KeyboardInterrupt):
        tuning.find_tuned(plan, Goal(0.01), model=False)
    assert tolerances == pytest.approx([0.006, 0.006])


def leave_out(monkeypatch, changes, seconds):
    """Leave out terms a, b, c with these changes of the quantities and these CPU seconds."""
    names = list(changes)
    variants = [
        SimpleNamespace(name=name, slot=name[0], values={name: None}, leaves_out_membrane=False)
        for name in names
    ]

    class Changed:
        def __init__(self, taken=()):
            self.taken = taken
            self.source = SimpleNamespace(usual_variations=("method",))

        def at(self, values, name):
            return Changed((*self.taken, name))

    def run(bench, problem):
        took = seconds[problem.taken[0]] if problem.taken else 1.0
        return {"status": "ok", "cpu_seconds": took, "taken": problem.taken}

    monkeypatch.setattr(tuning, "coarse_problem", lambda problem, settings: Changed())
    monkeypatch.setattr(tuning, "run_problem", run)
    monkeypatch.setattr(
        tuning, "distance", lambda bench, a, b: sum(changes[name] for name in b["taken"])
    )
    monkeypatch.setattr(tuning, "simpler_terms", lambda base: variants)
    return tuning.leave_out_terms(Reduced(Changed()), SimpleNamespace(settings=None), 0.01)


def test_terms_go_that_change_a_quarter_of_the_tolerance_together(monkeypatch):
    changes = {"a": 0.0015, "b": 0.0009, "c": 0.0002, "d": 0.0026}
    reduced = leave_out(monkeypatch, changes, {"a": 0.5, "b": 0.4, "c": 0.6, "d": 0.1})
    assert set(reduced.changes) == {"a", "b"}  # c with them is above 0.0025, d alone is
    assert reduced.errors["model"] == pytest.approx(0.0024)


def test_terms_that_save_no_time_stay_and_a_term_changes_once(monkeypatch):
    changes = {"a": 0.0001, "b1": 0.0001, "b2": 0.0001}
    reduced = leave_out(monkeypatch, changes, {"a": 1.1, "b1": 0.5, "b2": 0.4})
    assert reduced.changes == ("b2",)
