"""What pins and obstacles do to a cloth that no step can follow, by names."""

from itertools import combinations

import numpy as np

from fecloth.system.state import State
from fecloth.system.system import System
from fecloth.terms.contact.bound_contact import BoundContact
from fecloth.terms.contact.inside import MOST_NAMED

SPANS = 2.0 ** np.arange(-12, 1)  # parts of a step at which a collision is looked for


def name_no_room(system: System, state: State, horizon: float) -> str:
    """Return what the pins and the obstacles lead the cloth into within `horizon` [s], or "".

    It is the first event of these: nodes that pins hold completely pass into an obstacle, or
    edges and triangles of such nodes through others; or two obstacles pass through each other.
    """
    contacts = [pair for pair in system.named if isinstance(pair[1], BoundContact)]
    if not contacts:
        return ""
    for dt in horizon * SPANS:
        words = _name_held(system, state, dt, contacts) or _name_two(state, dt, contacts)
        if words:
            return words
    return ""


def _name_held(system: System, state: State, dt: float, contacts) -> str:
    """Return which held nodes the pins would lead into an obstacle, or into each other."""
    constraints = system.constraints
    end, _ = constraints.target(state.t, dt, state.x)
    held = constraints.nodes[~constraints.projectors.any(axis=(1, 2))]
    for name, term in contacts:
        struck = term.struck(state.x, end, state.t, dt, held)
        if not len(struck):
            continue
        groups = constraints.groups.items()
        pins = [pin for pin, (_, nodes) in groups if np.isin(struck, nodes).any()]
        by = f"the pin{'s' * (len(pins) > 1)} {' and '.join(pins)}"
        where = f"into {name}"
        if term.name == "SelfContact":
            where = "through each other"
        count = "a held node"
        if len(struck) > 1:
            count = f"{len(struck)} held nodes"
        return f"{by} would lead {count} {where}: {_numbers(struck)}"
    return ""


def _name_two(state: State, dt: float, contacts) -> str:
    """Return which two obstacles would pass through each other, or "".

    They do where a node is deeper in one than it is far from the other.
    """
    rooms = [(name, term.room(state.x, state.t + dt)) for name, term in contacts]
    for (name, first), (other, second) in combinations(rooms, 2):
        squeezed = np.flatnonzero(first + second < 0.0)
        if len(squeezed):
            return (
                f"{name} and {other} would pass through each other, and leave no room for the "
                f"node{'s' * (len(squeezed) > 1)} {_numbers(squeezed)}"
            )
    return ""


def _numbers(nodes: np.ndarray) -> str:
    """Return the first of the nodes, as a list."""
    return ", ".join(map(str, nodes[:MOST_NAMED])) + ", …" * (len(nodes) > MOST_NAMED)
