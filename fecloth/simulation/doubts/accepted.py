"""Remedies that can be followed: whether a system would accept another choice.

A remedy that names an element, a method or a term is offered only if the cloth, the fabric and
the other terms accept it.
"""

from typing import Any

from fecloth.errors import InputError
from fecloth.integrators.protocol import check_terms
from fecloth.mesh.cloth import Cloth
from fecloth.system.system import System
from fecloth.terms.traits import traits_of


def accepts_element(system: System, element: str) -> bool:
    """Return whether all terms of a system know an element, "P1" or "P2"."""
    return all(element in traits_of(term).elements for term in system.terms)


def accepts_method(system: System, method: Any) -> bool:
    """Return whether a method can step the terms of a system."""
    try:
        check_terms(system, method, where="")
        if method.traits.explicit:
            method.check(system)
    except InputError:
        return False
    return True


def accepts_term(system: System, term: Any) -> bool:
    """Return whether a term fits the element and each fabric of a system.

    It is tried on a cloth of two triangles, so that a large mesh takes no time.
    """
    element = system.cloth.element
    cloth = Cloth.rectangle(1.0, 1.0, h=1.0, pattern="right", element=element)
    try:
        for fabric in system.panel.fabrics:
            System(cloth, fabric, [term])
    except InputError:
        return False
    return True


def join_accepted(remedies: dict[str, bool]) -> str:
    """Return the remedies that are accepted as one phrase: "a, b or c"; "" for none."""
    words = [remedy for remedy, is_accepted in remedies.items() if is_accepted]
    if len(words) < 2:
        return "".join(words)
    return f"{', '.join(words[:-1])} or {words[-1]}"
