"""Inverses of the diagonal blocks of a `BlockMatrix`: the block-Jacobi preconditioner."""

from __future__ import annotations

import numpy as np

from fecloth.compiled.jit import Array, kernel
from fecloth.errors import IndefiniteMatrix, SolveFailed
from fecloth.linalg.block_matrix import BlockMatrix


def invert_diagonal(A: BlockMatrix, inverse: np.ndarray, name: str) -> None:
    """Write the inverses of the diagonal blocks (n, 6); see `invert_blocks`.

    Raises `IndefiniteMatrix` if a block is not positive definite, and `SolveFailed` if it is not
    finite. `name` begins the message.
    """
    node = invert_blocks(A.pattern.diagonal, A.values, inverse)
    if node < 0:
        return
    block, where = A.values[A.pattern.diagonal[node]], f"the diagonal block of node {node}"
    if not np.isfinite(block).all():
        raise SolveFailed(f"{name}: A is not finite: {where} is {block.tolist()}")
    eigenvalues = np.linalg.eigvalsh(block)
    raise IndefiniteMatrix(
        f"{name}: {where} is not positive definite, its eigenvalues are {eigenvalues}"
    )


@kernel
def invert_blocks(diagonal: Array, values: Array, inverse: Array) -> int:
    """Invert the symmetric diagonal blocks by their cofactors.

    Parameters
    ----------
    diagonal
        (n,) numbers of the diagonal blocks in `values` (b, 3, 3).
    inverse
        (n, 6) output: entries 11, 22, 33, 23, 13, 12 of the inverses.

    Returns
    -------
    The first node whose block is not positive definite (Sylvester's criterion), or −1.
    """
    for i in range(len(diagonal)):
        a = values[diagonal[i]]
        c11 = a[1, 1] * a[2, 2] - a[1, 2] * a[1, 2]
        c12 = a[0, 2] * a[1, 2] - a[0, 1] * a[2, 2]
        c13 = a[0, 1] * a[1, 2] - a[0, 2] * a[1, 1]
        c33 = a[0, 0] * a[1, 1] - a[0, 1] * a[0, 1]
        det = a[0, 0] * c11 + a[0, 1] * c12 + a[0, 2] * c13
        if not (a[0, 0] > 0.0 and c33 > 0.0 and det > 0.0):  # also true of NaN
            return i
        inverse[i, 0] = c11 / det
        inverse[i, 1] = (a[0, 0] * a[2, 2] - a[0, 2] * a[0, 2]) / det
        inverse[i, 2] = c33 / det
        inverse[i, 3] = (a[0, 1] * a[0, 2] - a[0, 0] * a[1, 2]) / det
        inverse[i, 4] = c13 / det
        inverse[i, 5] = c12 / det
    return -1
