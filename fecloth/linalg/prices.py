"""What the operations of linear solvers cost: the prices by which the solver "auto" counts work.

The prices are measured by `studies.evidence.benchmarks.prices` on four matrices, and are in
prices.toml. A price of another matrix is interpolated, by its number of blocks and its blocks in
a row, and the same beyond these matrices; only the entries of factors go on as a power of the
number of blocks. All prices are in block products of conjugate gradients on the same matrix, so
that the speed of the machine does not matter.
"""

import math
import tomllib
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Self

import numpy as np

from fecloth.linalg.block_matrix import BlockPattern

FILE = Path(__file__).with_name("prices.toml")


@dataclass(frozen=True)
class FactorPrices:
    """What a direct solver costs on a matrix, in iterations of conjugate gradients.

    Attributes
    ----------
    load
        To load the library.
    analysis
        To analyse a new pattern.
    entries
        Entries of the factor, as far as the pattern tells.
    factor, solve
        Of a factorisation, and of a solve with the factor, for each of its entries.
    """

    load: float
    analysis: float
    entries: float
    factor: float
    solve: float


@dataclass(frozen=True)
class Prices:
    """What operations on a matrix cost, in iterations of conjugate gradients on that matrix.

    Attributes
    ----------
    tangent, residual
        Of Newton's iteration: to assemble the matrix, and to evaluate the forces.
    grids
        The aggregates of multigrid for a new pattern.
    coarse
        The coarse matrices of multigrid.
    refill
        To take a new matrix into multigrid whose coarse matrices stay.
    cycle
        An iteration of conjugate gradients whose preconditioner is a cycle of multigrid.
    pardiso, superlu
        Of the direct solvers.
    """

    tangent: float
    residual: float
    grids: float
    coarse: float
    refill: float
    cycle: float
    pardiso: FactorPrices
    superlu: FactorPrices

    @classmethod
    def of(cls, pattern: BlockPattern) -> Self:
        """Return the prices for matrices of a pattern."""
        table = _table()
        blocks = len(pattern.indices)
        rows = table["blocks in a row"]
        widths = np.log([np.mean(rows[kind]) for kind in ("membrane", "plate")])
        plate = np.interp(math.log(blocks / len(pattern)), widths, (0.0, 1.0))
        small, most = np.log(table["blocks"])
        large = (math.log(blocks) - small) / (most - small)

        def price(name: str, large: float = min(max(large, 0.0), 1.0)) -> float:
            """The geometric mean of the prices of four matrices, weighted by their likeness."""
            values = np.array([table[name]["membrane"], table[name]["plate"]])
            weights = np.outer((1.0 - plate, plate), (1.0 - large, large))
            return math.exp((weights * np.log(values)).sum())

        def factor_prices(name: str, load: float, analysis: float) -> FactorPrices:
            return FactorPrices(
                load=load,
                analysis=analysis,
                entries=price(f"{name} entries", large) * blocks,
                factor=price(f"{name} factor") / blocks,
                solve=price(f"{name} solve") / blocks,
            )

        plain = ("tangent", "residual", "grids", "coarse", "refill", "cycle")
        return cls(
            **{name: price(name) for name in plain},
            pardiso=factor_prices("pardiso", price("load") / blocks, price("analysis")),
            superlu=factor_prices("superlu", load=0.0, analysis=0.0),
        )


@cache
def _table() -> dict[str, Any]:
    """The file of prices."""
    return tomllib.loads(FILE.read_text(encoding="utf-8"))
