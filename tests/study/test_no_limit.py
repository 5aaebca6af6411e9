"""Values that refinement does not bring nearer to a limit have no ±, in any study."""

import math

import numpy as np
import pytest
from support.strips import gripped as hung

import fecloth as fc
from fecloth.study.convergence import has_no_limit
from fecloth.study.refinement import Limit
from fecloth.study.uncertainty import estimate_uncertainty

pytestmark = pytest.mark.filterwarnings("ignore")


def log_of_size(result):
    """A number as the displacement below a point load of a membrane: it grows as −log h."""
    return 1.0 + 0.1 * math.log(len(result.state.x))


def area_and_slope(result):
    """A number that has a limit, with an error of order 1."""
    return 1.0 + 1.0 / math.sqrt(len(result.state.x))


@pytest.fixture
def growing():
    return fc.study.converge(hung, log_of_size, levels=4, h=0.25)


def test_a_value_without_a_limit_has_no_uncertainty_and_its_levels_no_error(growing):
    assert not growing.converges
    assert not growing.has_limit
    assert growing.is_one_state
    assert math.isnan(growing.uncertainty)
    assert growing.value == max(growing.table["value"])
    assert growing.table["error"] == [None] * 4
    assert math.isnan(growing.shares["mesh"])
    assert "± not known" in growing.verdict
    known = fc.study.converge(hung, area_and_slope, levels=4, h=0.25)
    assert known.has_limit
    assert known.uncertainty > 0
    assert None not in known.table["error"]


def test_its_budget_has_no_total_and_does_not_agree():
    """The measured value is the one of the finest level."""
    value = fc.study.converge(hung, log_of_size, levels=3, h=0.25).value
    study = fc.study.of(hung, h=0.25)
    name = study.problem.choose_quantity(log_of_size).text
    answer = fc.budget(hung, None, {name: (value, 0.01)}, log_of_size, h=0.25)
    assert answer.difference == 0.0
    assert (answer.time, answer.solver, answer.start) == (0.0, 0.0, 0.0)
    assert math.isnan(answer.space)
    assert math.isnan(answer.total)
    assert not answer.agrees
    assert "nan" not in answer.verdict
    assert any("no limit" in words for words in answer.notes())


def test_its_difference_between_variants_has_no_uncertainty():
    compared = fc.study.compare(hung, {"stiffness": [1e3, 2e3]}, log_of_size, h=0.25)
    (difference,) = compared.differences.values()
    assert math.isnan(difference.uncertainty)
    assert "± not known" in compared.verdict
    assert sum("no limit" in words for words in compared.notes()) == 2
    compared.figure()


def test_a_limit_that_is_not_seen_is_not_extrapolated():
    """Values with an order of 0.28, which are slow: the extrapolated limit would be far away."""
    sizes = np.array([0.8, 0.4, 0.2, 0.1])
    values = 1 + sizes**0.28
    limit = Limit.of(sizes, values, 2.0, "h", {"solver": 0.01})
    left = limit.without_uncertainty()
    assert left.estimate.limit == left.estimate.value == values[-1] != limit.estimate.limit
    assert left.shares["solver"] == 0.01
    assert math.isnan(left.shares["mesh"])
    assert math.isnan(left.uncertainty)
    assert left.errors(values) == [None] * 4


@pytest.mark.parametrize(("order", "reason", "none"), [(0.28, True, True), (0.28, False, False)])
def test_very_slow_changes_have_no_limit_where_there_is_a_reason(order, reason, none):
    sizes = np.array([0.8, 0.4, 0.2, 0.1])
    estimate = estimate_uncertainty(sizes, 1 + sizes**order, 2.0)
    assert estimate.behaviour == "monotone"
    assert has_no_limit(estimate, ["a point pin"] * reason) == none
