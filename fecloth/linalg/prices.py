"""What operations cost: the prices by which the solver and the method "auto" count work.

The prices are measured by `studies.evidence.benchmarks.prices` on four matrices, and are in
prices.toml. A price of another matrix is interpolated, by its number of blocks and its blocks in
a row, and the same beyond these matrices; only the entries of factors go on as a power of the
number of blocks. All prices are in block products of conjugate gradients on the same matrix, so
that the speed of the machine does not matter. What Python takes for a row or an iteration, on a
matrix of any size, is in block products of the smallest of these matrices.
"""

import math
import tomllib
from collections.abc import Mapping
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
    factors
        Of each direct solver, by its name.
    """

    tangent: float
    residual: float
    grids: float
    coarse: float
    refill: float
    cycle: float
    factors: Mapping[str, FactorPrices]

    @classmethod
    def of(cls, pattern: BlockPattern) -> Self:
        """Return the prices for matrices of a pattern."""
        price = Likeness.of(pattern).price
        blocks = len(pattern.indices)

        def factor_prices(name: str) -> FactorPrices:
            once = [f"{name} load", f"{name} analysis"]  # SuperLU has neither
            load, analysis = (price(row) if row in _table() else 0.0 for row in once)
            return FactorPrices(
                load=load / blocks,
                analysis=analysis,
                entries=price(f"{name} entries", beyond=True) * blocks,
                factor=price(f"{name} factor") / blocks,
                solve=price(f"{name} solve") / blocks,
            )

        plain = ("tangent", "residual", "grids", "coarse", "refill", "cycle")
        return cls(
            **{name: price(name) for name in plain},
            factors={name: factor_prices(name) for name in ("pardiso", "rslab", "superlu")},
        )


@dataclass(frozen=True)
class StepPrices:
    """What steps in time cost beside their linear solves, in iterations of conjugate gradients.

    Attributes
    ----------
    fused
        Of an explicit step in a compiled loop.
    row
        Of an explicit step that ends in Python, with the row that records it.
    implicit_row
        Of the row of an implicit step, with the estimate of its error in time.
    iteration
        Of Newton's iteration, beside the operations that are in `Prices`.
    """

    fused: float
    row: float
    implicit_row: float
    iteration: float

    @classmethod
    def of(cls, pattern: BlockPattern) -> Self:
        """Return the prices for a system whose matrix has a pattern."""
        price = Likeness.of(pattern).price
        python = _table()["products in Python"]
        blocks = len(pattern.indices)
        return cls(
            fused=price("fused"),
            row=price("row") + python["row"] / blocks,
            implicit_row=price("implicit row") + python["implicit row"] / blocks,
            iteration=python["iteration"] / blocks,
        )


@dataclass(frozen=True)
class Likeness:
    """How like a matrix is to the four whose prices are in the table.

    Attributes
    ----------
    plate
        0 for as many blocks in a row as of a membrane, 1 for as many as of a plate.
    large
        0 for as many blocks as the small matrices, 1 for as many as the large ones; less or more
        beyond these.
    """

    plate: float
    large: float

    @classmethod
    def of(cls, pattern: BlockPattern) -> Self:
        """Return the likeness of the matrices of a pattern."""
        table = _table()
        blocks = len(pattern.indices)
        rows = table["blocks in a row"]
        widths = np.log([np.mean(rows[kind]) for kind in ("membrane", "plate")])
        small, most = np.log(table["blocks"])
        return cls(
            plate=float(np.interp(math.log(blocks / len(pattern)), widths, (0.0, 1.0))),
            large=(math.log(blocks) - small) / (most - small),
        )

    def price(self, name: str, beyond: bool = False) -> float:
        """The geometric mean of the prices of four matrices, weighted by their likeness.

        `beyond`: the price goes on as a power beyond the sizes of these matrices.
        """
        large = self.large if beyond else min(max(self.large, 0.0), 1.0)
        values = np.array([_table()[name][kind] for kind in ("membrane", "plate")])
        weights = np.outer((1.0 - self.plate, self.plate), (1.0 - large, large))
        return math.exp((weights * np.log(values)).sum())


@cache
def _table() -> dict[str, Any]:
    """The file of prices."""
    return tomllib.loads(FILE.read_text(encoding="utf-8"))
