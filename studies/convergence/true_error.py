"""The error of a state whose strain or curvature is known, in the norm of the energy."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

import fecloth as fc
from fecloth.mesh.recovery import CONSTANT
from fecloth.terms.strain_errors import energy_of_gap, voigt_matrix

Field = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True, eq=False)
class Solved:
    """A state in equilibrium, with the exact (E11, E22, E12) and (κ11, κ22, 2κ12) of X (p, 2)."""

    system: fc.System
    state: fc.State
    strain: Field = lambda X: np.zeros((len(X), 3))
    curvature: Field = lambda X: np.zeros((len(X), 3))


def true_error(solved: Solved) -> float:
    """Return ∫ ½ (E − exact):ℂ:(E − exact) + ½ (κ − exact):D:(κ − exact) dA [J]."""
    cloth, x, total = solved.system.cloth, solved.state.x, 0.0
    for term in solved.system.bound:
        if hasattr(term, "sampled_strain"):
            values, moduli, samples = term.sampled_strain(x)
            exact = solved.strain(_points(cloth.X, cloth.stencil[:, :3], samples.rule))
            gap = np.einsum("rq,tqc->trc", samples.extend, values) - exact.reshape(
                -1, *_shape(samples)
            )
            area = cloth.weights.sum(axis=1)
            total += energy_of_gap(gap * [1, 1, 2], voigt_matrix(moduli), samples, area).sum()
        elif hasattr(term, "curvatures"):
            values, rigidity = term.curvatures(x, solved.state.t)
            edges = cloth.edge_slopes.edges
            exact = solved.curvature(_points(edges.X, edges.triangles, CONSTANT.rule))
            gap = values[:, None] - exact.reshape(-1, *_shape(CONSTANT))
            total += energy_of_gap(gap, rigidity, CONSTANT, edges.area).sum()
    return float(total)


def _points(X, triangles, rule):
    return np.einsum("ri,tid->trd", rule, X[triangles]).reshape(-1, 2)


def _shape(samples):
    return len(samples.rule), 3
