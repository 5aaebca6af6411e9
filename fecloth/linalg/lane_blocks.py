"""3×3 blocks as two lanes and a number, for kernels that add to a matrix.

The nine numbers of a block lie one after another. The first four are taken at once, then the
next four, and the last one by itself. The product of two vectors a bᵀ has the lanes

    (a₁, a₁, a₁, a₂) (b₁, b₂, b₃, b₁)      (a₂, a₂, a₃, a₃) (b₂, b₃, b₁, b₂)      a₃ b₃

so `as_rows` and `as_columns` are the lanes of a and of b. A vector has three numbers and a fourth
one that counts nothing. The blocks of a matrix are taken from one array of all their numbers, as
the compiler does not know that a row of `values` (b, 3, 3) has three numbers.
"""

from typing import Any

import numpy as np

from fecloth.compiled.jit import Array, inlined
from fecloth.compiled.lanes import group, load, multiply_add, number_of, reordered, repeat, store

Lanes = tuple[Any, Any, Any]
"""Two groups of four numbers, and a number."""

_rows_begin = reordered(0, 0, 0, 1)
_rows_end = reordered(1, 1, 2, 2)
_columns_begin = reordered(0, 1, 2, 0)
_columns_end = reordered(1, 2, 0, 1)


@inlined
def as_rows(a: Any) -> Lanes:
    """The lanes of a vector a in a bᵀ."""
    return _rows_begin(a), _rows_end(a), number_of(a, 2)


@inlined
def as_columns(b: Any) -> Lanes:
    """The lanes of a vector b in a bᵀ."""
    return _columns_begin(b), _columns_end(b), number_of(b, 2)


@inlined
def add_product(rows: Lanes, columns: Lanes, block: Lanes) -> Lanes:
    """`block` + a bᵀ for the `rows` of a and the `columns` of b."""
    return (
        multiply_add(rows[0], columns[0], block[0]),
        multiply_add(rows[1], columns[1], block[1]),
        rows[2] * columns[2] + block[2],
    )


@inlined
def add_to_diagonal(g: float, block: Lanes) -> Lanes:
    """`block` + g I."""
    first = group(g, 0.0, 0.0, 0.0)
    one = repeat(1.0)
    return (
        multiply_add(first, one, block[0]),
        multiply_add(first, one, block[1]),
        block[2] + g,
    )


@inlined
def block_of(numbers: Array, s: Any) -> Lanes:
    """Block s of a matrix, whose blocks have these `numbers` (9 b,)."""
    first = np.uintp(9) * s
    end = load(numbers, (first + np.uintp(4),))
    return load(numbers, (first,)), end, numbers[first + np.uintp(8)]


@inlined
def write_block(block: Lanes, numbers: Array, s: Any) -> None:
    """Write block s of a matrix, whose blocks have these `numbers` (9 b,)."""
    first = np.uintp(9) * s
    store(block[0], numbers, (first,))
    store(block[1], numbers, (first + np.uintp(4),))
    numbers[first + np.uintp(8)] = block[2]
