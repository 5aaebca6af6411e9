"""What a run answers: the values of its quantities, and what it knows of their errors."""

import math
import shlex
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from fecloth.errors import InputError
from fecloth.quantities.digits import with_uncertainty
from fecloth.simulation.account import Accounts
from fecloth.simulation.probes import Probe
from fecloth.simulation.quantity import Quantity
from fecloth.simulation.quantity_values import RunRecord, value_of
from fecloth.simulation.rest_stability import RestStability
from fecloth.simulation.time_error import TimeError
from fecloth.simulation.time_error_words import LARGEST_STATED

NOT_OF_A_RUN = ("mode", "function")  # `how` of quantities that a run does not compute


@dataclass(frozen=True)
class Answer:
    """The value of a quantity, and what its run knows of the error.

    Attributes
    ----------
    value
        The value; NaN where the run has none, as the period of a cloth that does not swing.
    uncertainty
        The estimated error; NaN where it is not known. Of a place in a motion it is the error
        in time alone: `parts` says so. Of an equilibrium it is not known, because the mesh has
        most of it: `fc.study.converge` tells it.
    parts
        Estimated parts of the error by their cause: "time" of a motion, "solver" of an
        equilibrium. {} for what is no place or length.
    unit
        SI unit of the numbers; "" for a pure number.
    measured
        The measured value and its standard uncertainty, or None.

    Examples
    --------
    >>> print(Answer(0.123456, 0.0021, {"time": 0.0021}, "m", measured=(0.13, 0.01)))
    0.1235 ± 0.0021 m (time); measured 0.130 ± 0.010 m
    """

    value: float
    uncertainty: float = math.nan
    parts: Mapping[str, float] = field(default_factory=dict)
    unit: str = ""
    measured: tuple[float, float] | None = None

    def __str__(self) -> str:
        return "; ".join(filter(None, (self.in_words(), self.measured_in_words)))

    def in_words(self) -> str:
        """Return value, unit and error; an error that is a part of the whole names its cause."""
        if math.isnan(self.value):
            return "no value in this run"
        if not math.isnan(self.uncertainty):
            number = with_uncertainty(self.value, self.uncertainty, self.unit)
            return f"{number} ({', '.join(self.parts)})"
        words = f"{self.value:.6g} {self.unit}".strip() + " ± not known"
        if not self.parts:
            return words
        known = (f"{cause} {part:.1g} {self.unit}" for cause, part in self.parts.items())
        return f"{words} ({', '.join(known)})"

    @property
    def measured_in_words(self) -> str:
        """The measured value with its uncertainty, or ""."""
        if self.measured is None:
            return ""
        return f"measured {with_uncertainty(*self.measured, self.unit)}"

    def entry(self) -> dict[str, object]:
        """Return the answer as summary.json has it: None for what is not known."""
        entry: dict[str, object] = {
            "value": None if math.isnan(self.value) else self.value,
            "uncertainty": None if math.isnan(self.uncertainty) else self.uncertainty,
            "parts": dict(self.parts),
            "unit": self.unit,
        }
        if self.measured is not None:
            entry["measured"] = list(self.measured)
        return entry


def places_of(probes: Iterable[Probe | str]) -> tuple[Quantity, ...]:
    """Return what probes answer: where each is at the end, and columns that are asked by name."""
    names = list[str]()
    for probe in probes:
        if isinstance(probe, str):
            names.append(probe.replace(":", "."))  # as quantities write line_force:left
        else:
            names += [f"{probe.name}.{axis}" for axis in "xyz"]
    return tuple(Quantity(name, name) for name in names)


def answer_quantities(
    quantities: Iterable[Quantity],
    record: RunRecord,
    accounts: Accounts,
    measured: Mapping[str, tuple[float, float]],
) -> dict[str, Answer]:
    """Return the answer to each quantity of a run that has ended, by the text of the quantity.

    `accounts` are at the end of the run, and `measured` are measured values with their standard
    uncertainties by the texts of quantities. Frequencies of modes and functions of the result
    are left out: a run does not compute them.
    """
    answers = {}
    for quantity in quantities:
        if quantity.how in NOT_OF_A_RUN:
            continue
        parts = _find_parts(quantity, record, accounts)
        answers[quantity.text] = Answer(
            value=_value(quantity, record),
            uncertainty=parts.get("time", math.nan),
            parts=parts,
            unit=quantity.unit(record.energies),
            measured=measured.get(quantity.text),
        )
    return answers


def list_answers(answers: Mapping[str, Answer], refining: Sequence[str] = ()) -> list[str]:
    """Return a line for each answer: name, value, unit, error, and the measured value.

    `refining` are the words of the command that refines the scene, without its quantity.
    """
    width = max(map(len, answers), default=0)
    lines = []
    for name, answer in answers.items():
        words = f"{name:<{width}}  {answer.in_words()}"
        if command := refining_command(name, answer, refining):
            words += f": {command}"
        lines.append("; ".join(filter(None, (words, answer.measured_in_words))))
    return lines


def refining_command(name: str, answer: Answer, refining: Sequence[str]) -> str:
    """Return the command that tells an error which is not known, as a shell reads it, or ""."""
    if not refining or math.isnan(answer.value) or not math.isnan(answer.uncertainty):
        return ""
    return shlex.join([*refining, "--quantity", name])


def _value(quantity: Quantity, record: RunRecord) -> float:
    """Return the value; NaN where the run has none, as of a distance of what is never near."""
    try:
        value = value_of(quantity, record)
    except InputError:
        return math.nan
    return value if math.isfinite(value) else math.nan


def _find_parts(quantity: Quantity, record: RunRecord, accounts: Accounts) -> dict[str, float]:
    """Return the parts of the error of a place or a length that the accounts know.

    The error in time is relative to the largest displacement of the cloth, a mean over its
    nodes. A quantity that moves further has an error as much larger.
    """
    is_field = quantity.name == "displacement" and quantity.norm == "l2"
    if not is_field and (quantity.is_field or quantity.unit(record.energies) != "m"):
        return {}
    over_area = 1.0
    if is_field and record.cloth:
        over_area = math.sqrt(record.cloth.area)  # of the norm of a field that is 1 m
    rest = accounts.get(RestStability)
    if rest and not math.isnan(rest.solver_error):
        return {"solver": rest.solver_error * over_area}
    error = accounts.get(TimeError)
    if error is None or not error.relative < LARGEST_STATED:
        return {}
    scale = max(error.moved, 0.0 if is_field else _largest_change(quantity, record))
    return {"time": error.relative * scale * over_area}


def _largest_change(quantity: Quantity, record: RunRecord) -> float:
    """Return how far a place has been from its start, at most; of a component its whole vector."""
    name, _, axis = quantity.column.rpartition(".")
    if axis in ("x", "y", "z") and name in record.vectors:
        quantity = Quantity(name, name)
    column = record.column(quantity)
    lengths = np.linalg.norm(column - column[0], axis=1)
    return float(lengths.max(initial=0.0, where=np.isfinite(lengths)))
