"""Systems made beside a base: the same bits as without it, and only what changed is bound again."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from support.every_term import TERMS as EVERY

import fecloth as fc
from fecloth.fabric.panel import WatchedPanel
from fecloth.quantities.sameness import same
from fecloth.system.reuse import reusing
from fecloth.terms import protocol

FABRIC = fc.Fabric(0.2, 800.0, 0.3, bending_rigidity=(1e-3, 2e-3), bending_hysteresis=1e-4)
PLANE = fc.shapes.Plane((0.0, 0.0, -0.5), (0.0, 0.0, 1.0))


@dataclass(frozen=True)
class Foundation:
    """A term of a user, which reads the density when its force is asked for."""

    stiffness: float = 1.0

    def stencil(self, cloth):
        return None

    def bind(self, panel, slots):
        return BoundFoundation(panel, self.stiffness)


@dataclass(frozen=True, eq=False)
class BoundFoundation(fc.BoundTerm):
    panel: Any
    stiffness: float
    name = "Foundation"
    symmetric = True
    has_energy = False

    def add_force(self, x, v, t, f):
        f -= self.stiffness * self.panel.nodal_mass[:, None] * x

    def add_tangent(self, x, v, t, wx, wv, J, definite):
        """Do nothing: only the force is tested."""


TERMS = EVERY | {
    "Obstacle": fc.Obstacle(PLANE, gap=1e-2),
    "SelfContact": fc.SelfContact(gap=1e-3),
    "Foundation": Foundation(),
}
# Kinds of numbers of the fabric → the terms that use them.
OF_TENSION = {"StVK", "BaraffWitkin", "NeoHookean", "TensionField", "StrainRateDamping", "Springs"}
OF_DENSITY = {"MassDamping", "Gravity"}
OF_BENDING = {"HingeBending", "QuadraticBending", "PlateBending", "BendingDamping"}
# They read the whole fabric, so that any of its numbers binds them again.
OF_WHOLE_FABRIC = {"BendingFriction", "MembraneTable", "Obstacle", "SelfContact", "Foundation"}
CHANGES: dict[str, tuple[dict, set[str]]] = {
    "density": ({"areal_density": 0.21}, OF_DENSITY),
    "tension": ({"tensile_stiffness": 810.0}, OF_TENSION),
    "bending": ({"bending_rigidity": (1.1e-3, 2e-3)}, OF_BENDING),
}


def cloth(**more) -> fc.Cloth:
    plain = fc.Cloth.rectangle(1.0, 0.5, 0.25, pattern="right", **more)
    X = plain.X[plain.triangles].mean(axis=1)[:, 0]
    halves = {"body": np.flatnonzero(X < 0.5), "hem": np.flatnonzero(X >= 0.5)}
    return replace(plain, triangle_sets=halves)


def make(terms, fabric=FABRIC, **more) -> fc.System:
    plain = more.pop("cloth", None) or cloth()
    flat = fc.System(plain, FABRIC, []).rest()
    arguments: dict[str, Any] = {"pins": [fc.Pin("left")], "start": flat}
    return fc.System(plain, fabric, terms, **arguments | more)


def make_beside(base: fc.System, *args: Any, **more) -> fc.System:
    with reusing(base):
        return make(*args, **more)


def assert_same_bits(a: fc.System, b: fc.System) -> None:
    """Forces, energies, tangents and mass are the same at a bent, moving state."""
    x = a.rest().x
    x = 1.02 * x + 0.03 * np.sin(4 * x[:, [1, 2, 0]] + 3 * x[:, [0, 0, 1]])
    v = np.cos(3 * x)
    state = a.state(x, v, t=0.1)
    assert a.force(state).tobytes() == b.force(state).tobytes()
    assert a.energies(state) == b.energies(state)
    for name in ("stiffness", "damping"):
        assert same(getattr(a, name)(state).toarray(), getattr(b, name)(state).toarray()), name
    assert same(a.mass.toarray(), b.mass.toarray())


@pytest.mark.parametrize("name", TERMS)
@pytest.mark.parametrize("change", CHANGES)
def test_a_number_of_the_fabric_binds_the_terms_again_that_use_it(name, change):
    values, users = CHANGES[change]
    term = TERMS[name]
    changed = replace(FABRIC, **values)
    base = make([term, fc.MassDamping(0.5)])
    beside = make_beside(base, [term, fc.MassDamping(0.5)], changed)
    is_bound_again = type(term).__name__ in users | OF_WHOLE_FABRIC
    if is_bound_again:
        assert_same_bits(beside, make([term, fc.MassDamping(0.5)], changed))
    assert (beside.bound[0] is not base.bound[0]) == is_bound_again
    assert (beside.bound[1] is not base.bound[1]) == (change == "density")


@pytest.mark.parametrize("name", TERMS)
def test_the_same_arguments_give_the_same_bound_terms_on_an_equal_mesh(name):
    base = make([TERMS[name], fc.Gravity()])
    beside = make_beside(base, [TERMS[name], fc.Gravity()])
    assert all(new is old for new, old in zip(beside.bound, base.bound, strict=True))
    assert beside.cloth is base.cloth
    assert beside.scalar_mass is base.scalar_mass
    assert_same_bits(beside, make([TERMS[name], fc.Gravity()]))


def exchanged() -> dict[str, fc.Fabric]:
    stiff = replace(FABRIC, tensile_stiffness=950.0)
    return {"body": stiff, "hem": FABRIC}


def tilted(state: fc.State) -> fc.State:
    return replace(state, x=state.x + 0.1 * np.sin(5 * state.x[:, [1, 2, 0]]))


@pytest.mark.parametrize(
    "more",
    [
        {"grain": 0.3},
        {"mass": "consistent"},
        {"fabric": exchanged()},
        {"cloth": cloth(element="P2")},
        {"pins": [fc.Pin("left", clamp=True)]},
        {"pins": [fc.Pin("left", clamp=True, rotate=fc.Rotation((0, 0, 0), (0, 1, 0), "t"))]},
        {"start": tilted(make([fc.StVK()]).rest())},
        {"threads": 1},
    ],
    ids=str,
)
def test_other_arguments_give_the_same_bits_too(more):
    terms = [fc.StVK(), fc.PlateBending(rest="start"), fc.MassDamping(1.0), fc.Gravity()]
    assert_same_bits(make_beside(make(terms), terms, **more), make(terms, **more))
    assert_same_bits(make_beside(make(terms, **more), terms), make(terms))


@pytest.mark.parametrize("name", TERMS)
def test_terms_of_fecloth_read_nothing_that_they_have_not_read_when_they_were_bound(name):
    base = make([TERMS[name]])
    panel = WatchedPanel.of(base.panel)
    bound = protocol.bound(TERMS[name], panel, base.layout.slots)
    read_by_then = reads_of(panel)
    watched = base.with_bound([bound])
    assert_same_bits(watched, watched)
    for read in (bound.strain_error, bound.beyond, bound.energy):
        if protocol.has_own(bound, read.__name__):
            read(base.rest().x, 0.0)
    assert (reads_of(panel) != read_by_then) == (name == "Foundation")


def reads_of(panel: WatchedPanel) -> set[str]:
    return panel.names | {function.__qualname__ for function in panel.functions}


@pytest.mark.parametrize(
    ("a", "b", "expected"),
    [
        (1.0, 1.0, True),
        (1.0, np.nextafter(1.0, 2.0), False),
        (0.0, -0.0, False),
        (1, 1.0, False),
        ([1.0, "a"], [1.0, "a"], True),
        ((1.0,), [1.0], False),
        ({"a": 1, "b": 2}, {"b": 2, "a": 1}, False),
        (np.array([1.0, np.nan]), np.array([1.0, np.nan]), True),
        (np.array([1.0]), np.array([1], dtype=np.int64), False),
        (fc.Gravity((0, 0, -1.0)), fc.Gravity((0, 0, -1.0)), True),
        (fc.Gravity((0, 0, -1.0)), fc.Gravity((0, 0, -1.1)), False),
        (fc.Gravity(), fc.StVK(), False),
        (len, len, True),
        (lambda t: t, lambda t: t, False),
        (object(), object(), False),
    ],
)
def test_values_are_the_same_to_the_last_bit_or_not(a, b, expected):
    assert same(a, b) == expected
