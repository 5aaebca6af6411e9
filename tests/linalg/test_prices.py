"""The prices of the operations of linear solvers: a table, and what is beyond its matrices."""

import tomllib

import numpy as np
import pytest

from fecloth.linalg.block_matrix import BlockPattern
from fecloth.linalg.prices import FILE, Prices

TABLE = tomllib.loads(FILE.read_text(encoding="utf-8"))
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


def test_beyond_the_measured_matrices_prices_stay():
    smallest = Prices.of(pattern(100, 2.0))
    assert smallest.cycle == pytest.approx(TABLE["cycle"]["membrane"][0])
    largest = Prices.of(pattern(1e7, 60.0))
    assert largest.cycle == pytest.approx(TABLE["cycle"]["plate"][1])
