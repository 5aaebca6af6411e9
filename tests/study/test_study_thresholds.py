"""The thresholds of studies, each from both sides, on plain numbers without runs."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import fecloth as fc
from fecloth.errors import InputError
from fecloth.nonlinear.eigenpairs import Eigenpairs
from fecloth.study import chart_grid, derived_cases, measured_runs, modes
from fecloth.study.cases import Progress
from fecloth.study.change import Level
from fecloth.study.convergence import judge
from fecloth.study.derivation import Follower, shortest_length
from fecloth.study.derived_cases import Sought
from fecloth.study.graded_meshes import find_lone_pins
from fecloth.study.parameters import Parameter
from fecloth.study.problem import find_obstacles, is_round, is_slack_across
from fecloth.study.refinement import other_shares
from fecloth.study.run_problems import Task
from fecloth.study.sensitivities import _find_changes_below_round_off
from fecloth.study.sensitivity_result import _describe_quantity
from fecloth.study.stability_runs import _make_row, offer_less
from fecloth.study.uncertainty import Estimate, estimate_uncertainty
from fecloth.study.variants import parse_range
from fecloth.study.workload import Workload

H = [0.8, 0.4, 0.2, 0.1]


def estimate(order, theory=2.0, scatter=0.0):
    return Estimate(1.0, 1.0, 0.1, order, theory, "monotone", scatter, 1.0, "least squares")


def strip(**more):
    cloth = fc.Cloth.rectangle(1.0, 1.0, 0.5, pattern="right")
    system = fc.System(cloth, fc.Fabric(0.2, 500.0), [fc.StVK()], **{"pins": ["left"]} | more)
    return fc.simulation.setup.Setup(system, system.rest())


@pytest.mark.parametrize(
    ("order", "words"),
    [
        (1.48, "not yet in the asymptotic range"),
        (1.52, "converges as it should"),
        (2.48, "converges as it should"),
        (2.52, "converges faster"),
        (0.32, "not yet in the asymptotic range"),
        (0.28, "does not converge: refinement does not reduce"),
    ],
)
def test_orders_count_as_theirs_within_a_quarter_and_as_none_below_0_3(order, words):
    assert judge(estimate(order), H, [1.0, 2.0, 3.0, 4.0], ["folds"])[1].startswith(words)


@pytest.mark.parametrize(("factor", "words"), [(0.83, "about 5 more"), (0.85, "hardly")])
def test_at_most_five_more_levels_are_proposed(factor, words):
    """The distance of the local orders from 2 falls by the same factor, from 1.5."""
    distances = 1.5 * factor ** np.arange(2, dtype=float)
    changes = np.cumprod([1.0, *0.5 ** (2 - distances)])
    values = np.cumsum([0.0, *changes])
    assert words in judge(estimate(2 - distances[-1]), H, values, [])[1]


@pytest.mark.parametrize(("spread", "behaviour"), [(0.5e-11, "constant"), (2e-11, "monotone")])
def test_values_are_equal_up_to_what_solvers_leave(spread, behaviour):
    values = 1 + spread * np.array([1.0, 0.25, 0.0])
    assert estimate_uncertainty(H[:3], values, 2.0).behaviour == behaviour


def test_other_parts_of_the_error_follow_from_one_run_each():
    """A part ∝ s^p changes by the share 1 − r^−p if s is divided by r."""

    def row(edge=0.1, **more):
        return {"point": SimpleNamespace(level=Level(**more)), "edge": edge}

    first = row()
    more = [row(sharper=100.0), row(gap=2.0), row(dt=2.0)]
    shares = other_shares("h", (2.0, 2.0), first, more, [1.0, 1.0, 1.0])
    assert shares == {"solver": 1.0, "gap": 2.0, "time step": pytest.approx(4 / 3)}
    shares = other_shares("h", (2.0, 2.0), first, [row(rtol=10.0)], [1.0])
    assert shares == {"time step": pytest.approx(1 / (1 - 10 ** (-2 / 3)))}
    shares = other_shares("dt", (1.0, 2.0), first, [row(edge=0.05, h=2.0)], [1.0])
    assert shares == {"mesh": pytest.approx(2.0)}


def test_a_key_has_at_most_ten_thousand_values():
    assert len(parse_range("k=0:1:lin:10000")[1]) == 10_000
    with pytest.raises(InputError, match="1 to 10000 finite values"):
        parse_range("k=0:1:lin:10001")


@pytest.mark.parametrize(("letters", "is_cut"), [(100, False), (101, True)])
def test_a_progress_line_has_a_hundred_letters_of_the_cause(letters, is_cut, capsys):
    cause = f"word {'x' * (letters - 5)}"
    progress = Progress([1.0], clock=iter([0.0, 1.0]).__next__)
    progress.print("case", {"status": "failed", "cause": cause}, 1.0)
    assert capsys.readouterr().err.endswith("failed: word …\n" if is_cut else f"{cause}\n")


@pytest.mark.parametrize(("least", "is_folded"), [(0.905, False), (0.895, True)])
def test_a_cloth_is_folded_below_nine_tenths_of_a_length(least, is_folded):
    setup = strip()
    words = find_obstacles(setup, {"least_stretch": [1.0, least]}, setup.start.x)
    assert any("folds and wrinkles" in remark for remark in words) == is_folded


@pytest.mark.parametrize(
    ("along", "across", "is_slack"),
    [(0.1, 0.0045, True), (0.1, 0.0055, False), (0.1, -0.2, True), (1e-12, -1e-12, False)],
)
def test_a_cloth_is_slack_across_below_a_twentieth_of_the_strain(along, across, is_slack):
    cloth = fc.Cloth.rectangle(1.0, 1.0, 0.5, pattern="right")
    x = np.column_stack([cloth.X * [1 + along, 1 + across], np.zeros(len(cloth.X))])
    assert is_slack_across(cloth, x) == is_slack


def test_a_square_of_two_edges_a_side_is_not_round():
    """Half the nodes of its border are corners: not more than half."""
    assert not is_round(fc.Cloth.rectangle(1.0, 1.0, 0.5, pattern="right"))
    assert is_round(fc.Cloth.disk(0.5, 0.2))


def test_a_node_pinned_without_a_neighbour_is_a_lone_pin():
    assert len(find_lone_pins(strip())) == 0
    assert len(find_lone_pins(strip(pins=["corners"]))) == 4


@pytest.mark.parametrize(("slope", "is_lost"), [(0.5e-9, True), (2e-9, False), (0.0, False)])
def test_a_change_below_1e_9_of_a_quantity_is_lost_if_its_scale_was_given(slope, is_lost):
    given, own = Parameter("a", 0.0, 1.0), Parameter("b", 3.0, 3.0)
    sought = Sought((given, own), (), 1e-4)
    lost = _find_changes_below_round_off(sought, np.array([[slope, slope]]), np.array([1.0]))
    assert lost.tolist() == [[is_lost, False]]


@pytest.mark.parametrize(("checked", "words"), [(0.009, "checked by"), (0.011, "no derivative")])
def test_one_per_cent_from_the_twin_runs_is_no_derivative(checked, words):
    quantity = SimpleNamespace(text="sag")
    parameters = [Parameter("k", 2.0, 2.0)]
    text = _describe_quantity(quantity, "m", 1.0, np.array([0.5]), parameters, checked)
    assert words in text


@pytest.mark.parametrize(
    ("asymmetry", "unbalanced", "count"), [(0.9e-6, 0.009, 0), (1.1e-6, 0.009, 1), (0.0, 0.011, 1)]
)
def test_modes_warn_above_1_per_cent_of_the_forces_and_1e_6_of_asymmetry(
    asymmetry, unbalanced, count
):
    pairs = Eigenpairs(np.array([1.0]), np.zeros((1, 3, 3)), 1e-9, asymmetry)
    assert len(list(modes._find_doubts(pairs, unbalanced))) == count


@pytest.mark.parametrize(("made", "status"), [(0.045, "ok"), (0.055, "wrong")])
def test_a_method_may_make_a_twentieth_of_the_energy_that_moved(made, status):
    run = Task(None, None, {}, "", None, cells={"method": "bdf2", "predicted": None})
    row = {"status": "ok", "cause": "", "made": made, "warning": "", "cpu_seconds": 1.0}
    assert _make_row(run, row)["status"] == status


@pytest.mark.parametrize(
    ("steps", "offer"), [(28_000, ""), (30_000, "within a minute: the methods bdf2")]
)
def test_a_map_that_takes_more_than_a_minute_offers_less(steps, offer):
    problem = SimpleNamespace(h=None)
    short = Task(None, problem, {"method": "bdf2"}, "", Workload(0.0, 1000))
    long = Task(None, problem, {"method": "newmark"}, "", Workload(0.0, steps))
    assert offer_less([short, long], 1) == offer


def test_the_predicted_seconds_of_a_case_by_hand():
    """A step takes a time of its own and a time for each triangle; so does the set-up."""
    implicit = Workload(1000.0, 100).seconds
    explicit = Workload(1000.0, 100, is_explicit=True).seconds
    assert implicit == pytest.approx(0.03 + 100 * (2e-3 + 1e-2))
    assert explicit == pytest.approx(0.03 + 100 * (8e-4 + 2e-4))
    assert math.isclose(Workload(1000.0, 100, is_explicit=True).coarser(2).steps, 50)


@pytest.mark.parametrize(
    ("seconds", "runs"), [(0.1, 3), (0.45, 3), (0.55, 2), (0.95, 2), (1.05, 1)]
)
def test_runs_are_repeated_twice_at_most_and_for_a_second(seconds, runs, monkeypatch):
    """The first run warms up and does not count."""
    ran = []
    monkeypatch.setattr(
        measured_runs, "_run_once", lambda *_: ran.append(1) or ({}, seconds + 0.001 * len(ran))
    )
    _, fastest = measured_runs._run_timed(None, strip(), measured_runs.REPEATS, None)
    assert len(ran) == 1 + runs
    assert fastest == pytest.approx(seconds + 0.002)


@pytest.mark.parametrize(
    ("moved", "size"), [(1e-3, 1e-4), (0.2, 1e-5), (2.0, 1e-6), (2e3, 1e-9), (2e5, 1e-9)]
)
def test_differences_move_nodes_by_1e_5_of_an_edge_within_limits(moved, size):
    """The size is a power of ten: the next one below 1e-5 / moved, from 1e-9 to 1e-4."""
    base = strip()
    lengths = moved * shortest_length(base)
    follower = SimpleNamespace(base=base, along=SimpleNamespace(longest=lambda dt: lengths))
    assert Follower.size(follower, follower.along, 0.1) == pytest.approx(size, rel=1e-9)


def test_a_sharper_newton_iteration_is_no_looser_than_its_own():
    own = replace(strip(), newton=fc.Newton(tolerance=1e-8))
    assert derived_cases._sharpen(own, 1e-6).newton.tolerance == 1e-8
    assert derived_cases._sharpen(own, 1e-10).newton.tolerance == 1e-10
    assert derived_cases._sharpen(strip(), 1e-6).newton.tolerance == 1e-6


@pytest.mark.parametrize(("rtol", "largest"), [(None, 0.1), (0.02, 0.02)])
def test_a_chart_takes_three_tolerances_or_steps(rtol, largest):
    scene = SimpleNamespace(time=SimpleNamespace(dt="auto", rtol=rtol))
    rules = chart_grid._list_rules(scene, "bdf2")
    assert [rule["rtol"] for rule in rules] == [largest, largest / 10, largest / 100]
    assert chart_grid._list_rules(scene, "central_difference") == [{"method": "central_difference"}]
