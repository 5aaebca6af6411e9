"""The cases of a sensitivity: a run with derivatives, and a pair of twin runs that checks them."""

import math
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from fecloth.errors import FeclothWarning, InputError
from fecloth.integrators import EXPLICIT, METHODS
from fecloth.integrators.protocol import method_of
from fecloth.linalg.block_matrix import BlockMatrix
from fecloth.nonlinear.along import Along, Sides
from fecloth.nonlinear.options import Newton
from fecloth.simulation.equilibrium import Equilibrium
from fecloth.simulation.fixed_step import GivenSteps
from fecloth.simulation.load_steps import LoadSteps
from fecloth.simulation.quantity import Quantity, parse_quantity
from fecloth.simulation.quantity_values import RunRecord, value_of
from fecloth.simulation.setup import Setup
from fecloth.study import status
from fecloth.study.derivation import Derivation, Recorded, derive_run, find_rest
from fecloth.study.measured_runs import columns_to_record, measure, record_of
from fecloth.study.modes import Modes, modes
from fecloth.study.parameters import Parameter, setup_with
from fecloth.study.problems import Problem
from fecloth.system.state import State
from fecloth.system.system import System

LOOSE = 1e-2  # the largest relative error of derivatives that can be asked for
OF_STEPS = 2.0  # times the tolerance: relative error of the derivative of a single step
OF_NEWTON, OF_TWINS = 1e-2, 1e-11  # times it: Newton's tolerance; Newton's tolerance in twin runs


@dataclass(frozen=True, eq=False)
class Sought:
    """What is derived: quantities by parameters, and how exactly."""

    parameters: tuple[Parameter, ...]
    quantities: tuple[Quantity, ...]
    tolerance: float
    whole: bool = False  # whether of the quantities, which are columns, all rows are wanted

    def settings(self) -> list[object]:
        """What `of` takes, in JSON's types but for functions as quantities."""
        listed = [[p.name, p.value, p.width] for p in self.parameters]
        quantities = [quantity.function or quantity.text for quantity in self.quantities]
        return [listed, quantities, self.tolerance, self.whole]

    @classmethod
    def of(cls, parameters: list, quantities: list, *more: Any) -> Self:
        listed = tuple(Parameter(*each) for each in parameters)
        return cls(listed, tuple(map(parse_quantity, quantities)), *more)


def derive_case(problem: Problem, sought: Sequence[Any]) -> dict:
    """Run the problem with derivatives: values, slopes by parameters over their widths, steps."""
    begin = time.process_time()
    asked = Sought.of(*sought)
    setup = _sharpened(problem.setup(), asked.tolerance * OF_NEWTON)

    def setup_at(parameter: Parameter, value: float) -> Setup:
        return setup_with(problem, {parameter.name: value}, setup)

    with _quietly(setup):
        answer = _derive(problem, setup, asked, setup_at)
    return answer | {"cpu_seconds": time.process_time() - begin}


SetupAt = Callable[[Parameter, float], Setup]


def _derive(problem: Problem, setup: Setup, sought: Sought, setup_at: SetupAt) -> dict:
    setup = setup.recording(quantity.column for quantity in sought.quantities)
    recorded = what_to_record(sought.quantities, setup)
    if sought.whole:
        recorded = replace(recorded, whole=True, only_start=False)
    exactly = sought.tolerance * OF_STEPS, status.check_time_limit
    derivation = derive_run(setup, sought.parameters, setup_at, recorded, *exactly)
    read: Callable[..., Any] = _column if sought.whole else value_of
    slopes = Slopes(setup, derivation, problem.probes, read)
    state = getattr(derivation.result, "state", setup.start)
    count = max(quantity.mode for quantity in sought.quantities)
    shapes = modes(setup.system, state, count=count) if count else None
    values = []
    rows = []
    for quantity in sought.quantities:
        if shapes and quantity.how == "mode":
            value: Any = shapes.frequencies[quantity.mode - 1]
            of = shapes, quantity.mode, state
            pairs = [(each.along, each.sides()) for each in derivation.followers]
            row: list[Any] = [slope_of_frequency(*of, *pair) for pair in pairs]
        else:
            value = slopes.value(quantity)
            row = [slopes.slope(quantity, i) for i in range(len(sought.parameters))]
        if not (sought.whole or math.isfinite(value)):
            raise InputError(f"{quantity} = {value}", "must be a finite number", "quantity")
        values.append(np.asarray(value).tolist())
        rows.append([np.asarray(slope).tolist() for slope in row])
    steps = {"sizes": list(derivation.sizes), "method": derivation.method, "why": derivation.why}
    times = {"times": derivation.times.tolist()} if sought.whole else {}
    return {"values": values, "slopes": rows, **steps, **times}


def _column(quantity: Quantity, record: RunRecord) -> np.ndarray:
    return record.column(quantity)[:, 0]


def run_twin(
    problem: Problem,
    sought: Sequence[Any],
    changes: Sequence[float],
    sizes: Sequence[float],
    method: str,
) -> dict:
    """Run the problem with all parameters changed, in units of their widths, and the same steps."""
    begin = time.process_time()
    asked = Sought.of(*sought)
    base = problem.setup()
    pairs = zip(asked.parameters, changes, strict=True)
    setup = setup_with(problem, {p.name: p.at(change) for p, change in pairs}, base)
    setup = _sharpened(setup, OF_TWINS)
    if sizes and not isinstance(setup.steps, LoadSteps):
        named = {type(each()).__name__: each for each in (METHODS | EXPLICIT).values()}
        chosen = named[method]() if method else method_of(setup.steps)
        setup = replace(setup, steps=GivenSteps(chosen, tuple(sizes)))
    quantities = asked.quantities
    recorded = sorted({name for each in quantities for name in columns_to_record(each)})
    count = max((quantity.mode for quantity in quantities), default=0)
    function = next((each.function for each in quantities if each.function), None)
    row = measure(setup, recorded, count, function, rest=find_rest)
    cloth = setup.cloth
    values = [value_of(q, record_of(row, q, cloth, problem.probes)) for q in quantities]
    return {"values": values, "cpu_seconds": time.process_time() - begin}


def _sharpened(setup: Setup, tolerance: float) -> Setup:
    """The setup with a Newton iteration that goes at least so far."""
    newton = setup.newton or Newton()
    known = newton.tolerance
    sharp = tolerance if known == "auto" else min(tolerance, float(known))
    return replace(setup, newton=replace(newton, tolerance=sharp))


@contextmanager
def _quietly(setup: Setup) -> Iterator[None]:
    with (
        setup.system.team.pinned(),
        warnings.catch_warnings(action="ignore", category=FeclothWarning),
    ):
        yield


# --- slopes of quantities -------------------------------------------------------------------------

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
        start = self.setup.start.x
        follower = d.followers[number]
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
        slopes = d.followers[number].slopes
        moved = self._moved(number)
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
        result = self.derivation.result
        end = self.derivation.followers[number].along
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
    """df/dp of a natural frequency: 8 π² f df/dp = φ · (dK/dp − ω² dM/dp) φ with φ · M φ = 1.

    It holds for a frequency that no other mode has. K and M are differences at p + ε and p − ε,
    with the states there, which `end` has the derivatives of.
    Source: Fox and Kapoor (1968), Rates of Change of Eigenvalues and Eigenvectors, AIAA J. 6.
    It raises `InputError` for an unstable mode, or a mode without stiffness.
    """
    omega2 = float(shapes.eigenvalues[mode - 1])
    f = float(shapes.frequencies[mode - 1])
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
