"""The work that closes the seams of a cloth."""

from dataclasses import replace

import numpy as np

from fecloth.system.state import State
from fecloth.system.system import System


def closing_work(system: System, old: State, step) -> float:
    """Return the work [J] that closes the gaps of seams over a step from `old`.

    It is −f · Δg: f (k, 3) are the forces on the nodes that follow, as the method takes them for
    the work of pins, and g their gaps. Such nodes have no mass: all of −f acts on what closes
    the seam.
    """
    followers = system.constraints.followers
    change = followers.gap(step.state.x) - followers.gap(old.x)
    if not change.any():
        return 0.0
    over = (step.over or system).loose()
    if step.ends:
        f = replace(step, over=over, ends=(step.ends[0].loose(), old), new_force=None).mean_force(
            over
        )
    elif step.accelerations:
        f = sum(over.force(at) for at, _ in step.accelerations) / len(step.accelerations)
    elif step.first_force is not None:  # of load steps
        f = 0.5 * (system.loose().force(old) + over.force(step.state))
    else:
        f = over.force(step.balanced_at)
    return -float(np.vdot(f[followers.nodes], change))
