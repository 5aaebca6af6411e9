"""A bound term has all abilities: its own, or those of `BoundTerm`, which do nothing."""

import numpy as np
import pytest

import fecloth as fc
from fecloth.terms.protocol import ABILITIES, ALWAYS, BoundTerm, bound, complete, has_own
from fecloth.terms.traits import TermTraits, traits_of
from studies.examples.term import BoundWinkler, Winkler


class Least:
    """A bound term with no more than it must have."""

    name, symmetric, has_energy = "Least", True, False
    dissipative = velocity_dependent = False

    def add_force(self, x, v, t, f):
        f[:, 2] -= 1.0

    def add_tangent(self, x, v, t, wx, wv, J, definite):
        pass


class Slotted(Least):
    __slots__ = ("weight",)


class Wrapped:
    """A bound term that asks another for what it has not itself."""

    def __init__(self, inner):
        self.inner = inner

    def __getattr__(self, name):
        return getattr(self.inner, name)


class Description:
    """A description of any bound term."""

    def __init__(self, made):
        self.made = made

    def stencil(self, cloth):
        return None

    def bind(self, panel, slots):
        return self.made


def bind(made):
    return bound(Description(made), None, None)


@pytest.mark.parametrize("kind", [Least, Slotted])
def test_a_term_of_its_own_gets_what_it_lacks(kind):
    made = kind()
    term = bind(made)
    assert term is made
    assert isinstance(term, kind)
    assert type(term).__name__ == kind.__name__
    x = np.zeros((2, 3))
    assert term.limit(x, x, 0.0) == 1.0
    assert term.over_step(None) is term
    assert term.way(0.0) is None
    assert term.coupling(x, x, 0.0, 1.0, 0.0, False) is None
    assert term.start_history(x, 0.0) is term.commit(x, 0.0) is None
    assert not any((term.load, term.supplies, term.limits_direction, term.needs_end))
    assert all(hasattr(term, name) for name in ABILITIES)
    assert complete(term) is term
    assert type(bind(kind())) is type(term)


def test_what_a_term_has_stays():
    term = bind(BoundWinkler(np.ones(2), np.arange(2)))
    assert has_own(term, "energy")
    assert not term.supplies
    assert term.energy(np.ones((2, 3)), 0.0) == 1.0


def test_a_wrapper_has_the_abilities_of_what_it_wraps():
    class Limited(Least):
        needs_end = "it must"

        def limit(self, x, s, t):
            return 0.5

    term = bind(Wrapped(bind(Limited())))
    assert term.needs_end == "it must"
    assert term.limits_direction
    assert term.limit(None, None, 0.0) == 0.5


def test_a_term_without_what_every_term_has_is_refused():
    class Nothing(BoundTerm):
        name = "Nothing"

    with pytest.raises(fc.InputError, match="must have symmetric, has_energy, .*add_force"):
        bind(Nothing())

    class NoEnergy(Least, BoundTerm):
        has_energy = dissipative = True

    with pytest.raises(fc.InputError, match="gives a NoEnergy: must have energy, power"):
        bind(NoEnergy())
    with pytest.raises(fc.InputError, match="must have name"):
        bind(3)


def test_every_name_of_a_bound_term_is_listed_once():
    assert set(ALWAYS[-3:]) <= set(vars(BoundTerm))
    assert not set(ALWAYS) & set(ABILITIES)


def test_traits_are_those_of_the_class_or_of_plain_attributes():
    assert traits_of(Winkler(1.0)) == TermTraits()

    class Plain:
        elements = ("P1", "P2")
        no_space_error = "has none"

    assert traits_of(Plain) == TermTraits(elements=("P1", "P2"), space_error="has none")

    class Wrong:
        traits = "bending"

    with pytest.raises(fc.InputError, match="Wrong.traits = 'bending': must be a TermTraits"):
        traits_of(Wrong())
    with pytest.raises(fc.InputError, match="kind = 'bend': must be one of"):
        TermTraits(kind="bend")
    for elements in ("P1", ("P3",), ()):
        with pytest.raises(fc.InputError, match="elements = .*: must be "):
            TermTraits(elements=elements)
