"""The energy of a cloth's deformation, and how much its start, loads and pins can have given."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fecloth.simulation.account import Account, Accounts, Run
from fecloth.simulation.energy_ledger import Ledger
from fecloth.simulation.rigid_motion import rms_without_rigid
from fecloth.simulation.steps import StepInfo
from fecloth.system.state import State
from fecloth.system.system import System
from fecloth.terms.records import remembered

ERROR_OF_WORK = 0.05  # of the work of loads: by so much a ledger whose balance closes may err
# Motion since the start over the extent of the cloth: a cloth that has moved by less is at rest.
# Round-off and the tolerances of the solvers stay below.
MOTION_AT_REST = 1e-6


@remembered
@dataclass(frozen=True)
class Deformation(Account):
    """Kinetic energy of the deformation after a step [J]; its methods take the ledger there.

    It is the kinetic energy of the motion relative to the rigid motion of each movable piece,
    in the free directions: ½ w·M w with w = P (v − u − ω × r), see `Piece.rigid_velocity`.

    Attributes
    ----------
    kinetic, opening
        It now, and at the start.
    in_place
        Energies of the loads now, with each movable piece moved back by its mean displacement.
    places
        Place of each movable piece at the start (`Piece.place`) [m].
    first
        `kinetic` after the first step; None before it.
    inflow, last_inflow
        `find_inflow` now, and before the last step or before the steps without a row.
    opened
        The ledger where pins let go last, which is the start of all of these; None: the start of
        the run.
    earlier
        The `energy` before that [J].
    """

    name = "deformation"
    kinetic: float
    opening: float
    in_place: Mapping[str, float]
    places: tuple[tuple[float, ...], ...] = ()
    first: float | None = None
    inflow: float = 0.0
    last_inflow: float = 0.0
    opened: Ledger | None = None
    earlier: float = 0.0

    @classmethod
    def begin(cls, run: Run, others: Accounts) -> "Deformation":
        return cls.open(run.system, run.start, others[Ledger])

    @classmethod
    def open(cls, system: System, state: State, ledger: Ledger) -> "Deformation":
        """Return the record at the start, with the ledger there."""
        places = tuple(tuple(place.tolist()) for place in _places(system, state))
        _, pin_v = system.constraints.target(state.t, 0.0, state.x)
        kinetic = _deforming_kinetic(system, state, ledger.kinetic, pin_v)
        in_place = _energies_in_place(system, state, ledger.potential, places)
        inflow = find_inflow(ledger, kinetic, kinetic, in_place)
        return cls(kinetic, kinetic, in_place, places, inflow=inflow)

    def follow(self, run: Run, info: StepInfo, others: Accounts) -> "Deformation":
        return self.after(run.system, info.old, info.result.state, others[Ledger])

    def release(self, run: Run, info: StepInfo, others: Accounts) -> "Deformation":
        """Return the record where pins let go: other pieces can move, and so it begins anew."""
        ledger = others[Ledger]
        state = info.result.state
        begun = self.open(run.system, state, ledger.since(ledger))
        return begun.changed(opened=ledger, earlier=self.energy(ledger))

    def _since_opened(self, ledger: Ledger) -> Ledger:
        return ledger.since(self.opened) if self.opened else ledger

    def after(self, system: System, old: State, new: State, ledger: Ledger) -> "Deformation":
        """Return the record after a step between two states, with the ledger after it."""
        ledger = self._since_opened(ledger)
        pin_v = new.v
        if system.movable_pieces:
            pin_v = (new.x - old.x) / (new.t - old.t)
        kinetic = _deforming_kinetic(system, new, ledger.kinetic, pin_v)
        in_place = _energies_in_place(system, new, ledger.potential, self.places)
        first = self.first
        if first is None:
            first = kinetic
        return self.changed(
            kinetic=kinetic,
            in_place=in_place,
            first=first,
            inflow=find_inflow(ledger, kinetic, self.opening, in_place),
            last_inflow=self.inflow,
        )

    def energy(self, ledger: Ledger) -> float:
        """Return the energy of deformation [J]: the measure of what has moved.

        It is the kinetic energy of the motion relative to the rigid motion of each piece or, if
        that is more, the largest change of a term's energy since the start, of loads without the
        mean displacement. It is the same for every observer. Energy that loads bring in and
        dampings take off again does not increase it.
        """
        ledger = self._since_opened(ledger)
        changes = (abs(change) for change in self._changes(ledger))
        return max([self.earlier, self.kinetic, *changes])

    def _changes(self, ledger: Ledger) -> list[float]:
        """Return the changes of the terms' energies since the start, loads in place [J]."""
        now = {**ledger.potential, **self.in_place}
        return [energy - ledger.opening[name] for name, energy in now.items()]

    def available(self, ledger: Ledger) -> float:
        """Return an upper bound of the `kinetic` energy that the cloth can have received [J].

        What it had at the start, the decrease of the terms' energies since, the inflow with 5 %
        of its parts for their own error, and `kinetic` after the first step, in which forward
        Euler is ahead of the work. Unlimited with a term that reports neither energy nor work.
        """
        if ledger.silent:
            return math.inf
        ledger = self._since_opened(ledger)
        gains = sum(max(0.0, -change) for change in self._changes(ledger))
        gains += max(0.0, self.inflow)
        exchanged = ledger.lost_outside + sum(map(abs, ledger.work.values()))
        error = ERROR_OF_WORK * exchanged
        return self.opening + (self.first or 0.0) + gains + error


def find_inflow(
    ledger: Ledger, kinetic: float, opening: float, in_place: Mapping[str, float]
) -> float:
    """Return the work of loads without an energy, and of pins, on the deformation so far [J].

    The change of the rigid motion's energy, kinetic and in the loads with an energy, is
    subtracted, and what a load itself dissipates, such as the air. The arguments are as in
    `Deformation`.
    """
    change_of_rigid = ledger.kinetic - kinetic
    change_of_rigid -= ledger.opening["kinetic"] - opening
    change_of_rigid += sum(ledger.potential[name] - energy for name, energy in in_place.items())
    return sum(ledger.work.values()) + ledger.pins - ledger.lost_outside - change_of_rigid


def negligible_energy(system: System, seconds: float) -> float:
    """Return the kinetic energy [J] below which a cloth is at rest: ½ m (1e-6 L/T)².

    m is its mass, L its largest extent and T the time since the start, `seconds` [s].
    """
    speed = MOTION_AT_REST * system.cloth.extent / seconds
    return 0.5 * system.total_mass * speed**2


def _deforming_kinetic(system: System, state: State, kinetic: float, pin_v) -> float:
    """Return `Deformation.kinetic`; `pin_v` (n, 3) are the velocities of the pins."""
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


def _places(system: System, state: State) -> list[np.ndarray]:
    """Return the place of each movable piece [m]."""
    return [piece.place(state.x, system.nodal_mass) for piece in system.movable_pieces]


def _energies_in_place(system: System, state: State, energies, start) -> dict[str, float]:
    """Return `Deformation.in_place` for places at the start; no entries if no piece can move."""
    if not start:
        return {}
    x = state.x.copy()
    places = _places(system, state)
    for piece, now, then in zip(system.movable_pieces, places, start, strict=True):
        x[piece.nodes] -= now - then
    return {
        name: term.energy(x, state.t)
        for name, term in system.named
        if name in energies and term.load
    }
