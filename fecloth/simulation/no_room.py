"""What pins and obstacles do to a cloth that no step can follow, by names."""

from itertools import combinations

import numpy as np

from fecloth.system.state import State
from fecloth.system.system import System
from fecloth.terms.contact.bound_contact import BoundContact

MOST_NAMED = 5  # nodes that an error names
SPANS = 2.0 ** np.arange(-12, 1)


def name_no_room(system: System, state: State, horizon: float) -> str:
    """Return what the pins and the obstacles lead the cloth into within `horizon` [s], or "".

    It is the first event of these: nodes that pins hold completely pass into an obstacle, or
    edges and triangles of such nodes through others; or two obstacles pass through each other.
    """
    contacts = [pair for pair in system.named if isinstance(pair[1], BoundContact)]
    for dt in horizon * SPANS if contacts else ():
        if words := _name_held(system, state, dt, contacts) or _name_two(state, dt, contacts):
            return words
    return ""


def _name_held(system: System, state: State, dt: float, contacts) -> str:
    constraints = system.constraints
    end = constraints.target(state.t, dt, state.x)[0]
    held = constraints.nodes[~constraints.projectors.any(axis=(1, 2))]
    for name, term in contacts:
        struck = term.struck(state.x, end, state.t, dt, held)
        if len(struck):
            groups = constraints.groups.items()
            pins = [pin for pin, (_, nodes) in groups if np.isin(struck, nodes).any()]
            if term.name == "SelfContact":
                where = "through each other"
            else:
                where = f"into {name}"
            if len(struck) == 1:
                count = "a held node"
            else:
                count = f"{len(struck)} held nodes"
            by = f"the pin{'s' * (len(pins) > 1)} {' and '.join(pins)}"
            return f"{by} would lead {count} {where}: {_numbers(struck)}"
    return ""


def _name_two(state: State, dt: float, contacts) -> str:
    """Two shapes meet where the depth of a node in one is more than its way to the other."""
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
    return ", ".join(map(str, nodes[:MOST_NAMED])) + ", …" * (len(nodes) > MOST_NAMED)
