"""Meshes, linear solutions and series for tests of plates."""

import numpy as np
import pytest
from scipy.sparse.linalg import spsolve

import fecloth as fc
from studies.bending.meshes import PATTERNS as PATTERNS
from studies.bending.meshes import on_sides as on_sides
from studies.bending.meshes import square as square

BENDING = {"areal_density": 1.0, "tensile_stiffness": 1e3, "bending_rigidity": 1.0}


def rolled(X, radius):
    """The sheet rolled without stretch on a cylinder about the Y axis."""
    angle = X[:, 0] / radius
    return np.column_stack([radius * np.sin(angle), X[:, 1], radius * (1 - np.cos(angle))])


def plate(cloth, fabric, pins=(), **options):
    return fc.System(cloth, fabric, [fc.PlateBending(**options)], pins=pins)


def flying(cloth, fabric, membrane):
    """A free sheet, bent, that turns and swings, and its start."""
    system = fc.System(cloth, fabric, [membrane, fc.PlateBending()])
    X = cloth.X
    x = np.column_stack([X, 0.15 * np.sin(2.5 * X[:, 0] + X[:, 1])])
    v = np.cross([1.0, 3.0, 2.0], x) + np.sin(5 * x[:, ::-1])
    return system, system.state(x, v)


def check_slopes(system, state):
    """The errors of central differences of the only term fall with the square of the step."""
    (term,), d = system.bound, np.random.default_rng(5).normal(size=state.x.shape)
    f, J, errors = system.force(state), system.stiffness(state), []
    for step in (4e-5, 1e-5):
        plus, minus = (system.state(state.x + s * step * d) for s in (1, -1))
        work = (term.energy(plus.x, 0.0) - term.energy(minus.x, 0.0)) / (2 * step)
        change = (system.force(plus) - system.force(minus)) / (2 * step)
        product = (J @ d.ravel()).reshape(-1, 3)
        errors.append([work + np.sum(f * d), np.abs(change + product).max()])
    assert np.abs(np.divide(*errors)) == pytest.approx([16, 16], rel=0.3)


def transverse(system):
    """(n, n) the stiffness against deflections about flat [N/m]."""
    return system.stiffness(system.rest()).tocsr()[2::3, 2::3].tocsc()


def deflection(system, load, held=None, w=None):
    """(n,) deflection under nodal forces, with the values `w` at the `held` nodes."""
    K = transverse(system)
    if held is None:
        held = np.zeros(len(load), bool)
        held[system.constraints.nodes] = True
    w = np.zeros(len(load)) if w is None else w.copy()
    free = ~held
    w[free] = spsolve(K[free][:, free], load[free] - K[free][:, held] @ w[held])
    return w


def uniform_load(cloth):
    return cloth.weighted_load(np.ones(len(cloth.triangles)))


def navier(X, D, terms=60):
    """Deflection of a simply supported unit square of the rigidities D under the load 1."""
    (D11, D12), D22, D66 = D[0, :2], D[1, 1], D[2, 2]
    w = np.zeros(len(X))
    for m in range(1, terms, 2):
        for n in range(1, terms, 2):
            stiffness = D11 * m**4 + 2 * (D12 + 2 * D66) * (m * n) ** 2 + D22 * n**4
            amplitude = 16 / (np.pi**6 * m * n * stiffness)
            w += amplitude * np.sin(m * np.pi * X[:, 0]) * np.sin(n * np.pi * X[:, 1])
    return w
