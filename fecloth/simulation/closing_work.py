"""The work that closes the seams of a cloth."""

import numpy as np

from fecloth.system.state import State
from fecloth.system.system import System


def closing_work(system: System, old: State, step) -> float:
    """Return the work [J] that closes the gaps of seams over a step from `old`.

    It is −f · Δg: f (k, 3) are the forces of all terms on the nodes that follow, as the mean of
    both ends of the step, and g their gaps. Such nodes have no mass, so that all of −f acts on
    what closes the seam.
    """
    followers = system.constraints.followers
    change = followers.gap(step.state.x) - followers.gap(old.x)
    if not change.any():
        return 0.0
    before, after = step.around(system)
    f = 0.5 * (_forces(before, old) + _forces(after, step.state))
    return -float(np.vdot(f[followers.nodes], change))


def _forces(system: System, state: State) -> np.ndarray:
    """The forces of all terms (n, 3) [N], where they are."""
    f = np.zeros_like(state.x)
    for term in system.bound:
        term.add_force(state.x, state.v, state.t, f)
    return f
