"""The energy of a cloth's deformation, the same for every observer, and what is none."""

from fecloth.simulation.energy_ledger import Ledger
from fecloth.simulation.rigid_motion import rms_without_rigid
from fecloth.system.state import State
from fecloth.system.system import System

# Motion since the start over the extent of the cloth: a cloth that has moved by less is at rest.
# Round-off and the tolerances of the solvers stay below.
MOTION_AT_REST = 1e-6


def kinetic_of_deformation(system: System, state: State, kinetic: float, pin_v) -> float:
    """Return the kinetic energy [J] of the motion relative to the rigid motion of each piece.

    It is ½ w·M w with w = P (v − u − ω × r) in the free directions P; see
    `Piece.rigid_velocity`. The whole energy is `kinetic`, and `pin_v` (n, 3) are the velocities
    of the pins.
    """
    if not system.movable_pieces:
        return kinetic
    if _is_one_free_body(system):
        rms = rms_without_rigid(system.nodal_mass, state.x, state.v)
        return 0.5 * system.total_mass * rms**2
    p = system.mass_times(state.v)
    mass_x = system.mass_times(state.x)
    w = state.v.copy()
    for piece in system.movable_pieces:
        w[piece.nodes] -= piece.rigid_velocity(state.x, p, system.nodal_mass, mass_x, pin_v)
    system.constraints.project(w)
    return 0.5 * system.sums.dot(w, system.mass_times(w))


def _is_one_free_body(system: System) -> bool:
    """Return whether one compiled loop, for lumped masses, gives the kinetic energy."""
    pieces = system.movable_pieces
    is_whole = len(pieces) == 1 and isinstance(pieces[0].nodes, slice)
    return is_whole and not len(pieces[0].held) and system.mass_kind == "lumped"


def stored_by_deformation(system: System, ledger: Ledger) -> float:
    """Return the sum of the changes of the terms' energies since the start, without loads [J]."""
    return sum(
        abs(ledger.potential[name] - ledger.opening[name])
        for name, term in system.named
        if name in ledger.potential and not term.load
    )


def negligible_energy(system: System, seconds: float) -> float:
    """Return the kinetic energy [J] below which a cloth is at rest: ½ m (1e-6 L/T)².

    m is its mass, L its largest extent and T the time since the start, `seconds` [s].
    """
    speed = MOTION_AT_REST * system.cloth.extent / seconds
    return 0.5 * system.total_mass * speed**2
