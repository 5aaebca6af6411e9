"""The prices of the operations of linear solvers: a table, and what is beyond its matrices."""

import tomllib

import numpy as np
import pytest

from fecloth.linalg.block_matrix import BlockPattern
from fecloth.linalg.prices import FILE, Prices

TABLE = tomllib.loads(FILE.read_text(encoding="utf-8"))
ROWS = {kind: np.mean(TABLE["blocks in a row"][kind]) for kind in ("membrane", "plate")}


PLAIN = ("tangent", "residual", "grids", "coarse", "refill", "cycle")


def prices_of(blocks, in_row):
    """The prices of a matrix of that size by the names of the table's rows."""
    rows = np.zeros(round(blocks / in_row) + 1, np.int32)
    prices = Prices.of(BlockPattern(rows, np.empty(round(blocks))))
    of_all = {name: getattr(prices, name) for name in PLAIN}
    for name, each in prices.factors.items():
        of_all |= {
            f"{name} load": each.load * blocks,
            f"{name} analysis": each.analysis,
            f"{name} entries": each.entries / blocks,
            f"{name} factor": each.factor * blocks,
            f"{name} solve": each.solve * blocks,
        }
    return of_all


def table(name):
    """The prices of membrane and plate, small and large; SuperLU has no load and no analysis."""
    both = TABLE.get(name, {"membrane": [0.0, 0.0], "plate": [0.0, 0.0]})
    return np.array([both["membrane"], both["plate"]])


@pytest.mark.parametrize("kind", ROWS)
@pytest.mark.parametrize("size", [0, 1])
def test_the_prices_of_the_measured_matrices_are_those_of_the_table(kind, size):
    for name, price in prices_of(TABLE["blocks"][size], ROWS[kind]).items():
        assert price == pytest.approx(table(name)[[*ROWS].index(kind), size], rel=1e-2)


def test_prices_between_the_measured_matrices_are_their_geometric_mean():
    """Half-way on logarithmic scales of the blocks and of the blocks in a row."""
    blocks, in_row = (np.sqrt(np.prod(each)) for each in (TABLE["blocks"], [*ROWS.values()]))
    for name, price in prices_of(blocks, in_row).items():
        assert price == pytest.approx(np.prod(table(name)) ** 0.25, rel=1e-2)


def test_beyond_the_measured_matrices_prices_stay():
    """But for the entries of factors, which go on as a power of the blocks."""
    small, large = TABLE["blocks"]
    smallest, largest = prices_of(100, 2.0), prices_of(large**2 / small, 60.0)
    for name in largest:
        membrane, plate = table(name)
        beyond = plate[1] ** 2 / plate[0] if "entries" in name else plate[1]
        assert largest[name] == pytest.approx(beyond, rel=1e-2)
        assert "entries" in name or smallest[name] == pytest.approx(membrane[0])
