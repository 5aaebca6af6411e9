"""Every term gives the same bits on one and on three threads."""

import numpy as np
import pytest
from support.every_term import FABRIC, TERMS, terms_on

import fecloth as fc
from fecloth.compiled.team import SMALLEST_SHARED_LOOP
from fecloth.linalg.block_matrix import BlockMatrix
from fecloth.terms.step_difference import StepDifference

GRID = [(element, name) for element in ("P1", "P2") for name in terms_on(element)]


@pytest.fixture(scope="module")
def cloths():
    """Meshes above the size at which threads share loops."""
    return {
        element: fc.Cloth.rectangle(1.0, 0.8, h=h, pattern="unstructured", element=element)
        for element, h in (("P1", 0.03), ("P2", 0.04))
    }


def evaluate(cloth, term, threads):
    """Force, tangents, energy and power on these threads, at x and over a step."""
    assert min(len(cloth.X), len(cloth.triangles)) >= SMALLEST_SHARED_LOOP
    system = fc.System(cloth, FABRIC, [term], threads=threads)
    rng = np.random.default_rng(3)
    x = 1.02 * system.rest().x + 5e-4 * rng.standard_normal((len(cloth.X), 3))
    v = 0.1 * rng.standard_normal(x.shape)
    (bound,) = system.bound
    results = []
    for each in (bound, *over_steps(bound, x - 1e-3 * v)):
        f = np.zeros_like(x)
        each.add_force(x, v, 0.1, f)
        results.append(f)
        for definite in (False, True):
            J = BlockMatrix.zeros(system.pattern, system.team)
            each.add_tangent(x, v, 0.1, 0.7, 0.3, J, definite)
            results.append(J.values)
        results.append(np.array([each.energy(x, 0.1)] if each.has_energy else []))
        results.append(np.array([each.power(x, v, 0.1)] if each.dissipative else []))
    return results


def over_steps(bound, start):
    """The term over a step of backward Euler, and over two of energy–momentum."""
    steps = [StepDifference(start, 0.01, 0.01, ((1.0, start),))]
    steps += [StepDifference(start, 0.01, 0.005, (), True, symmetric) for symmetric in (0, 1)]
    terms = [bound.over_step(step) for step in steps]
    return [term for term in terms if term is not bound]


@pytest.mark.parametrize(("element", "name"), GRID)
def test_the_bits_do_not_depend_on_the_threads(cloths, element, name):
    one, three = (evaluate(cloths[element], TERMS[name], threads) for threads in (1, 3))
    for a, b in zip(one, three, strict=True):
        assert np.array_equal(a, b, equal_nan=True)
