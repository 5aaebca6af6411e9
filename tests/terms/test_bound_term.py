"""A bound term has all abilities: its own, or those of `BoundTerm`, which do nothing."""

import numpy as np
import pytest
from support.wrong_calls import Foreign, Least, Stub

import fecloth as fc
from fecloth.terms.protocol import ALWAYS, BoundTerm, bound, has_own
from fecloth.terms.step_difference import StepDifference
from fecloth.terms.traits import TermTraits, traits_of
from studies.examples.term import BoundWinkler, Winkler

FABRIC = fc.Fabric(0.2, 1000.0)


def test_the_other_abilities_of_a_term_do_nothing():
    made = Least()
    term = bound(Stub(bound=made), None, None)
    assert term is made
    assert type(term) is Least
    x = np.zeros((2, 3))
    assert term.limit(x, x, 0.0) == 1.0
    assert term.over_step(None) is term
    assert term.way(0.0) is None
    assert term.coupling(x, x, 0.0, 1.0, 0.0, False) is None
    assert term.start_history(x, 0.0) is term.commit(x, 0.0) is None
    assert not any((term.load, term.supplies, term.limits_direction, term.needs_end))
    assert all(hasattr(term, name) for name in vars(BoundTerm))


def test_what_a_term_has_stays():
    term = bound(Stub(bound=BoundWinkler(np.ones(2), np.arange(2))), None, None)
    assert has_own(term, "energy")
    assert not term.supplies
    assert term.energy(np.ones((2, 3)), 0.0) == 1.0


@pytest.mark.parametrize("name", ["over_step", "with_history"])
def test_what_a_term_gives_for_a_step_derives_from_bound_term(name):
    class Record:
        pass

    class Changing(Least):
        def start_history(self, x, t):
            return Record()

    setattr(Changing, name, lambda self, argument: Foreign())
    system = fc.System(fc.Cloth.rectangle(1.0, 1.0, 1.0), FABRIC, [Stub(bound=Changing())])
    state = system.rest()
    history = system.start_history(state)
    step = StepDifference.between(state.x, 0.1, 0.0)
    arguments = {"over_step": (step, history), "with_history": (history,)}[name]
    message = rf"System: Least.{name}\(.*\) gives a Foreign: .* Write `class Foreign\("
    with pytest.raises(fc.InputError, match=message):
        getattr(system, name)(*arguments)


def test_every_name_of_a_bound_term_is_listed_once():
    assert set(ALWAYS[-3:]) <= set(vars(BoundTerm))
    assert all(hasattr(BoundTerm, name) or name in BoundTerm.__annotations__ for name in ALWAYS)


def test_traits_are_those_of_the_class_or_of_plain_attributes():
    assert traits_of(Winkler(1.0)) == TermTraits()

    class Plain:
        elements = ("P1", "P2")
        no_space_error = "has none"

    assert traits_of(Plain) == TermTraits(elements=("P1", "P2"), space_error="has none")
