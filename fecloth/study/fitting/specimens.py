"""The specimens of a fit: problems with the sought fabric, and what was measured of them."""

import dataclasses
import inspect
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fecloth.errors import InputError, did_you_mean, is_number
from fecloth.fabric.fabric import Fabric
from fecloth.fabric.uncertainty import CONSTANTS
from fecloth.scene.tables import Shorthands
from fecloth.simulation.quantity import Quantity
from fecloth.simulation.setup import Setup
from fecloth.study.change import FIRST_LEVEL, Change, Level
from fecloth.study.derived_cases import Sought
from fecloth.study.fitting.experiment import Experiment
from fecloth.study.fitting.measured import Measured, Reach, read_measured
from fecloth.study.opened import Opened, open_study
from fecloth.study.parameters import Parameter, grouped, numbers_of, refuse_sizes
from fecloth.study.problems import Problem, SceneProblem
from fecloth.study.sensitivities import PRICE
from fecloth.study.workload import Workload
from fecloth.system.state import State

FINER = 2.0  # divides h and dt; its square divides rtol
TIMES_OF_GRIPS = 41  # in a run, at which the motion of grips is looked at for its extremes
FABRIC = "fabric"

Values = Mapping[str, float]


@dataclass(frozen=True, eq=False)
class Specimen:
    """A problem, the unknown constants that it has, and the points that it should meet.

    Attributes
    ----------
    experiment
        The experiment as it was given.
    problem
        The problem with the starts of the constants.
    names
        The names of the unknown constants that it has.
    points
        The measured columns.
    reach
        The largest change along the curve: the unit of an offset.
    """

    experiment: Experiment
    problem: Problem
    names: tuple[str, ...]
    points: tuple[Measured, ...]
    reach: float = 1.0

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        """What its runs are asked for: first what orders the points, if it is not t."""
        order = self.experiment.order
        columns = tuple(self.experiment.columns.values())
        if order and order[1]:
            return (order[1], *columns)
        return columns

    @property
    def cost(self) -> Workload:
        """Predicted size of a run with derivatives."""
        size = self.problem.workload(FIRST_LEVEL)
        return replace(size, steps=round(size.steps * (1 + PRICE * len(self.names))))

    @property
    def is_curve(self) -> bool:
        """Whether the points lie along a curve."""
        return self.experiment.along is not None

    def at(self, values: Values) -> Problem:
        """The problem with these values of the unknown constants."""
        own = {name: values[name] for name in self.names}
        return self.problem.changed(Change(values=grouped(self.problem, own)))

    def sought(self, values: Values, widths: Values, tolerance: float) -> Sought:
        """What its run computes: derivatives by p/width, with a relative error `tolerance`."""
        parameters = tuple(Parameter(name, values[name], widths[name]) for name in self.names)
        return Sought(parameters, self.quantities, tolerance, self.is_curve)

    def finer(self) -> "Specimen | None":
        """The specimen with h/2, dt/2 or twice the load steps; None if it has none of them."""
        problem = self.problem
        level = Level(
            h=FINER if problem.can_refine("h") else 1.0,
            dt=FINER if problem.can_refine("dt") else 1.0,
            sharper=None,
            rtol=FINER**2 if problem.rtol else 1.0,
        )
        changes = _finer_values(problem) if isinstance(problem, SceneProblem) else {}
        if level.h == level.dt == level.rtol == 1.0 and not changes:
            return None
        finer = problem.refined(level)
        if changes:
            finer = finer.changed(Change(values=changes))
        return replace(self, problem=finer)


def _finer_values(problem: SceneProblem) -> dict[str, object]:
    """The values of a scene that no `Level` refines: its load steps, and h of pieces."""
    values = dict[str, object]()
    static = problem.scene.equilibrium
    if static and static.load_steps > 1:
        values["equilibrium.load_steps"] = int(FINER * static.load_steps)
    for name, piece in problem.tables["cloth"].get("pieces", {}).items():
        if piece.get("h"):
            values[f"cloth.pieces.{name}.h"] = piece["h"] / FINER
    return values


def fabric_with(table: Mapping[str, Any], values: Values) -> dict[str, Any]:
    """The table of a fabric with the values of keys such as "fabric.tensile_stiffness.0"."""
    fabric = {key: value for key, value in table.items() if key != "uncertainty"}
    for name, value in values.items():
        first, _, rest = name.partition(".")
        key, _, number = rest.partition(".")
        if first != FABRIC:
            continue
        if key not in CONSTANTS:
            allowed = f"is no constant of a fabric; these are {', '.join(CONSTANTS)}"
            raise InputError(f"parameter {name!r}", allowed, "fit", did_you_mean(key, CONSTANTS))
        if number:
            _put_in_pair(fabric, key, number, value, values)
        else:
            fabric[key] = value
    missing = [key for key, value in fabric.items() if isinstance(value, list) and None in value]
    if missing:
        allowed = "needs both numbers of the pair, .0 and .1, in parameters or [fabric]"
        raise InputError(f"fabric.{missing[0]}", allowed, "fit")
    return fabric


def _put_in_pair(
    fabric: dict[str, Any], key: str, number: str, value: float, values: Values
) -> None:
    """Put a value in the table of a fabric as the number of warp, "0", or of weft, "1"."""
    name = f"{FABRIC}.{key}.{number}"
    parameter = f"parameter {name!r}"
    old = fabric.get(key)
    other = f"{FABRIC}.{key}.{1 - int(number == '1')}"
    if is_number(old) and other not in values:
        allowed = "is one of two, but the fabric has one number for both directions"
        raise InputError(parameter, allowed, "fit", f"Fit {FABRIC}.{key}.")
    if number not in ("0", "1"):
        raise InputError(parameter, "must end with .0 (warp) or .1 (weft)", "fit")
    pair = list(old) if isinstance(old, list | tuple) else [old, old]
    pair[int(number)] = value
    fabric[key] = pair


def open_specimens(
    experiments: Sequence[Experiment],
    parameters: Values,
    fabric: Mapping[str, Any] | Fabric | None,
    shared: Mapping[str, Any],
) -> tuple[Specimen, ...]:
    """Open all problems and read all data; raise `InputError` for what does not fit."""
    specimens = tuple(_open(experiment, parameters, fabric, shared) for experiment in experiments)
    fitted = [specimen for specimen in specimens if specimen.experiment.fitted]
    for name in parameters:
        if not any(name in specimen.names for specimen in fitted):
            known = sorted({key for specimen in fitted for key, _ in numbers_of(specimen.problem)})
            allowed = f"is no number of any fitted experiment, which have {', '.join(known)}"
            raise InputError(f"parameter {name!r}", allowed, "fit", did_you_mean(name, known))
    return specimens


def _open(
    experiment: Experiment,
    parameters: Values,
    fabric: Mapping[str, Any] | Fabric | None,
    shared: Mapping[str, Any],
) -> Specimen:
    """Open a problem with the starts of the constants that it has, and read its data."""
    sizes = {name: getattr(experiment, name) for name in ("h", "dt", "t_end")}
    own: dict[str, Any] = {name: value for name, value in sizes.items() if value is not None}
    if len(experiment.probes):
        own["probes"] = experiment.probes
    given = own if isinstance(experiment.problem, Opened) else {**shared, **own}
    problem = open_study(experiment.problem, given).problem
    if isinstance(problem, SceneProblem):
        problem = _with_fabric(problem, parameters, fabric)
    else:
        if fabric is not None:
            raise InputError("fabric = …", "is for scenes; a function makes its own", "fit")
        arguments = inspect.signature(problem.function).parameters
        start = {k: v for k, v in parameters.items() if k.partition(".")[0] in arguments}
        problem = problem.changed(Change(values=grouped(problem, start)))
    known = dict(numbers_of(problem))
    names = [n for n in parameters if n in known or any(k.startswith(f"{n}.") for k in known)]
    for name in parameters:
        refuse_sizes(problem, name)
    if not names:
        listed = ", ".join(parameters)
        allowed = f"has none of the parameters {listed}; it has {', '.join(known)}"
        remedy = did_you_mean(next(iter(parameters), ""), known)
        raise InputError(f"experiment {experiment.label}", allowed, "fit", remedy)
    return _measure(experiment, problem, tuple(names))


def _with_fabric(
    problem: SceneProblem, parameters: Values, fabric: Mapping[str, Any] | Fabric | None
) -> Problem:
    """The scene with the fabric that is given, else with its own, and the starts in it."""
    start = {k: v for k, v in parameters.items() if k.startswith(f"{FABRIC}.")}
    base: Any = problem.tables.get(FABRIC, {}) if fabric is None else fabric
    if isinstance(base, Fabric):
        base = {k: v for k, v in dataclasses.asdict(base).items() if v not in (None, "")}
    if Shorthands.model_fields.keys() & base.keys():  # as a preset, which has more constants
        base = problem.changed(Change(values={FABRIC: base})).tables[FABRIC]
    if fabric is None and not start:
        return problem
    return problem.changed(Change(values={FABRIC: fabric_with(base, start)}))


def _measure(experiment: Experiment, problem: Problem, names: tuple[str, ...]) -> Specimen:
    """Check the quantities of a problem, and read its data."""
    setup = problem.first
    specimen = Specimen(experiment, problem, names, points=())
    for asked in specimen.quantities:
        # along a curve no vector will do: a column, as for a maximum
        problem.check_quantity(replace(asked, how="max") if specimen.is_curve else asked)
        if specimen.is_curve and (asked.how != "value" or asked.at is not None):
            allowed = "must be a column of the run, as reaction.grip.x"
            raise InputError(f"{asked}: along a curve", allowed, experiment.label)
    energies = setup.energies
    units = [quantity.unit(energies) for quantity in experiment.columns.values()]
    if experiment.order is None:
        points = read_measured(experiment, units, along_unit="", reach=None)
        return replace(specimen, points=points)
    _, quantity = experiment.order
    if quantity:
        along_unit = quantity.unit(energies)
    elif setup.is_static:  # t is the part of the loads
        along_unit = ""
    else:
        along_unit = "s"
    reach = known_reach(setup, quantity)
    points = read_measured(experiment, units, along_unit, reach)
    if reach:
        farthest = max(map(abs, reach))
    else:
        farthest = max(np.ptp(column.along) for column in points if column.along is not None)
    return replace(specimen, points=points, reach=float(farthest) or 1.0)


def known_reach(setup: Setup, quantity: Quantity | None) -> Reach | None:
    """The range of t, or of the changes of a quantity of the grips; None if only the run tells.

    It is a quantity of the grips if it stays the same where all free nodes lie elsewhere.
    """
    start = setup.start
    end = setup.t_end
    if end is None:
        return None
    if quantity is None:
        return start.t, end
    constraints = setup.system.constraints
    spread = np.ptp(setup.cloth.X)
    elsewhere = start.x + spread * np.random.default_rng(0).standard_normal(start.x.shape)
    observer = setup.recording([quantity.column]).observer
    values = []
    for t in np.linspace(start.t, end, TIMES_OF_GRIPS):
        target = constraints.target(start.t, t - start.t, start.x)[0]
        for x in (start.x, elsewhere):
            state = State(float(t), constraints.hold(x, target), np.zeros_like(x))
            row = replace(observer, start=state).row(None, None)
            values.append(row.get(quantity.column, np.nan))
    here, there = np.reshape(values, (TIMES_OF_GRIPS, 2)).T
    if not np.allclose(here, there, rtol=0, atol=1e-9 * spread):
        return None
    changes = here - here[0]
    return float(changes.min()), float(changes.max())
