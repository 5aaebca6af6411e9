"""`budget`: what a computed quantity is worth beside a measured one."""

import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from fecloth.errors import InputError
from fecloth.fabric.priors import BIAS
from fecloth.scene.probe_tables import read_measured
from fecloth.scene.scene import Scene
from fecloth.simulation.quantity import Quantity
from fecloth.study.budgeting.inputs import read_inputs
from fecloth.study.budgeting.result import Budget, make_budget
from fecloth.study.budgeting.work import SAMPLES, Work
from fecloth.study.constants_read import with_estimates
from fecloth.study.opened import Opened, open_study
from fecloth.study.problem import Asked, StudyProblem
from fecloth.study.runs import (
    print_doubts,
    refuse_huge,
)
from fecloth.validation import known as known_name
from fecloth.validation import whole

WORDS_OF_PRIOR = f"{BIAS.estimate}, uncertain by the spread of 618 published fabrics"


def budget(
    problem: Scene | str | Path | Callable | Opened,
    uncertain: Mapping[str, Any] | None = None,
    measured: Mapping[str, Any] | None = None,
    quantity: Asked | Sequence[Asked] | None = None,
    *,
    samples: int | None = None,
    seed: int = 0,
    **shared: Any,
) -> Budget:
    """Add up how uncertain computed quantities are, and compare them with measured ones.

    The parts are standard uncertainties of each quantity:

        total² = time² + space² + solver² + input² + specimen² + law² + start² + data²

    time, space and solver are halves of the uncertainties that `converge` gives with 3 levels
    of h; `value` is the one of the finest level. A half is taken because the uncertainties of
    `converge` are meant to cover the exact value.

    input² = gᵀ V g is the first order: g are the derivatives of `sensitivity` by the uncertain
    numbers, and V is the covariance of these. Two runs, one standard deviation away on both
    sides, show whether it holds. Where it does not, as where a cloth buckles, samples take its
    place, and their standard deviation is the uncertainty.

    specimen and law are the parts of the fabric's [fabric.uncertainty] with these names, of the
    change of the quantity from its start: by how much single specimens differ from their mean,
    and how far the law is off with the best constants, as `fit` finds both.

    start is the standard deviation over disturbed starts. Where an equilibrium has other states,
    it is at least the largest distance of their values from `value`: the cloth is laid in waves,
    flat, and dropped, on the finest mesh that the time allows. data is the uncertainty of a
    measured value D. With `difference` = value − D, they agree where |difference| ≤ 2 total;
    otherwise the model, its law or the experiment is wrong. There is no such verdict where the
    uncertainty of a constant of the fabric is not known that a term reads: these are named, and
    total has the known parts. Other numbers without an uncertainty count as exact, and are listed.

    Parameters
    ----------
    problem
        As for `fecloth.study.of`.
    uncertain
        Standard uncertainties by the names of numbers, as for `sensitivity`: a percentage as
        "10 %", a number in SI or, of a scene, a text with a unit; ``"start": 5`` for five
        disturbed starts; ``"slack": "0.1 mm"`` of specimens, for quantities at a place. The
        numbers of a fabric have theirs from its [fabric.uncertainty], with correlations;
        entries here replace them. By default the table [uncertain] of a
        scene.
    measured
        (value, standard uncertainty) by quantity. By default the table [measured] of a scene.
    quantity
        One, or a list; by default all of [interest], else what was measured. They must be
        numbers, no fields or paths.
    samples
        Number of samples; None: the first order where it holds, else 64. Constants of fabrics
        that must be positive have a logarithmic normal distribution, other numbers a normal
        one.
    seed
        Of samples and disturbed starts.
    shared
        Arguments of `fecloth.study.of`, as h, dt, probes, jobs and cache.

    Returns
    -------
    Budget
        With value, time, space, solver, input, specimen, law, start, data, total, difference
        and agrees:
        numbers of a single quantity, else arrays. `difference` is NaN where nothing was
        measured.

    Raises
    ------
    InputError
        For a key that is no number of the problem, a wrong uncertainty, a quantity that is no
        number, a measured quantity that is not among the quantities, or too long a time.
    StudyFailed
        If the problem itself fails on a level.

    Notes
    -----
    Source: ASME V&V 20-2009, Standard for Verification and Validation in Computational Fluid
    Dynamics and Heat Transfer: E = S − D and u_val² = u_num² + u_input² + u_D².
    """
    study = open_study(problem, shared)
    opened, estimated = with_estimates(study.problem)
    study = replace(study, problems=(opened,))
    opened.check_refining("h")
    whole("samples", SAMPLES if samples is None else samples, 2, "budget")
    whole("seed", seed, 0, "budget")
    if uncertain is None:
        uncertain = opened.tables.get("uncertain") or {}
    if measured is None:
        measured = opened.tables.get("measured") or {}
    inputs = read_inputs(opened, uncertain, estimated)
    data = read_measured(measured, opened.first.energies if measured else ())
    is_single = isinstance(quantity, str | Quantity) or callable(quantity)
    names_of_quantities: Any = quantity or opened.source.interest or list(data) or None
    if is_single:
        names_of_quantities = [quantity]
    quantities = opened.choose_quantities(names_of_quantities)
    _refuse_fields(opened, quantities)
    texts = dict.fromkeys(q.text for q in (*quantities, *opened.quantities))
    for name in data:
        known_name(f"measured {name!r} (it is not in [interest])", name, texts, "budget")
    refuse_huge(opened, study.runs())
    doubts = print_doubts(opened)
    work = Work(study, quantities)
    parts, first_values, remarks_on_states = work.numerical()
    parts["input"], shares, remarks_on_input = work.input(inputs, samples, seed)
    names = inputs.names
    if inputs.slack:
        of_slack = work.slack(inputs.slack)
        parts["input"] = np.hypot(parts["input"], of_slack)
        names = [*names, "slack"]
        if shares.size or not inputs.names:
            shares = np.column_stack([shares.reshape(len(quantities), -1), of_slack**2])
    change = np.abs(parts["value"] - work.values_at_start())
    parts["specimen"] = inputs.specimen * change
    parts["law"] = inputs.law * change
    by_disturbances, remarks_on_starts = work.starts(inputs.starts, seed)
    parts["start"] = np.maximum(parts["start"], by_disturbances)
    result = make_budget(
        opened=opened,
        quantities=quantities,
        values_and_parts=parts,
        measured=data,
        parameters=names,
        shares=shares,
        is_single=is_single,
        unknown=inputs.unknown,
        exact=inputs.exact,
    )
    remarks = [f"{name} was not measured: {WORDS_OF_PRIOR}." for name in estimated if name in names]
    remarks += [*remarks_on_states, *work.ends_of_friction(first_values)]
    remarks += [*remarks_on_input, *remarks_on_starts]
    return replace(result, doubts=doubts, remarks=tuple(remarks))


def tolerance_of_data(study: Opened, quantity: Any) -> float:
    """Return a third of the relative uncertainty of the quantities by the uncertain numbers.

    It is the least one of all quantities. A computation whose relative error is as small is
    accurate enough for these data. Numbers whose uncertainty is not known can only add to it:
    they are named on stderr.

    Raises
    ------
    InputError
        For a problem without numbers whose uncertainty is known, or an unknown quantity.
    """
    opened, estimated = with_estimates(study.problem)
    study = replace(study, problems=(opened,))
    inputs = read_inputs(opened, opened.tables.get("uncertain") or {}, estimated)
    unknown = ", ".join(inputs.unknown)
    if not inputs.parameters:
        allowed = "needs numbers in [uncertain] or [fabric.uncertainty]"
        remedy = f"State the uncertainty of {unknown}." if unknown else ""
        raise InputError("--to-data", allowed, opened.where, remedy)
    if unknown:
        words = f"not known, and not counted in the tolerance: the uncertainty of {unknown}"
        print(words, file=sys.stderr, flush=True)
    work = Work(study, opened.choose_quantities(quantity))
    (values,), _ = work.run([("the problem", {})])
    uncertainty, _, _ = work.input(inputs, None, 0)
    return float((uncertainty / (3 * np.abs(values))).min())


def _refuse_fields(opened: StudyProblem, quantities: Sequence[Quantity]) -> None:
    """Raise `InputError` for a quantity that is no number: a field, a path or a vector."""
    row = opened.first.recording(quantity.column for quantity in quantities).row()
    for quantity in quantities:
        # the columns of a vector have its name and .x, .y, .z
        is_vector = quantity.how == "value" and f"{quantity.column}.x" in row
        if not (quantity.is_field or quantity.how == "path" or is_vector):
            continue
        if quantity.is_field:
            remedy = "Take sag, say."
        else:
            remedy = f"Take a component, as {quantity.name}.z."
        raise InputError(f"quantity {quantity.text}", "must be a number", "budget", remedy)
