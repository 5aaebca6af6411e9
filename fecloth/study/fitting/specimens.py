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
from fecloth.study.change import FIRST, Change, Level
from fecloth.study.derived_cases import Sought
from fecloth.study.fitting.experiment import Experiment
from fecloth.study.fitting.measured import Measured, Reach, read_measured
from fecloth.study.opened import Opened, open_study
from fecloth.study.parameters import Parameter, grouped, numbers_of, refuse_sizes
from fecloth.study.problems import Problem, SceneProblem
from fecloth.study.sensitivities import PRICE
from fecloth.study.workload import Workload
from fecloth.system.state import State

FINER = 2.0  # divides h and dt
SAMPLES = 41  # times at which the motion of grips is looked at
FABRIC = "fabric"

Values = Mapping[str, float]


@dataclass(frozen=True, eq=False)
class Specimen:
    """A problem, the unknown constants that it has, and the points that it should meet."""

    experiment: Experiment
    problem: Problem
    names: tuple[str, ...]
    points: tuple[Measured, ...]
    reach: float = 1.0  # the largest change along the curve: the unit of an offset

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        """What its runs are asked for: first what orders the points, if it is not t."""
        order = self.experiment.order
        first = (order[1],) if order and order[1] else ()
        return (*first, *self.experiment.columns.values())

    @property
    def cost(self) -> Workload:
        """Predicted size of a run with derivatives."""
        size = self.problem.workload(FIRST)
        return replace(size, steps=round(size.steps * (1 + PRICE * len(self.names))))

    @property
    def is_curve(self) -> bool:
        return self.experiment.along is not None

    def at(self, values: Values) -> Problem:
        """The problem with these values of the unknown constants."""
        own = {name: values[name] for name in self.names}
        return self.problem.changed(Change(values=grouped(self.problem, own)))

    def sought(self, values: Values, widths: Values, tolerance: float) -> Sought:
        parameters = tuple(Parameter(name, values[name], widths[name]) for name in self.names)
        return Sought(parameters, self.quantities, tolerance, self.is_curve)

    def finer(self) -> "Specimen | None":
        """The specimen with h/2, dt/2 or twice as many load steps; None if it has none of them."""
        problem = self.problem
        changes = dict[str, object]()
        h, dt = (FINER if problem.can_refine(what) else 1.0 for what in ("h", "dt"))
        if isinstance(problem, SceneProblem):
            static = problem.scene.equilibrium
            if static and static.load_steps > 1:
                changes["equilibrium.load_steps"] = int(FINER * static.load_steps)
            pieces = problem.tables["cloth"].get("pieces", {})
            sizes = {f"cloth.pieces.{name}.h": piece.get("h") for name, piece in pieces.items()}
            changes |= {key: size / FINER for key, size in sizes.items() if size}
        rtol = FINER**2 if problem.rtol else 1.0
        if h == dt == rtol == 1.0 and not changes:
            return None
        finer = problem.refined(Level(h, dt, None, rtol))
        return replace(self, problem=finer.changed(Change(values=changes)) if changes else finer)


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
        if not number:
            fabric[key] = value
            continue
        old = fabric.get(key)
        other = f"{FABRIC}.{key}.{1 - int(number == '1')}"
        if is_number(old) and other not in values:
            allowed = "is one of two, but the fabric has one number for both directions"
            raise InputError(f"parameter {name!r}", allowed, "fit", f"Fit {FABRIC}.{key}.")
        pair = list(old) if isinstance(old, list | tuple) else [old, old]
        if number not in ("0", "1"):
            raise InputError(f"parameter {name!r}", "must end with .0 (warp) or .1 (weft)", "fit")
        pair[int(number)] = value
        fabric[key] = pair
    missing = [key for key, value in fabric.items() if isinstance(value, list) and None in value]
    if missing:
        allowed = "needs both numbers of the pair, .0 and .1, in parameters or [fabric]"
        raise InputError(f"fabric.{missing[0]}", allowed, "fit")
    return fabric


def open_specimens(
    experiments: Sequence[Experiment],
    parameters: Values,
    fabric: Mapping[str, Any] | Fabric | None,
    shared: Mapping[str, Any],
) -> tuple[Specimen, ...]:
    """Open all problems and read all data; raise `InputError` for what does not fit."""
    specimens = tuple(_open(each, parameters, fabric, shared) for each in experiments)
    fitted = [each for each in specimens if each.experiment.fitted]
    for name in parameters:
        if not any(name in each.names for each in fitted):
            known = sorted({key for each in fitted for key in dict(numbers_of(each.problem))})
            allowed = f"is no number of any fitted experiment, which have {', '.join(known)}"
            raise InputError(f"parameter {name!r}", allowed, "fit", did_you_mean(name, known))
    return specimens


def _open(
    experiment: Experiment,
    parameters: Values,
    fabric: Mapping[str, Any] | Fabric | None,
    shared: Mapping[str, Any],
) -> Specimen:
    sizes = {name: getattr(experiment, name) for name in ("h", "dt", "t_end")}
    own: dict[str, Any] = {name: value for name, value in sizes.items() if value is not None}
    own |= {"probes": experiment.probes} if len(experiment.probes) else {}
    given = own if isinstance(experiment.problem, Opened) else {**shared, **own}
    problem = open_study(experiment.problem, given).problem
    if isinstance(problem, SceneProblem):
        start = {k: v for k, v in parameters.items() if k.startswith(f"{FABRIC}.")}
        base: Any = problem.tables.get(FABRIC, {}) if fabric is None else fabric
        if isinstance(base, Fabric):
            base = {k: v for k, v in dataclasses.asdict(base).items() if v not in (None, "")}
        if Shorthands.model_fields.keys() & base.keys():  # as a preset, which has more constants
            base = problem.changed(Change(values={FABRIC: base})).tables[FABRIC]
        if fabric is not None or start:
            problem = problem.changed(Change(values={FABRIC: fabric_with(base, start)}))
    else:
        if fabric is not None:
            raise InputError("fabric = …", "is for scenes; a function makes its own", "fit")
        taken = inspect.signature(problem.function).parameters
        start = {k: v for k, v in parameters.items() if k.partition(".")[0] in taken}
        problem = problem.changed(Change(values=grouped(problem, start)))
    known = dict(numbers_of(problem))
    names = [n for n in parameters if n in known or any(k.startswith(f"{n}.") for k in known)]
    for name in parameters:
        refuse_sizes(problem, name)
    if not names:
        allowed = f"has none of the parameters {', '.join(parameters)}; it has {', '.join(known)}"
        remedy = did_you_mean(next(iter(parameters), ""), known)
        raise InputError(f"experiment {experiment.label}", allowed, "fit", remedy)
    return _measure(experiment, problem, tuple(names))


def _measure(experiment: Experiment, problem: Problem, names: tuple[str, ...]) -> Specimen:
    setup = problem.first
    specimen = Specimen(experiment, problem, names, ())
    for asked in specimen.quantities:
        # along a curve no vector will do: a column, as for a maximum
        problem.check_quantity(replace(asked, how="max") if specimen.is_curve else asked)
        if specimen.is_curve and (asked.how != "value" or asked.at is not None):
            allowed = "must be a column of the run, as reaction.grip.x"
            raise InputError(f"{asked}: along a curve", allowed, experiment.label)
    ledger = setup.energies
    units = [quantity.unit(ledger) for quantity in experiment.columns.values()]
    order = experiment.order
    if order is None:
        return replace(specimen, points=read_measured(experiment, units, "", None))
    _, quantity = order
    reach = known_reach(setup, quantity)
    unit = quantity.unit(ledger) if quantity else "" if setup.is_static else "s"
    points = read_measured(experiment, units, unit, reach)
    places = [p.along for p in points if p.along is not None]
    farthest = max(map(abs, reach)) if reach else max(map(np.ptp, places))
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
    for t in np.linspace(start.t, end, SAMPLES):
        target = constraints.target(start.t, t - start.t, start.x)[0]
        for x in (start.x, elsewhere):
            state = State(float(t), constraints.hold(x, target), np.zeros_like(x))
            row = replace(observer, start=state).row(None, None)
            values.append(row.get(quantity.column, np.nan))
    here, there = np.reshape(values, (SAMPLES, 2)).T
    if not np.allclose(here, there, rtol=0, atol=1e-9 * spread):
        return None
    changes = here - here[0]
    return float(changes.min()), float(changes.max())
