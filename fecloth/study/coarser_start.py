"""An equilibrium that starts from the solution on a coarser mesh, and so stays on its branch."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from fecloth.errors import FeclothError
from fecloth.linalg.reductions import rms
from fecloth.mesh.cloth import Cloth
from fecloth.simulation.equilibrium import Equilibrium, equilibrium
from fecloth.simulation.load_steps import LoadSteps
from fecloth.simulation.quantity import Quantity
from fecloth.simulation.setup import Setup
from fecloth.simulation.shapes import find_wrinkles
from fecloth.system.state import State
from fecloth.system.system import System

OF_THE_WAY = ("max", "min", "path", "period", "frequency", "function")  # `how` of quantities
SUMMED = ("work", "dissipated", "pins", "numerical", "impacts", "remainder")  # add up over steps


def needs_the_way(quantity: Quantity) -> bool:
    """Whether a quantity depends on the load steps, not on the equilibrium at their end alone."""
    is_summed = quantity.column.replace(":", ".").split(".")[0] in SUMMED
    return quantity.how in OF_THE_WAY or quantity.at is not None or is_summed


def depends_on_path(system: System) -> bool:
    """Whether friction makes the equilibrium depend on the way there."""
    return any(term.needs_path for term in system.bound)


def place_on(setup: Setup, coarser: Cloth, displacement: np.ndarray) -> State:
    """Return the start of a setup moved by a displacement (n, 3) that is given on a coarser mesh.

    The displacement is interpolated in the triangles of the coarser mesh [m]. Pins hold their
    directions where they hold them under the whole loads, at t = 1 where load steps move them.
    """
    start = setup.start
    moved = coarser.interpolate(displacement, setup.cloth.X)
    constraints = setup.system.constraints
    held = start.x
    t = start.t
    if setup.t_end is not None:  # in load steps the part of the loads is the time of pins
        held, _ = constraints.target(start.t, setup.t_end - start.t, start.x)
        t = setup.t_end
    free = constraints.expand(start.x + moved - held)
    return State(t, held + free, np.zeros_like(held))


def solve_near(setup: Setup, near: State, report: Callable[..., None]) -> Equilibrium:
    """Return the equilibrium of a setup that Newton's iteration reaches from a state near it.

    All loads act at once, with the options of the load steps of the setup. A doubt about wrinkles
    is among its doubts, as after load steps.
    """
    options = setup.steps if isinstance(setup.steps, LoadSteps) else LoadSteps()
    rest = equilibrium(
        setup.system,
        near,
        tolerance=options.tolerance,
        max_iterations=options.max_iterations,
        report=report,
    )
    moved = rms(setup.system.diagonal_mass, rest.x - setup.start.x)
    wrinkles = find_wrinkles(setup.system, rest, moved)
    return replace(rest, doubts=(*rest.doubts, wrinkles)) if wrinkles else rest


def rest_from(setup: Setup, coarser: Cloth, displacement: Sequence) -> Any:
    """Return a function as `equilibrium` that starts from a displacement on a coarser mesh.

    It is None where the equilibrium depends on the way there, and for another cloth.
    """
    if depends_on_path(setup.system):
        return None
    try:
        near = place_on(setup, coarser, np.array(displacement))
    except FeclothError:  # as where a node lies on no triangle of the coarser mesh
        return None

    def rest(system: System, start: State, report: Callable[..., None]) -> Equilibrium:
        return solve_near(setup, near, report)

    return rest
