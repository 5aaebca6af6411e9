"""How uncertain the constants of a fabric are: standard uncertainties and their correlations."""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from fecloth.errors import InputError, brief, did_you_mean, is_number
from fecloth.quantities import units
from fecloth.quantities.units import Dimension, quantity

CONSTANTS: dict[str, Dimension | None] = {
    "areal_density": units.AREAL,
    "tensile_stiffness": units.PER_WIDTH,
    "poisson_ratio": None,
    "shear_stiffness": units.PER_ANGLE,
    "bending_rigidity": units.MOMENT,
    "bending_poisson_ratio": None,
    "bias_rigidity": units.MOMENT,
    "bending_hysteresis": units.HYSTERESIS,
}
PAIRS = ("tensile_stiffness", "bending_rigidity", "bending_hysteresis")
# Correlations that are rounded to seven digits may have an eigenvalue down to minus this.
LARGEST_NEGATIVE_EIGENVALUE = 1e-6
WHERE = "uncertainty"
PART = re.compile(r"(\d+\.?\d*(?:[eE][-+]?\d+)?)\s*%")
UNKNOWN = "unknown"  # in place of an uncertainty that nobody knows; it is not 0
OF_CURVES = ("specimen", "law")  # relative standard uncertainties of whole curves


@dataclass(frozen=True)
class Uncertainty:
    """Standard uncertainties of the constants of a fabric, and the correlations between them.

    A key is the name of a constant, as "shear_stiffness", or of one number of a pair (warp,
    weft), as "tensile_stiffness.0". The name of a pair stands for each of its numbers that has
    no key of its own. `read` makes an object from a table. A constant that is "unknown" is one
    whose uncertainty nobody knows, as is a constant without a key.

    Attributes
    ----------
    deviations
        (key, standard uncertainty) of each constant: a number in SI, or a text such as
        "10.0 %", which is a part of the constant, or "unknown".
    correlation
        (key, key, number from -1 to 1) of pairs of constants; others are not correlated.
    source
        Where the numbers come from.
    specimen
        Relative standard deviation of the curves of single specimens about their mean.
    law
        Relative standard uncertainty of a curve by the law, also with the best constants.
    """

    deviations: tuple[tuple[str, float | str], ...]
    correlation: tuple[tuple[str, str, float], ...] = ()
    source: str = ""
    specimen: float = 0.0
    law: float = 0.0

    @classmethod
    def read(cls, table: Any) -> Self | None:
        """Read a table: key → number in SI, text with a unit, "10 %", "unknown", or two for a pair.

        It may also have `correlation`, a list of [key, key, number], `source`, and `specimen` and
        `law`, as "5 %". None, and an
        `Uncertainty`, are returned as they are. Raises `InputError` for what is not a table, an
        unknown key, a negative number, or a correlation beyond ±1 or given twice.
        """
        if table is None or isinstance(table, cls):
            return table
        if not isinstance(table, Mapping):
            allowed = 'must be a table, as { shear_stiffness = "5 %" }'
            raise InputError(f"uncertainty = {brief(table)}", allowed, WHERE)
        by_key = dict(flat(table))
        correlation = by_key.pop("correlation", ())
        source = by_key.pop("source", "")
        if not isinstance(source, str):
            raise InputError(f"source = {brief(source)}", "must be a text", WHERE)
        of_curves = {key: relative(key, by_key.pop(key, 0.0), WHERE) for key in OF_CURVES}
        deviations = tuple((key, _deviation(key, value)) for key, value in by_key.items())
        rows = correlations(correlation, dict(deviations))
        return cls(deviations, correlation=rows, source=source, **of_curves)

    def table(self) -> dict[str, Any]:
        """Return a table from which `read` makes the same uncertainty."""
        others: dict[str, Any] = {"correlation": self.correlation, "source": self.source}
        others |= {key: getattr(self, key) for key in OF_CURVES}
        return dict(self.deviations) | {key: value for key, value in others.items() if value}

    def standard(self, fabric: Any) -> dict[str, float]:
        """Return the standard uncertainty, in SI, of each number of a `Fabric` that has one.

        Numbers whose uncertainty is unknown are left out. They are by the keys of `numbers_of`,
        in its order. Raises `InputError` for a key without a number in the fabric, or a
        percentage of 0.
        """
        numbers = numbers_of(vars(fabric))
        deviations: dict[str, float] = {}
        # Keys of pairs come first, so that the keys of single numbers replace them.
        for key, value in sorted(self.deviations, key=lambda item: item[0].count(".")):
            for name in _number_names(key, numbers):
                if value == UNKNOWN:
                    deviations.pop(name, None)
                elif isinstance(value, float):
                    deviations[name] = value
                elif not numbers[name]:
                    remedy = "Give the uncertainty as a number."
                    raise InputError(f'{key} = "{value}"', "is a part of 0", WHERE, remedy)
                else:
                    relative = float(value.removesuffix("%")) / 100
                    deviations[name] = relative * abs(numbers[name])
        return {name: deviations[name] for name in numbers if name in deviations}

    def covariance(self, fabric: Any, keys: Iterable[str] | None = None) -> np.ndarray:
        """Return the covariance (k, k) of k numbers of a `Fabric`: ρ_ij u_i u_j, in SI.

        The numbers are those with these `keys`, in their order, where the key of a pair stands
        for both numbers; without `keys` they are all numbers of `standard`. Raises `InputError`
        for a key without an uncertainty, and for correlations that contradict each other: then
        the matrix ρ has a negative eigenvalue.
        """
        standard = self.standard(fabric)
        place = {name: i for i, name in enumerate(standard)}
        if keys is None:
            keys = standard
        rows = [place[name] for key in keys for name in _number_names(key, place)]
        return covariance_of(standard, self.correlation)[np.ix_(rows, rows)]


def covariance_of(
    deviations: Mapping[str, float], correlation: Iterable[tuple[str, str, float]]
) -> np.ndarray:
    """Return the covariance (k, k) of k numbers: ρ_ij u_i u_j, with 0 for pairs without a row.

    A row of `correlation` is (key, key, ρ), where the key of a pair stands for both numbers.
    Raises `InputError` for a key without a deviation, and for correlations that contradict each
    other: then the matrix ρ has a negative eigenvalue.
    """
    place = {name: i for i, name in enumerate(deviations)}
    rho = np.eye(len(place))
    for *pair, value in correlation:
        i, j = ([place[name] for name in _number_names(key, place)] for key in pair)
        rho[np.ix_(i, j)] = rho[np.ix_(j, i)] = value
    if len(rho) and (least := np.linalg.eigvalsh(rho)[0]) < -LARGEST_NEGATIVE_EIGENVALUE:
        what = f"correlation: the least eigenvalue of its matrix is {least:.3g}"
        remedy = "Correlations contradict each other: make them smaller."
        raise InputError(what, "must be at least 0", WHERE, remedy)
    u = np.array(list(deviations.values()))
    return rho * np.outer(u, u)


def numbers_of(constants: Mapping[str, Any]) -> dict[str, float]:
    """Return the numbers among the constants of a fabric; a pair is KEY.0 and KEY.1."""
    numbers: dict[str, float] = {}
    for name in CONSTANTS:
        value: Any = constants.get(name)
        if np.ndim(value):
            numbers |= {f"{name}.{i}": float(item) for i, item in enumerate(value)}
        elif value is not None:
            numbers[name] = float(value)
    return numbers


def constant_of(key: str) -> str:
    """Return the name of a constant from its key or from the key of one number of a pair."""
    return key.partition(".")[0]


def flat(table: Mapping[str, Any]) -> Iterable[tuple[str, Any]]:
    """Yield keys and values, with KEY.0 and KEY.1 for a pair of values."""
    for key, value in table.items():
        if key in PAIRS and isinstance(value, list | tuple):
            value = {str(i): item for i, item in enumerate(value)}
        if isinstance(value, Mapping):
            yield from ((f"{key}.{i}", item) for i, item in value.items())
        else:
            yield key, value


def _deviation(key: str, value: Any) -> float | str:
    """Return the standard uncertainty of a key: a number in SI, or a text such as "10 %".

    "unknown" stays as it is. Raises `InputError` for an unknown key, a number that is negative
    or not finite, and for another text.
    """
    name, _, item = key.partition(".")
    if name not in CONSTANTS or (item and (name not in PAIRS or item not in ("0", "1"))):
        allowed = f"unknown key; the keys are {', '.join(CONSTANTS)}; KEY.0 and KEY.1 of a pair"
        raise InputError(f"{key} = {brief(value)}", allowed, WHERE, did_you_mean(key, CONSTANTS))
    if value == UNKNOWN:
        return UNKNOWN
    dimension = CONSTANTS[name]
    number = value
    # To 15 digits, so that "10 %", "10.0%" and "1e1 %" give equal texts.
    if isinstance(value, str) and (part := PART.fullmatch(value.strip())):
        return f"{float(part[1]):.15g} %"
    if isinstance(value, str) and dimension:
        number = quantity(key, value, dimension, ', or a part such as "10 %"')
    if not (is_number(number) and number >= 0):
        unit = f" [{dimension.si}]" if dimension else ""
        allowed = (
            f'must be a standard uncertainty >= 0{unit}, or a part such as "10 %", or "unknown"'
        )
        raise InputError(f"{key} = {brief(value)}", allowed, WHERE)
    return float(number)


def relative(name: str, value: Any, where: str) -> float:
    """Return a relative uncertainty >= 0, from a number or a text such as "5 %".

    Raises `InputError` for anything else, with the `name` of the entry.
    """
    number = part_of(1.0, value, name)
    if not (is_number(number) and number >= 0):
        allowed = 'must be a relative standard uncertainty >= 0, as "5 %" or 0.05'
        raise InputError(f"{name} = {brief(value)}", allowed, where)
    return float(number)


def part_of(value: float, uncertainty: Any, name: str, where: str = "") -> Any:
    """Return the uncertainty of a value that a text gives as a part of it, such as "10 %".

    Anything else is returned as it is. Raises `InputError` for a part of 0, with the `name` of
    the value.
    """
    part = PART.fullmatch(uncertainty.strip()) if isinstance(uncertainty, str) else None
    if part is None:
        return uncertainty
    if not value:
        remedy = "Give the uncertainty as a number."
        raise InputError(f'{name} = "{uncertainty}"', "is a part of 0", where, remedy)
    return float(part[1]) / 100 * abs(value)


def correlations(
    correlation: Any, deviations: Mapping[str, Any]
) -> tuple[tuple[str, str, float], ...]:
    """Return the rows (key, key, number) of the entry `correlation` of a table.

    Raises `InputError` for a row of another form, a number beyond ±1, a key that has no
    uncertainty in `deviations`, and two keys that are given twice.
    """
    if not isinstance(correlation, list | tuple):
        correlation = [correlation]  # refused below
    rows: list[tuple[str, str, float]] = []
    for row in correlation:
        fits = isinstance(row, list | tuple) and len(row) == 3 and is_number(row[2])
        if not (fits and abs(row[2]) <= 1 and row[0] != row[1]):
            allowed = "must be [key, another key, a number from -1 to 1]"
            raise InputError(f"correlation {brief(row)}", allowed, WHERE)
        for key in row[:2]:
            if key not in deviations and constant_of(str(key)) not in deviations:
                what = f"correlation of {key!r}, which has no uncertainty"
                allowed = f"must be one of {', '.join(deviations)}"
                raise InputError(what, allowed, WHERE, did_you_mean(key, deviations))
        if {row[0], row[1]} in [{first, second} for first, second, _ in rows]:
            raise InputError(f"correlation {brief(row)}", "is given twice", WHERE)
        rows.append((row[0], row[1], float(row[2])))
    return tuple(rows)


def _number_names(key: str, numbers: Mapping[str, Any]) -> list[str]:
    """Return the key, or the keys of both numbers of a pair."""
    names = [name for name in numbers if name == key or name.startswith(f"{key}.")]
    if not names:
        allowed = f"must be a number of the fabric, with an uncertainty: {', '.join(numbers)}"
        raise InputError(f"key {key!r}", allowed, WHERE, did_you_mean(key, numbers))
    return names
