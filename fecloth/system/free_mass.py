"""The mass along the directions that pins leave free, for velocities that impulses change."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sparse
from scipy.sparse.linalg import SuperLU, splu

from fecloth.system.constraints import Constraints


@dataclass(frozen=True, eq=False)
class FreeMass:
    """ZᵀMZ, with the basis Z (3n, f) of the motions that pins and slides allow.

    Attributes
    ----------
    scalar_mass
        Mass matrix (n, n) of one component [kg].
    constraints
        The pins and slides.
    """

    scalar_mass: sparse.csr_matrix
    constraints: Constraints

    @cached_property
    def basis(self) -> sparse.csc_matrix:
        """Z (3n, f); see `Constraints.admissible`."""
        return self.constraints.admissible(self.scalar_mass.shape[0])

    @cached_property
    def _free(self) -> sparse.csc_matrix:
        """ZᵀMZ (f, f)."""
        mass = sparse.kron(self.scalar_mass, sparse.identity(3), format="csr")
        return (self.basis.T @ mass @ self.basis).tocsc()

    @cached_property
    def _factor(self) -> SuperLU | None:
        """A factor of ZᵀMZ; None where it is diagonal."""
        if self._free.nnz == self._free.shape[0]:
            return None
        return splu(self._free)

    def changes(self, rows: sparse.csr_matrix) -> sparse.csc_matrix:
        """Return the changes (3n, m) of v by unit impulses along each of the rows (m, 3n).

        They are Z (ZᵀMZ)⁻¹ Zᵀ rowsᵀ [1/kg].
        """
        impulses = (self.basis.T @ rows.T).tocsc()
        if self._factor is None:
            inverse = sparse.diags(1 / self._free.diagonal())
            return (self.basis @ (inverse @ impulses)).tocsc()
        dense: np.ndarray = self._factor.solve(impulses.toarray())
        return (self.basis @ sparse.csc_matrix(dense)).tocsc()
