"""Derivatives of quantities of interest, from the derivatives of what a run recorded."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fecloth.errors import InputError
from fecloth.linalg.block_matrix import BlockMatrix
from fecloth.nonlinear.along import Along, Sides
from fecloth.simulation.equilibrium import Equilibrium
from fecloth.simulation.quantity import Quantity
from fecloth.simulation.quantity_values import RunRecord, value_of
from fecloth.study.derivation import Derivation, Recorded
from fecloth.study.measured_runs import columns_to_record
from fecloth.study.modes import Modes
from fecloth.study.setups import Setup
from fecloth.system.state import State
from fecloth.system.system import System

PART = 1e-7  # of the largest value: how far values are moved for differences
OF_FUNCTIONS = 1e-4  # of the width of a parameter: its largest change, for functions
ROUND_OFF = 1e-12  # of the largest value: slopes below it are none
FLOWS = ("dissipated", "work", "pins", "numerical", "remainder")


def what_to_record(quantities: Sequence[Quantity], setup: Setup) -> Recorded:
    """Whether rows of each step, and the flows of the ledger, are needed, or no step at all."""
    functions = any(quantity.function for quantity in quantities)
    flows = any(quantity.column.split(":")[0].split(".")[0] in FLOWS for quantity in quantities)
    whole = any(columns_to_record(quantity) for quantity in quantities)
    start = quantities[0].how == "mode" and not setup.is_static  # frequencies about it
    return Recorded(whole or functions or flows, functions or flows, start)


@dataclass(frozen=True, eq=False)
class Slopes:
    """Values of quantities, and their derivatives by each parameter over its width."""

    setup: Setup
    derivation: Derivation
    probes: tuple[str, ...]
    read: Callable[[Quantity, RunRecord], Any] = value_of  # a number, or values over the run

    def value(self, quantity: Quantity) -> Any:
        return self._value_at(quantity, 0, 0.0)

    def slope(self, quantity: Quantity, number: int) -> Any:
        """The derivative by the parameter of this number, from 0."""
        size = self._size(quantity, number)
        if not size:
            return 0.0 * self.value(quantity)
        plus, minus = (self._value_at(quantity, number, sign * size) for sign in (1.0, -1.0))
        return (plus - minus) / (2 * size)

    def _size(self, quantity: Quantity, number: int) -> float:
        """The change of the parameter by which values move by a small part."""
        d = self.derivation
        start, follower = self.setup.start.x, d.followers[number]
        pairs = [(start, follower.along.x), (start, self._moved(number).x)]
        kind = quantity.column.split(".")[0]
        for name, values in d.columns.items():
            if kind and name.split(".")[0] == kind:
                pairs.append((values, follower.slopes[name]))
        sizes = [(_largest(values) or 1.0, _largest(slopes)) for values, slopes in pairs]
        known = [PART * v / s for v, s in sizes if s > ROUND_OFF * v]
        # A function may be of energies, too, which change where nothing moves.
        return min([*known, OF_FUNCTIONS] if quantity.function else known, default=0.0)

    def _moved(self, number: int) -> Along:
        """Derivatives of the displacement and the velocity at the end."""
        each = self.derivation.followers[number]
        return Along(each.along.x - each.start.x, each.along.v)

    def _value_at(self, quantity: Quantity, number: int, size: float) -> Any:
        d = self.derivation
        slopes, moved = d.followers[number].slopes, self._moved(number)
        columns = {name: c + size * slopes[name] for name, c in d.columns.items()}
        state = d.result.state
        fields = {
            "displacement": state.x - self.setup.start.x + size * moved.x,
            "velocity": state.v + size * moved.v,
        }
        record = RunRecord(d.times, columns, self.setup.cloth, fields, self.probes)
        if quantity.function:
            value = float(quantity.function(self._result_at(number, size, columns)))
            record = replace(record, values={quantity.text: value})
        return self.read(quantity, record)

    def _result_at(self, number: int, size: float, columns: dict[str, np.ndarray]) -> Any:
        result, end = self.derivation.result, self.derivation.followers[number].along
        if isinstance(result, Equilibrium):
            return replace(result, x=result.x + size * end.x)
        energies = {name: columns[name] for name in result.energies}
        observed = {name: columns[name] for name in result.observed}
        state = end.shift(result.state, size)
        return replace(result, state=state, energies=energies, observed=observed)


def _largest(values: np.ndarray) -> float:
    known = np.abs(values[np.isfinite(values)])
    return float(known.max()) if known.size else 0.0


def slope_of_frequency(shapes: Modes, mode: int, state: State, end: Along, sides: Sides) -> float:
    """df/dp of a natural frequency: 8 π² f df/dp = φ · (dK/dp − ω² dM/dp) φ with φ · M φ = 1."""
    # It holds for a frequency that no other mode has. K and M are differences at p + ε and p − ε,
    # with the states there, which `end` has the derivatives of.
    # Source: Fox and Kapoor (1968), Rates of Change of Eigenvalues and Eigenvectors, AIAA J. 6.
    # It raises `InputError` for an unstable mode, or a mode without stiffness.
    omega2, f = float(shapes.eigenvalues[mode - 1]), float(shapes.frequencies[mode - 1])
    if not omega2 > 0:
        what = f"frequency({mode}) = {f:.3g} Hz"
        raise InputError(what, "must be > 0 for a derivative", "sensitivity")
    phi = shapes.shapes[mode - 1]
    plus, minus = (
        _energy(system, end.shift(state, size), phi, omega2) for system, size in sides.signed
    )
    return (plus - minus) / (2 * sides.size) / (8 * math.pi**2 * f)


def _energy(system: System, state: State, phi: np.ndarray, omega2: float) -> float:
    """φ · (K − ω² M) φ."""
    J = system.assemble(BlockMatrix.zeros(system.pattern), state, wx=1.0)
    part = system.coupling(state, wx=1.0)
    Kphi = (J if part is None else J.plus(part)) @ phi
    total = np.vdot(phi, Kphi - omega2 * system.mass_times(phi))
    return float(total + sum(c * np.vdot(u, phi) ** 2 for c, u in system.dense(state)))
