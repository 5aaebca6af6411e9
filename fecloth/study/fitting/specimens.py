"""The specimens of a fit: problems with the sought fabric, and what was measured of them."""

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fecloth.errors import InputError, did_you_mean
from fecloth.fabric.fabric import Fabric
from fecloth.scene.tables import Shorthands
from fecloth.simulation.quantity import Quantity
from fecloth.simulation.setup import Setup
from fecloth.study.derived_cases import Sought
from fecloth.study.fitting.experiment import Experiment
from fecloth.study.fitting.fabric import FABRIC, Values, fabric_with
from fecloth.study.fitting.measured import Measured, Reach, read_measured
from fecloth.study.opened import Opened, open_study
from fecloth.study.parameters import Parameter
from fecloth.study.problem import StudyProblem
from fecloth.study.runs import Run
from fecloth.study.sensitivities import derive
from fecloth.system.state import State

FINER = 2.0  # divides h and dt; its square divides rtol
TIMES_OF_GRIPS = 41  # in a run, at which the motion of grips is looked at for its extremes
OF_FIT = "the fabric of the fit"  # what errors name


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
    problem: StudyProblem
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
    def is_curve(self) -> bool:
        """Whether the points lie along a curve."""
        return self.experiment.along is not None

    def run(self, values: Values, widths: Values, tolerance: float) -> Run:
        """Return its run at these values of the constants, with derivatives by p/width.

        `tolerance` is their relative error.
        """
        parameters = tuple(Parameter(name, values[name], widths[name]) for name in self.names)
        problem = self.problem.at({p.name: p.value for p in parameters}, "these constants")
        sought = Sought(parameters, self.quantities, tolerance, self.is_curve)
        return derive(problem, sought)

    def finer(self) -> "Specimen | None":
        """Return the specimen with half of h and of dt, a quarter of rtol, twice the load steps.

        What the problem does not have stays out; return None if it has none of them.
        """
        finer = self.problem.finer(h=FINER, dt=FINER, rtol=FINER**2)
        finer = finer.at(_finer_values(self.problem))
        if finer is self.problem:
            return None
        return replace(self, problem=finer)


def _finer_values(problem: StudyProblem) -> dict[str, object]:
    """Return finer values for what `StudyProblem.finer` does not refine, by the keys of a scene.

    They are more load steps, and a smaller h of each piece of cloth that has an h of its own.
    """
    finer_values = dict[str, object]()
    load_steps = problem.tables.get("equilibrium", {}).get("load_steps", 1)
    key = problem.source.keys.get("load_steps")  # a term sets the load steps of a function
    if key and load_steps > 1:  # a single one has no path to refine
        finer_values[key] = int(FINER * load_steps)
    for name, piece in problem.tables["cloth"].get("pieces", {}).items():
        if piece.get("h"):
            finer_values[f"cloth.pieces.{name}.h"] = piece["h"] / FINER
    return finer_values


def open_specimens(
    experiments: Sequence[Experiment],
    parameters: Values,
    fabric: Mapping[str, Any] | Fabric | None,
    shared: Mapping[str, Any],
) -> tuple[Specimen, ...]:
    """Open the problems of all experiments, and read their data.

    `parameters` are the starts of the constants by name. `fabric` is the rest of the fabric of
    scenes; None if each has its own. `shared` are arguments of `fecloth.study.of`.

    Raise `InputError` for data that do not fit their problem, and for a parameter that is no
    number of any fitted experiment: nothing would tell it.
    """
    specimens = tuple(_open(experiment, parameters, fabric, shared) for experiment in experiments)
    fitted = [specimen for specimen in specimens if specimen.experiment.fitted]
    for name in parameters:
        if not any(name in specimen.names for specimen in fitted):
            numbers = {key for each in fitted for key, _ in each.problem.source.numbers()}
            names = sorted(numbers)
            allowed = f"is no number of any fitted experiment, which have {', '.join(names)}"
            raise InputError(f"parameter {name!r}", allowed, "fit", did_you_mean(name, names))
    return specimens


def _open(
    experiment: Experiment,
    parameters: Values,
    fabric: Mapping[str, Any] | Fabric | None,
    shared: Mapping[str, Any],
) -> Specimen:
    """Return the specimen of an experiment: its problem with the starts in it, and its data.

    The arguments are the ones of `open_specimens`. Raise `InputError` for a problem without any
    of the parameters, for a parameter that is a size such as h, and for a `fabric` beside a
    function.
    """
    sizes = {name: getattr(experiment, name) for name in ("h", "dt", "t_end")}
    own: dict[str, Any] = {name: value for name, value in sizes.items() if value is not None}
    if len(experiment.probes):
        own["probes"] = experiment.probes
    # a problem that is opened already has had the shared arguments
    arguments = own if isinstance(experiment.problem, Opened) else {**shared, **own}
    problem = open_study(experiment.problem, arguments).problem
    problem = _with_fabric(problem, parameters, fabric)
    names = tuple(name for name in parameters if problem.source.has_parameter(name))
    for name in parameters:
        problem.source.refuse_parameter(name)
    if not names:
        numbers = dict(problem.source.numbers())
        listed = ", ".join(parameters)
        allowed = f"has none of the parameters {listed}; it has {', '.join(numbers)}"
        remedy = did_you_mean(next(iter(parameters), ""), numbers)
        raise InputError(f"experiment {experiment.label}", allowed, "fit", remedy)
    problem = problem.at({name: parameters[name] for name in names}, OF_FIT)
    # without its starts a function may have no set-up, so that nothing can be estimated from it
    return _measure(experiment, replace(problem, root=None), names)


def _with_fabric(
    problem: StudyProblem, parameters: Values, fabric: Mapping[str, Any] | Fabric | None
) -> StudyProblem:
    """Return the scene with a fabric that has the starts of its constants.

    The fabric is `fabric`, or the scene's own if that is None. A function makes its own, and
    stays as it is. Raise `InputError` for a parameter that is no constant of a fabric, and for a
    fabric beside a function.
    """
    if not problem.source.fabrics:
        if fabric is not None:
            raise InputError("fabric = …", "is for scenes; a function makes its own", "fit")
        return problem
    start = {k: v for k, v in parameters.items() if k.startswith(f"{FABRIC}.")}
    base: Any = problem.tables.get(FABRIC, {}) if fabric is None else fabric
    if isinstance(base, Fabric):
        base = {k: v for k, v in dataclasses.asdict(base).items() if v not in (None, "")}
    if Shorthands.model_fields.keys() & base.keys():
        # a shorthand, such as a preset, stands for constants: the scene writes them out
        base = problem.at({FABRIC: base}, OF_FIT).tables[FABRIC]
    if fabric is None and not start:
        return problem
    return problem.at({FABRIC: fabric_with(base, start)}, OF_FIT)


def _measure(experiment: Experiment, problem: StudyProblem, names: tuple[str, ...]) -> Specimen:
    """Return the specimen of a problem, with the points that were measured.

    `names` are the unknown constants that the problem has. Raise `InputError` for a quantity
    that the run does not have, for one that is no plain column along a curve, and for data that
    do not fit (see `read_measured`).
    """
    setup = problem.first
    specimen = Specimen(experiment, problem, names, points=())
    for quantity in specimen.quantities:
        if not specimen.is_curve:
            problem.check_quantity(quantity)
            continue
        # the check of a maximum refuses vectors, too, which have no curve
        problem.check_quantity(replace(quantity, how="max"))
        if quantity.how != "value" or quantity.at is not None:
            allowed = "must be a column of the run, as reaction.grip.x"
            raise InputError(f"{quantity}: along a curve", allowed, experiment.label)
    energies = setup.energies
    units = [quantity.unit(energies) for quantity in experiment.columns.values()]
    if experiment.order is None:
        points = read_measured(experiment, units, along_unit="", reach=None)
        return replace(specimen, points=points)
    _, quantity_along = experiment.order
    if quantity_along:
        along_unit = quantity_along.unit(energies)
    elif setup.is_static:  # t is the part of the loads
        along_unit = ""
    else:
        along_unit = "s"
    reach = known_reach(setup, quantity_along)
    points = read_measured(experiment, units, along_unit, reach)
    if reach:
        farthest = max(map(abs, reach))
    else:
        farthest = max(np.ptp(column.along) for column in points if column.along is not None)
    # the reach is a unit, and must not be 0
    return replace(specimen, points=points, reach=float(farthest) or 1.0)


def known_reach(setup: Setup, quantity: Quantity | None) -> Reach | None:
    """Return the range that a run covers along its curve: the least and the largest place.

    The place is t if `quantity` is None, else the change of the quantity from its start. The
    range of a quantity is known before the run if it is one of the grips alone, whose motion is
    given. To see this, it is computed twice, with the free nodes at their start and at random
    places: it must stay the same. Return None if only the run will tell the range.
    """
    start = setup.start
    end = setup.t_end
    if end is None:
        return None
    if quantity is None:
        return start.t, end
    constraints = setup.system.constraints
    size = np.ptp(setup.cloth.X)
    random_x = start.x + size * np.random.default_rng(0).standard_normal(start.x.shape)
    observer = setup.recording([quantity.column]).observer
    values = []
    for t in np.linspace(start.t, end, TIMES_OF_GRIPS):
        target = constraints.target(start.t, t - start.t, start.x)[0]
        for x in (start.x, random_x):
            state = State(float(t), constraints.hold(x, target), np.zeros_like(x))
            row = replace(observer, start=state).row(None, None)
            values.append(row.get(quantity.column, np.nan))
    at_start, at_random = np.reshape(values, (TIMES_OF_GRIPS, 2)).T
    if not np.allclose(at_start, at_random, rtol=0, atol=1e-9 * size):  # 1e-9 is round-off
        return None
    changes = at_start - at_start[0]
    return float(changes.min()), float(changes.max())
