"""Derivatives of an equilibrium: how many corrections they take, and which terms are asked."""

from dataclasses import dataclass, field

import numpy as np
import pytest

import fecloth as fc
from fecloth.nonlinear import increment_derivatives
from fecloth.nonlinear.along import Along, Sides
from fecloth.simulation.derived_loads import DerivedLoads, find_rest
from fecloth.system.reuse import reusing

CLOTH = fc.Cloth.rectangle(1.0, 0.5, 0.25, pattern="right")
CHANGE = 1e-5  # of a parameter, over its value


@dataclass(frozen=True)
class Weight:
    """A weight that counts how often its force is asked for."""

    calls: list[int] = field(default_factory=list)

    def stencil(self, cloth):
        return None

    def bind(self, panel, slots):
        return BoundWeight(self.calls)


@dataclass(frozen=True, eq=False)
class BoundWeight(fc.BoundTerm):
    calls: list[int]
    name = "Weight"
    symmetric = True
    has_energy = False

    def add_force(self, x, v, t, f):
        self.calls.append(1)
        f[:, 2] -= 0.01

    def add_tangent(self, x, v, t, wx, wv, J, definite):
        """Do nothing: the force is constant."""


def blown(Y=300.0, p=1.0, more=()) -> fc.System:
    """A sheet with a free border, for which the tangent of the pressure is not symmetric."""
    fabric = fc.Fabric(0.2, Y, 0.3, bending_rigidity=1e-2)
    terms = [fc.StVK(), fc.PlateBending(), fc.Pressure(p), fc.Gravity((3.0, 0.0, -9.81)), *more]
    return fc.System(CLOTH, fabric, terms, pins=[fc.Pin("left", clamp=True)])


def sides_of(base: fc.System, **values: float) -> Sides:
    """The systems with the values times 1 ± CHANGE, beside the base."""
    sides = []
    with reusing(base):
        for factor in (1 + CHANGE, 1 - CHANGE):
            changed = {name: factor * value for name, value in values.items()}
            sides.append(blown(**changed, more=base.terms[4:]))
    return Sides(*sides, CHANGE)


def loads_of(base: fc.System) -> DerivedLoads:
    rest = find_rest(base, base.rest())
    return DerivedLoads.at_rest(base, base.rest(), rest, 1e-5)


STILL = Along(np.zeros((len(CLOTH.X), 3)), np.zeros((len(CLOTH.X), 3)))  # the start does not move


@pytest.mark.parametrize("is_exact", [True, False])
def test_exact_tangents_need_no_further_corrections(is_exact, monkeypatch):
    if not is_exact:
        monkeypatch.setattr(increment_derivatives, "with_exact_tangents", lambda system: system)
    base = blown()
    loads = loads_of(base)
    loads.derive(STILL, sides_of(base, Y=300.0))
    contraction = loads.path[0][1].known["exact"]
    assert (contraction < 1e-5) == is_exact


def test_terms_that_do_not_use_the_parameter_are_not_asked():
    weight = Weight()
    base = blown(more=[weight])
    loads = loads_of(base)
    loads.derive(STILL, sides_of(base, p=1.0))  # the first one measures the contraction
    weight.calls.clear()
    loads.derive(STILL, sides_of(base, p=1.0))
    assert not weight.calls


def test_the_derivative_is_the_difference_of_two_equilibria():
    base = blown()
    loads = loads_of(base)
    sides = sides_of(base, p=1.0)
    derived = loads.derive(STILL, sides).end.x
    plus, minus = (find_rest(system, base.rest()).x for system in (sides.plus, sides.minus))
    expected = (plus - minus) / (2 * CHANGE)
    assert np.abs(derived - expected).max() < 1e-5 * np.abs(expected).max()


def test_an_equilibrium_is_polished_to_round_off():
    base = blown()
    rough = fc.equilibrium(base, base.rest(), tolerance=1e-5)
    polished = DerivedLoads.at_rest(base, base.rest(), rough, 1e-5).step.state
    force_left = np.linalg.norm(base.constraints.project(base.force(polished)))
    assert force_left < 1e-12 * base.force_size(base.force(polished))
    assert np.linalg.norm(base.constraints.project(base.force(rough))) > 1e3 * force_left
