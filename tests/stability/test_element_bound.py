"""The bound by rows is never unsafe: for every term, alone and on a membrane, on any mesh."""

from functools import cache

import numpy as np
import pytest
from support.every_term import FABRIC, TERMS, terms_on
from support.tiers import stories_except

import fecloth as fc
from fecloth.stability.critical_step import critical_dt, element_bound

LEFT = fc.Pin(lambda X: X[:, 0] < 1e-9)
NO_BOUND = {"Gas", "Obstacle", "MeshObstacle", "SelfContact"}  # at rest nothing acts


def slivers():
    """Rows of right triangles with one node moved, so that one triangle's angle is 3°."""
    cloth = fc.Cloth.rectangle(1.0, 1.0, h=0.2, pattern="right")
    X, middle = cloth.X.copy(), np.argmin(np.sum((cloth.X - 0.4) ** 2, axis=1))
    X[middle, 0] += 0.18
    return fc.Cloth.from_arrays(X, cloth.triangles)


PATTERNS = ("right", "cross", "equilateral", "unstructured")
MESHES = [*PATTERNS, "disk", "sliver", *(f"P2 {pattern}" for pattern in (*PATTERNS, "disk"))]


@cache
def mesh(name):
    if name.endswith("disk"):
        return fc.Cloth.disk(0.5, 0.15) if name == "disk" else fc.Cloth.disk(0.5, 0.3, "P2")
    if name == "sliver":
        return slivers()
    *quadratic, pattern = name.split()
    if quadratic:
        return fc.Cloth.rectangle(1.0, 0.6, h=0.4, pattern=pattern, element="P2")
    return fc.Cloth.rectangle(1.0, 0.6, h=0.2, pattern=pattern)


def test_no_term_is_left_out():
    known = set(fc.terms.__all__)
    tested = {type(term).__name__ for term in TERMS.values()} - {"Condition"}
    assert tested | NO_BOUND == known


@pytest.mark.parametrize("name", stories_except(MESHES, "sliver", "P2 right"))
def test_it_is_never_unsafe(name):
    cloth = mesh(name)
    for name, term in terms_on(cloth.element).items():
        check_bounds(cloth, name, term)


def check_bounds(cloth, name, term):
    """The bound for a term, alone and on a membrane, is safe and worth something."""
    for terms in ([term], [fc.StVK(), term]):
        for mass, pins in (
            ("lumped", []),
            ("lumped", [fc.Pin(lambda X: X[:, 0] < 1e-9)]),
            ("consistent", []),
        ):
            system = fc.System(cloth, FABRIC, terms, pins, mass)
            limit, bound = critical_dt(system, system.rest()), element_bound(system)
            assert bound <= limit * (1 + 1e-9), (name, mass, pins)
            if len(terms) == 2 and cloth.element == "P1" and name != "plate damping":
                assert bound > (0.75 if mass == "lumped" else 0.6) * limit, (name, mass, pins)


@pytest.mark.parametrize("name", ["StVK", "structural", "StrainRateDamping", "Tether", "Wind"])
@pytest.mark.parametrize(
    "method", [fc.CentralDifference(), fc.Newmark(0.1, 0.5), fc.Newmark(0.2, 0.7)], ids=repr
)
def test_nor_for_other_methods(name, method):
    cloth = mesh("unstructured")
    system = fc.System(cloth, FABRIC, [fc.StVK(), TERMS[name]])
    assert 0 < element_bound(system, method) <= critical_dt(system, system.rest(), method)


@pytest.mark.parametrize("h", [0.1, 0.05])
@pytest.mark.parametrize("terms", [[fc.StVK()], [fc.StVK(), fc.HingeBending()]], ids=len)
def test_it_is_close_on_good_gmsh_meshes(terms, h):
    soft = fc.Fabric(0.2, 1000.0, 0.3, bending_rigidity=1e-4)
    for cloth in (fc.Cloth.rectangle(1.0, 0.7, h=h), fc.Cloth.disk(0.5, h)):
        system = fc.System(cloth, soft, terms)
        assert 1 <= critical_dt(system, system.rest()) / element_bound(system) < 1.1
