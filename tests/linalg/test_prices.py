"""The prices of the operations of linear solvers: a table, and what is between its matrices."""

import tomllib

import numpy as np
import pytest

from fecloth.linalg.block_matrix import BlockPattern
from fecloth.linalg.prices import FILE, Prices, StepPrices

TABLE = tomllib.loads(FILE.read_text(encoding="utf-8"))
SMALL, LARGE = TABLE["blocks"]
ROWS = {kind: np.mean(TABLE["blocks in a row"][kind]) for kind in ("membrane", "plate")}


def pattern(blocks, in_row):
    """A pattern of that size; where its blocks are does not matter."""
    return BlockPattern(np.zeros(round(blocks / in_row) + 1, np.int32), np.empty(round(blocks)))


@pytest.mark.parametrize("kind", ["membrane", "plate"])
@pytest.mark.parametrize("size", [0, 1])
def test_the_prices_of_the_measured_matrices_are_those_of_the_table(kind, size):
    blocks = TABLE["blocks"][size]
    prices = Prices.of(pattern(blocks, ROWS[kind]))
    for name in ("tangent", "residual", "grids", "coarse", "refill", "cycle"):
        assert getattr(prices, name) == pytest.approx(TABLE[name][kind][size], rel=1e-2)
    for name in ("pardiso", "rslab", "superlu"):
        of_factor = prices.factors[name]
        analysis, load = (
            TABLE[f"{name} {part}"][kind][size] if name != "superlu" else 0.0
            for part in ("analysis", "load")
        )
        assert of_factor.analysis == pytest.approx(analysis, rel=1e-2)
        assert of_factor.load * blocks == pytest.approx(load, rel=1e-2)
        in_row = {part: TABLE[f"{name} {part}"][kind][size] for part in ("entries", "factor")}
        assert of_factor.entries == pytest.approx(in_row["entries"] * blocks, rel=1e-2)
        assert of_factor.factor * blocks == pytest.approx(in_row["factor"], rel=1e-2)
        solve = TABLE[f"{name} solve"][kind][size]
        assert of_factor.solve * blocks == pytest.approx(solve, rel=1e-2)


def geometric_mean(values):
    return np.exp(np.mean(np.log(values)))


def test_a_price_between_is_the_geometric_mean():
    middle = Prices.of(pattern((SMALL * LARGE) ** 0.5, ROWS["membrane"]))
    assert middle.cycle == pytest.approx(geometric_mean(TABLE["cycle"]["membrane"]), rel=1e-2)
    middle = Prices.of(pattern(SMALL, (ROWS["membrane"] * ROWS["plate"]) ** 0.5))
    both = [TABLE["cycle"][kind][0] for kind in ROWS]
    assert middle.cycle == pytest.approx(geometric_mean(both), rel=1e-2)


def test_beyond_the_measured_matrices_prices_stay():
    smallest = Prices.of(pattern(100, 2.0))
    assert smallest.cycle == pytest.approx(TABLE["cycle"]["membrane"][0])
    largest = Prices.of(pattern(1e7, 60.0))
    assert largest.cycle == pytest.approx(TABLE["cycle"]["plate"][1])


@pytest.mark.parametrize("name", ["pardiso", "rslab", "superlu"])
def test_the_entries_of_factors_go_on_as_a_power_of_the_blocks(name):
    few, many = TABLE[f"{name} entries"]["plate"]
    blocks = LARGE * LARGE / SMALL
    larger = Prices.of(pattern(blocks, ROWS["plate"])).factors[name]
    assert larger.entries == pytest.approx(many * many / few * blocks, rel=1e-2)


def test_python_takes_the_same_for_a_row_of_any_size():
    """In block products: a small cloth pays for Python, a large one for its arithmetic."""
    python = TABLE["products in Python"]
    few, many = (StepPrices.of(pattern(n, ROWS["membrane"])) for n in (SMALL / 100, SMALL))
    assert few.fused == pytest.approx(TABLE["fused"]["membrane"][0], rel=1e-2)
    assert few.iteration == pytest.approx(100 * many.iteration, rel=1e-6)
    assert many.iteration * SMALL == pytest.approx(python["iteration"], rel=1e-2)
    row = TABLE["row"]["membrane"][0]
    assert many.row == pytest.approx(row + python["row"] / SMALL, rel=1e-2)
    assert few.row == pytest.approx(row + 100 * python["row"] / SMALL, rel=1e-2)
