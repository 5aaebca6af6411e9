"""The cases of a sensitivity: a run with derivatives, and twin runs that check them."""

import math
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from fecloth.errors import FeclothWarning, InputError
from fecloth.integrators.protocol import method_of
from fecloth.linalg.block_matrix import BlockMatrix
from fecloth.nonlinear.along import Along, Sides
from fecloth.nonlinear.options import Newton
from fecloth.simulation.derived_loads import find_rest
from fecloth.simulation.equilibrium import Equilibrium
from fecloth.simulation.fixed_step import GivenSteps
from fecloth.simulation.load_steps import LoadSteps
from fecloth.simulation.probes import SHAPE_COLUMNS, Probe
from fecloth.simulation.quantity import Quantity, parse_quantity
from fecloth.simulation.quantity_values import RunRecord, value_of
from fecloth.simulation.setup import Setup
from fecloth.study import status
from fecloth.study.derivation import (
    LARGEST_CHANGE,
    Derivation,
    Recorded,
    derive_run,
)
from fecloth.study.laying import describe_state
from fecloth.study.measured_runs import columns_to_record, make_method, measure, record_of
from fecloth.study.modes import Modes, modes
from fecloth.study.parameters import Parameter
from fecloth.study.problem import StudyProblem
from fecloth.system.state import State
from fecloth.system.system import System

# The relative error of derivatives: a larger one cannot be asked for, and if twin runs differ by
# more, there is no derivative.
LARGEST_ERROR = 1e-2
# Error of the derivative of a single step over the tolerance of all: numbers that count a hundredth
# of others keep the tolerance, too, and a run takes as long as with 2.
STEP_ERROR = 0.1
# Newton's tolerance in a run with derivatives, over the tolerance of derivatives.
NEWTON_TOLERANCE = 1e-2
# Newton's tolerance in twin runs: what it leaves is 1e-6 of their smallest change, 1e-5.
TWIN_TOLERANCE = 1e-11


@dataclass(frozen=True, eq=False)
class Sought:
    """What is derived: quantities by parameters, and how exactly.

    Attributes
    ----------
    parameters
        By what the quantities are derived.
    quantities
        What is derived.
    tolerance
        Relative error of the derivatives that is aimed at.
    whole
        Whether the values of each row of the run are derived. Then all quantities are columns.
    """

    parameters: tuple[Parameter, ...]
    quantities: tuple[Quantity, ...]
    tolerance: float
    whole: bool = False

    def settings(self) -> list[object]:
        """Return the fields as a list, from which `of_settings` makes this object again.

        They are JSON values, so that the case can be stored and run in another process; only a
        quantity that is a user's function stays a function.
        """
        parameters = [[p.name, p.value, p.width] for p in self.parameters]
        quantities = [quantity.function or quantity.text for quantity in self.quantities]
        return [parameters, quantities, self.tolerance, self.whole]

    @classmethod
    def of_settings(cls, settings: Sequence[Any]) -> Self:
        """Return the object whose `settings` are these."""
        parameters, quantities, tolerance, whole = settings
        return cls(
            parameters=tuple(Parameter(name, value, width) for name, value, width in parameters),
            quantities=tuple(map(parse_quantity, quantities)),
            tolerance=tolerance,
            whole=whole,
        )


def derive_case(problem: StudyProblem, sought: Sequence[Any]) -> dict:
    """Run the problem with derivatives, as a case of a study.

    `sought` are the `settings` of a `Sought`. The row has the `values` of the quantities, their
    `slopes` by each parameter over its width, the steps of the run (`sizes`, `method`, `why`)
    and its CPU seconds. Warnings of fecloth are dropped.
    """
    begin = time.process_time()
    sought_derivatives = Sought.of_settings(sought)
    # what Newton's method leaves must be small against the error of the derivatives
    setup = _sharpen(problem.setup(), sought_derivatives.tolerance * NEWTON_TOLERANCE)

    def setup_at(parameter: Parameter, value: float) -> Setup:
        return problem.on({parameter.name: value}, setup)

    with _quietly(setup):
        row = _derive(problem, setup, sought_derivatives, setup_at)
    return row | {"cpu_seconds": time.process_time() - begin}


SetupAt = Callable[[Parameter, float], Setup]


def _derive(problem: StudyProblem, setup: Setup, sought: Sought, setup_at: SetupAt) -> dict:
    """Run the setup with derivatives, and return the row of `derive_case` without seconds.

    `setup_at` makes the setup with another value of a parameter. Raise `InputError` for a
    quantity that is no finite number.
    """
    setup = setup.recording(quantity.column for quantity in sought.quantities)
    needs_shape = any(q.function or q.column in SHAPE_COLUMNS for q in sought.quantities)
    setup = replace(setup, shape=needs_shape)
    recorded = what_to_record(sought.quantities, setup)
    if sought.whole:
        recorded = replace(recorded, whole=True, only_start=False)  # the rows of each step
    derivation = derive_run(
        setup,
        sought.parameters,
        setup_at,
        recorded,
        tolerance=sought.tolerance * STEP_ERROR,
        report=status.check_time_limit,
    )
    read: Callable[..., Any] = _read_column if sought.whole else value_of
    slopes = Slopes(setup, derivation, problem.source.probes, read)
    state = getattr(derivation.result, "state", setup.start)
    shapes = None
    # `mode` is 0 for a quantity that is no natural frequency
    if count := max(quantity.mode for quantity in sought.quantities):
        shapes = modes(setup.system, state, count=count)
    row: dict[str, Any] = {"values": [], "slopes": []}
    for quantity in sought.quantities:
        if shapes and quantity.how == "mode":
            value: Any = shapes.frequencies[quantity.mode - 1]
            derivatives: list[Any] = [
                slope_of_frequency(
                    shapes, quantity.mode, state, end=follower.along, sides=follower.sides()
                )
                for follower in derivation.followers
            ]
        else:
            value = slopes.value(quantity)
            derivatives = [slopes.slope(quantity, i) for i in range(len(sought.parameters))]
        if not (sought.whole or math.isfinite(value)):
            raise InputError(f"{quantity} = {value}", "must be a finite number", "quantity")
        row["values"].append(np.asarray(value).tolist())
        row["slopes"].append([np.asarray(derivative).tolist() for derivative in derivatives])
    if setup.is_static:
        row["folds"] = describe_state(setup, state.x)["folds"]
    row["sizes"] = list(derivation.sizes)
    row["method"] = derivation.method
    row["why"] = derivation.why
    if sought.whole:
        row["times"] = derivation.times.tolist()
    return row


def _read_column(quantity: Quantity, record: RunRecord) -> np.ndarray:
    """Return the values of a column over the run."""
    return record.column(quantity)[:, 0]


def run_twin(
    problem: StudyProblem,
    sought: Sequence[Any],
    changes: Sequence[float],
    sizes: Sequence[float],
    method: str,
) -> dict:
    """Run the problem with all parameters changed, and with the steps of another run.

    With the same steps the two runs differ by the parameters alone. Return the `values` of the
    quantities, and the CPU seconds.

    Parameters
    ----------
    sought
        The `settings` of a `Sought`.
    changes
        The change of each parameter in units of its width.
    sizes, method
        The steps of the other run [s], and the name of its method; "" for the problem's own.
    """
    begin = time.process_time()
    sought_derivatives = Sought.of_settings(sought)
    values_by_name = {
        parameter.name: parameter.at(change)
        for parameter, change in zip(sought_derivatives.parameters, changes, strict=True)
    }
    setup = problem.on(values_by_name, problem.setup())
    setup = _sharpen(setup, TWIN_TOLERANCE)
    if sizes and not isinstance(setup.steps, LoadSteps):  # load steps are the same anyway
        method_of_run = make_method(method) if method else method_of(setup.steps)
        setup = replace(setup, steps=GivenSteps(method_of_run, tuple(sizes)))
    quantities = sought_derivatives.quantities
    recorded = {name for quantity in quantities for name in columns_to_record(quantity)}
    row = measure(
        setup,
        recorded=sorted(recorded),
        modes=max((quantity.mode for quantity in quantities), default=0),
        function=next((q.function for q in quantities if q.function), None),  # the only one
        rest=find_rest,
    )
    cloth = setup.cloth
    values = [value_of(q, record_of(row, q, cloth, problem.source.probes)) for q in quantities]
    return {"values": values, "cpu_seconds": time.process_time() - begin}


def _sharpen(setup: Setup, tolerance: float) -> Setup:
    """Return the setup with Newton's tolerance, unless its own is smaller."""
    newton = setup.newton or Newton()
    if newton.tolerance != "auto":
        tolerance = min(tolerance, float(newton.tolerance))
    return replace(setup, newton=replace(newton, tolerance=tolerance))


@contextmanager
def _quietly(setup: Setup) -> Iterator[None]:
    """Keep the threads of the system where they are, and drop warnings of fecloth."""
    with (
        setup.system.team.pinned(),
        warnings.catch_warnings(action="ignore", category=FeclothWarning),
    ):
        yield


# --- slopes of quantities ---------------------------------------------------------------------

# How far the values of a run are moved for central differences, over the largest value: above
# the square root of round-off, 1.5e-8, so that the differences keep digits.
MOVED_VALUES = 1e-7
# The derivative of the values of a run over the largest value: a smaller one is round-off.
LEAST_SLOPE = 1e-12
FLOWS = ("dissipated", "work", "pins", "numerical", "impacts", "remainder")


def what_to_record(quantities: Sequence[Quantity], setup: Setup) -> Recorded:
    """Return what a run records for the quantities: each step or the end, and the ledger.

    A user's function may read anything of the result, so it needs all rows and the ledger. The
    displacement of a probe needs its place at the start.
    """
    has_functions = any(quantity.function for quantity in quantities)
    flows = any(quantity.column.split(":")[0].split(".")[0] in FLOWS for quantity in quantities)
    probes = [probe.name for probe in setup.probes if isinstance(probe, Probe)]
    whole = any(columns_to_record(q) or q.column in probes for q in quantities)
    only_start = quantities[0].how == "mode" and not setup.is_static  # frequencies about it
    flows = flows or has_functions
    return Recorded(whole=whole or flows, flows=flows, only_start=only_start)


@dataclass(frozen=True, eq=False)
class Slopes:
    """Values of quantities, and their derivatives by each parameter over its width.

    Attributes
    ----------
    setup
        What ran.
    derivation
        The run, and the derivatives of what it recorded.
    probes
        Names of the probes.
    read
        Reads a quantity from a record: a number, or values over the run.
    """

    setup: Setup
    derivation: Derivation
    probes: tuple[str, ...]
    read: Callable[[Quantity, RunRecord], Any] = value_of

    def value(self, quantity: Quantity) -> Any:
        """Return the quantity of the run."""
        return self._value_at(quantity, 0, 0.0)

    def slope(self, quantity: Quantity, number: int) -> Any:
        """Return the derivative by the parameter of this number, which counts from 0.

        It is a central difference between two linear changes of what the run recorded.
        """
        size = self._find_size(quantity, number)
        if not size:
            return 0.0 * self.value(quantity)
        value_above = self._value_at(quantity, number, size)
        value_below = self._value_at(quantity, number, -size)
        return (value_above - value_below) / (2 * size)

    def _find_size(self, quantity: Quantity, number: int) -> float:
        """Return the change of parameter `number` for the central difference of a quantity.

        It is in units of the width of the parameter: so small that neither the nodes nor a
        column of the quantity change by more than `MOVED_VALUES` of their largest value. Return
        0 if none of them depends on the parameter.
        """
        start = self.setup.start.x
        follower = self.derivation.followers[number]
        values_and_slopes = [
            (start, follower.along.x),  # positions at the end
            (start, self._derive_fields(number).x),  # displacement from the start to the end
        ]
        # columns with the same first word belong together, such as probe.x and probe.y
        first_word = quantity.column.split(".")[0]
        for name, values in self.derivation.columns.items():
            if first_word and name.split(".")[0] == first_word:
                values_and_slopes.append((values, follower.slopes[name]))
        sizes = []
        for values, slopes in values_and_slopes:
            value = _find_largest(values) or 1.0
            slope = _find_largest(slopes)
            if slope > LEAST_SLOPE * value:
                sizes.append(MOVED_VALUES * value / slope)
        if quantity.function:  # it may read energies, which may change where nothing moves
            sizes.append(LARGEST_CHANGE)
        return min(sizes, default=0.0)

    def _derive_fields(self, number: int) -> Along:
        """Return the derivatives of the displacement and the velocity at the end."""
        follower = self.derivation.followers[number]
        return Along(follower.along.x - follower.start.x, follower.along.v)

    def _value_at(self, quantity: Quantity, number: int, size: float) -> Any:
        """Return the quantity if parameter `number` changes by `size` of its width.

        What the run recorded changes linearly, by its derivatives; nothing runs again.
        """
        slopes = self.derivation.followers[number].slopes
        field_slopes = self._derive_fields(number)
        recorded = self.derivation.columns
        columns = {name: values + size * slopes[name] for name, values in recorded.items()}
        state = self.derivation.result.state
        fields = {
            "displacement": state.x - self.setup.start.x + size * field_slopes.x,
            "velocity": state.v + size * field_slopes.v,
        }
        record = RunRecord(self.derivation.times, columns, self.setup.cloth, fields, self.probes)
        if quantity.function:
            value = float(quantity.function(self._result_at(number, size, columns)))
            record = replace(record, values={quantity.text: value})
        return self.read(quantity, record)

    def _result_at(self, number: int, size: float, columns: dict[str, np.ndarray]) -> Any:
        """Return the result if parameter `number` changes by `size` of its width.

        It is what a user's function takes. `columns` are the changed columns of the run, `size`
        times the derivatives is added to the state.
        """
        result = self.derivation.result
        end = self.derivation.followers[number].along
        if isinstance(result, Equilibrium):
            return replace(result, x=result.x + size * end.x)
        energies = {name: columns[name] for name in result.energies}
        observed = {name: columns[name] for name in result.observed}
        state = end.shift(result.state, size)
        return replace(result, state=state, energies=energies, observed=observed)


def _find_largest(values: np.ndarray) -> float:
    """Return the largest size of the finite values; 0 if there is none."""
    return float(np.abs(values[np.isfinite(values)]).max(initial=0.0))


def slope_of_frequency(shapes: Modes, mode: int, state: State, end: Along, sides: Sides) -> float:
    """Return df/dp of a natural frequency: 8 π² f df/dp = φ · (dK/dp − ω² dM/dp) φ.

    Here φ · M φ = 1, and no other mode has this frequency. dK and dM are differences between
    p + ε and p − ε, with the states there. Raises `InputError` for an unstable mode, or a mode
    without stiffness. The arguments are the modes, the number of the mode from 1, the state
    about which it vibrates, the derivatives of this state (`end`), and the systems at p ± ε.

    Source: Fox and Kapoor (1968), Rates of Change of Eigenvalues and Eigenvectors, AIAA J. 6.
    """
    omega2 = float(shapes.eigenvalues[mode - 1])
    f = float(shapes.frequencies[mode - 1])
    if not omega2 > 0:
        what = f"frequency({mode}) = {f:.3g} Hz"
        raise InputError(what, "must be > 0 for a derivative", "sensitivity")
    phi = shapes.shapes[mode - 1]
    product_above, product_below = (
        _modal_product(system, end.shift(state, change), phi, omega2)
        for system, change in sides.signed
    )
    return (product_above - product_below) / (2 * sides.size) / (8 * math.pi**2 * f)


def _modal_product(system: System, state: State, phi: np.ndarray, omega2: float) -> float:
    """Return φ · (K − ω² M) φ at a state.

    K has three parts: the sparse matrix, the coupling of nodes that no triangle has in common,
    if there is any, and products c u uᵀ of full vectors, which add c (u · φ)².
    """
    K = system.assemble(BlockMatrix.zeros(system.pattern), state, wx=1.0)
    coupling = system.coupling(state, wx=1.0)
    if coupling is not None:
        K = K.plus(coupling)
    Kphi = K @ phi
    total = np.vdot(phi, Kphi - omega2 * system.mass_times(phi))
    return float(total + sum(c * np.vdot(u, phi) ** 2 for c, u in system.dense(state)))
