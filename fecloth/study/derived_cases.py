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
from fecloth.nonlinear.options import Newton
from fecloth.simulation.fixed_step import GivenSteps
from fecloth.simulation.load_steps import LoadSteps
from fecloth.simulation.quantity import Quantity, parse_quantity
from fecloth.simulation.quantity_values import RunRecord, value_of
from fecloth.study import status
from fecloth.study.derivation import derive_run, find_rest
from fecloth.study.measured_runs import columns_to_record, measure, record_of
from fecloth.study.modes import modes
from fecloth.study.parameters import Parameter, setup_with
from fecloth.study.problems import Problem
from fecloth.study.quantity_slopes import Slopes, slope_of_frequency, what_to_record
from fecloth.study.setups import Setup
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
    begin, asked = time.process_time(), Sought.of(*sought)
    setup = _sharpened(problem.setup(), asked.tolerance * OF_NEWTON)

    def setup_at(parameter: Parameter, value: float) -> Setup:
        return setup_with(problem, {parameter.name: value}, setup)

    with _quietly(setup):
        answer = _derive_run(problem, setup, asked, setup_at)
    return answer | {"cpu_seconds": time.process_time() - begin}


SetupAt = Callable[[Parameter, float], Setup]


def _derive_run(problem: Problem, setup: Setup, sought: Sought, setup_at: SetupAt) -> dict:
    recorded = what_to_record(sought.quantities, setup)
    setup = setup.recording(quantity.column for quantity in sought.quantities)
    exactly = sought.tolerance * OF_STEPS, status.check_time_limit
    if sought.whole:
        recorded = replace(recorded, whole=True, only_start=False)
    derivation = derive_run(setup, sought.parameters, setup_at, recorded, *exactly)
    if sought.whole:
        return _derive_columns(Slopes(setup, derivation, problem.probes, _column), sought)
    slopes = Slopes(setup, derivation, problem.probes)
    state = getattr(derivation.result, "state", setup.start)
    shapes = _modes(setup.system, state, sought.quantities)
    values, rows = [], []
    for quantity in sought.quantities:
        of_mode, numbers = quantity.how == "mode", range(len(sought.parameters))
        if of_mode:
            values.append(float(shapes.frequencies[quantity.mode - 1]))
            of = shapes, quantity.mode, state
            pairs = [(each.along, each.sides()) for each in derivation.followers]
            rows.append([slope_of_frequency(*of, *pair) for pair in pairs])
        else:
            values.append(slopes.value(quantity))
            if not math.isfinite(values[-1]):
                raise InputError(
                    f"{quantity} = {values[-1]}", "must be a finite number", "quantity"
                )
            rows.append([slopes.slope(quantity, i) for i in numbers])
    steps: dict[str, Any] = {"sizes": list(derivation.sizes), "method": derivation.method}
    steps["why"] = derivation.why
    return {"values": values, "slopes": rows, **steps}


def _column(quantity: Quantity, record: RunRecord) -> np.ndarray:
    return record.column(quantity)[:, 0]


def _derive_columns(slopes: Slopes, sought: Sought) -> dict:
    """The rows of each quantity, and of its derivative by each parameter over its width."""
    numbers = range(len(sought.parameters))
    rows = [[slopes.slope(q, i).tolist() for i in numbers] for q in sought.quantities]
    values = [slopes.value(quantity).tolist() for quantity in sought.quantities]
    return {"values": values, "slopes": rows, "times": slopes.derivation.times.tolist()}


def _modes(system: System, state: State, quantities: Sequence[Quantity]) -> Any:
    count = max((quantity.mode for quantity in quantities), default=0)
    return modes(system, state, count=count) if count else None


def run_twin(
    problem: Problem,
    sought: Sequence[Any],
    changes: Sequence[float],
    sizes: Sequence[float],
    method: str,
) -> dict:
    """Run the problem with all parameters changed, in units of their widths, and the same steps."""
    begin, asked, base = time.process_time(), Sought.of(*sought), problem.setup()
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
