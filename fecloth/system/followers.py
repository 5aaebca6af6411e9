"""What a system asks of nodes that follow other nodes; here no node follows another."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy.sparse as sparse

from fecloth.compiled.calls import Call
from fecloth.linalg.block_matrix import BlockPattern

NONE = np.zeros(0, np.int64)


class Followers:
    """The nodes F that follow leaders, x_F = W x_L + g: here none. `SewnNodes` has some.

    T has the rows W for nodes that follow, and those of the unit matrix for all others.

    Attributes
    ----------
    nodes
        (k,) the nodes that follow.
    closes
        Whether there is a gap g, which closes.
    """

    nodes = NONE
    closes = False

    def gather(self, f: np.ndarray) -> np.ndarray:
        """Tᵀ f (n, 3) in place: forces on nodes that follow act on their leaders."""
        return f

    def gather_calls(self, f: np.ndarray) -> Sequence[Call]:
        """The calls that do so."""
        return ()

    def follow(self, y: np.ndarray) -> np.ndarray:
        """T y (n, 3) in place: nodes that follow move as their leaders do."""
        return y

    def place(self, y: np.ndarray, target: np.ndarray) -> None:
        """y_F = W y_L + g in place, with g = target_F − W target_L where there is a gap."""

    def gap(self, y: np.ndarray) -> np.ndarray:
        """y_F − W y_L (k, 3)."""
        return np.zeros((0, 3))

    def gaps(self, x: np.ndarray) -> dict[str, float]:
        """By its column, the largest gap of each seam that closes, at x (n, 3) [m]."""
        return {}

    def close(self, t: float, later: float, old: np.ndarray, x: np.ndarray, v: np.ndarray) -> None:
        """Set x_F and v_F of x and v (n, 3) at `later`, from the positions `old` at t [s]."""

    def gathered(self, mass: Any) -> Any:
        """Tᵀ m of masses (n,), or Tᵀ M T of a matrix (n, n); a diagonal matrix stays so."""
        return mass

    def condense(self, A: sparse.spmatrix) -> sparse.spmatrix:
        """Tᵀ A T (3n, 3n)."""
        return A

    def extend(self, Z: sparse.csc_matrix) -> sparse.csc_matrix:
        """T Z (3n, f)."""
        return Z

    def stencils(self, stencils: tuple[np.ndarray, ...]) -> tuple[np.ndarray, ...]:
        """The stencils, and one with the pairs of nodes that are coupled through leaders."""
        return stencils

    def spread(self, pattern: BlockPattern) -> tuple[np.ndarray, ...]:
        """Where the blocks of nodes that follow go: source, row, column and weight (e,) of each."""
        return NONE, NONE, NONE, np.zeros(0)


NO_FOLLOWERS = Followers()
