"""The thresholds of studies, each from both sides, on plain numbers without runs."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import fecloth as fc
from fecloth.study import derived_cases
from fecloth.study.derivation import Follower, shortest_length
from fecloth.study.derived_cases import Sought
from fecloth.study.parameters import Parameter
from fecloth.study.sensitivities import _find_changes_below_round_off
from fecloth.study.sensitivity_result import _describe_quantity


def strip(**more):
    cloth = fc.Cloth.rectangle(1.0, 1.0, 0.5, pattern="right")
    system = fc.System(cloth, fc.Fabric(0.2, 500.0), [fc.StVK()], **{"pins": ["left"]} | more)
    return fc.simulation.setup.Setup(system, system.rest())


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
    text = _describe_quantity(quantity, "m", 1.0, np.array([0.5]), parameters, checked, 1.0)
    assert words in text


@pytest.mark.parametrize(
    ("holds", "words"), [(0.009, "holds up to ± 0.9 %, not for 1 %"), (0.011, "")]
)
def test_a_derivative_that_does_not_hold_for_one_per_cent_says_so(holds, words):
    quantity = SimpleNamespace(text="sag")
    parameters = [Parameter("k", 2.0, 2.0)]
    text = _describe_quantity(quantity, "m", 1.0, np.array([0.5]), parameters, 1e-4, holds)
    assert text.partition("checked by twin runs: 1e-04")[2].removeprefix("; ") == words


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
