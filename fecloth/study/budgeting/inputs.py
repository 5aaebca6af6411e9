"""The uncertain numbers of a problem, and samples of them."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np

from fecloth.errors import InputError, brief, is_number
from fecloth.fabric.fabric import Fabric
from fecloth.fabric.merging import merged
from fecloth.fabric.uncertainty import (
    OF_CURVES,
    UNKNOWN,
    Uncertainty,
    correlations,
    covariance_of,
    part_of,
)
from fecloth.quantities.units import LENGTH, is_quantity, quantity
from fecloth.scene.toml_text import flatten_tables
from fecloth.study.constants_read import numbers_read
from fecloth.study.parameters import Parameter, choose_parameters
from fecloth.study.problem import StudyProblem

WHERE = "budget"
SIGNED = ("poisson_ratio", "bending_poisson_ratio")  # constants that may be negative
MOST_STARTS = 1000  # disturbed starts: a larger number is a mistake


@dataclass(frozen=True, eq=False)
class Inputs:
    """Uncertain numbers of a problem, and how many disturbed starts it has.

    Attributes
    ----------
    parameters
        The k numbers.
    covariance
        (k, k) covariance of their values.
    starts
        Number of disturbed starts.
    slack
        Standard uncertainty of the slack of a specimen, of quantities at a place of a grip.
    unknown
        Names of the constants of fabrics that the terms read, but whose uncertainty is not known.
    exact
        Names of other numbers that are not 0 and have no uncertainty: they count as exact.
    specimen, law
        Relative standard uncertainties of whole curves, of the fabric that has the largest.
    """

    parameters: tuple[Parameter, ...]
    covariance: np.ndarray
    starts: int = 0
    slack: float = 0.0
    unknown: tuple[str, ...] = ()
    exact: tuple[str, ...] = ()
    specimen: float = 0.0
    law: float = 0.0

    @property
    def names(self) -> list[str]:
        """The names of the numbers."""
        return [parameter.name for parameter in self.parameters]

    def moved(self, change: np.ndarray) -> np.ndarray:
        """(k,) the values after a change (k,); of positive constants by its exponential."""
        values = np.array([p.value for p in self.parameters])
        is_positive = np.array([_is_positive(p) for p in self.parameters])
        scale = np.where(is_positive, values, 1.0)
        return np.where(is_positive, values * np.exp(change / scale), values + change)

    def samples(self, count: int, seed: int) -> list[dict[str, float]]:
        """Return `count` samples: each has the values of all numbers, by their names.

        They are drawn by scrambled Sobol' points, which cover the distribution more evenly than
        random ones; `seed` scrambles them. Constants of fabrics that must stay positive have a
        logarithmic normal distribution with the same mean, deviation and correlation, the other
        numbers a normal one.
        """
        from scipy.stats import qmc  # takes most of a second, which few commands need

        mean = np.array([p.value for p in self.parameters])
        is_positive = np.array([_is_positive(p) for p in self.parameters])
        scale = np.where(is_positive, mean, 1.0)
        # covariance of z, where value = mean exp(z − V/2) if positive, else mean + z
        V = self.covariance / np.outer(scale, scale)
        V = np.where(np.outer(is_positive, is_positive), np.log1p(V), V)
        # eigenvectors give a root of V also where correlations of ±1 make it singular
        variances, axes = np.linalg.eigh(V)
        root = axes * np.sqrt(np.maximum(variances, 0.0))
        generator = qmc.MultivariateNormalQMC(np.zeros(len(V)), rng=np.random.default_rng(seed))
        # Sobol' points are balanced if their number is a power of 2
        standard_normal = generator.random(2 ** math.ceil(math.log2(count)))[:count]
        z = standard_normal @ root.T
        values = np.where(is_positive, mean * np.exp(z - 0.5 * np.diag(V)), mean + z)
        return [dict(zip(self.names, row.tolist(), strict=True)) for row in values]


def _is_positive(parameter: Parameter) -> bool:
    """Whether a number is a constant of a fabric that must stay positive."""
    keys = parameter.name.split(".")
    is_of_fabric = keys[0] in ("fabric", "fabrics")
    return is_of_fabric and parameter.value > 0 and not set(SIGNED) & set(keys)


def read_inputs(
    problem: StudyProblem,
    uncertain: Mapping[str, Any],
    estimated: Mapping[str, float] = MappingProxyType({}),
) -> Inputs:
    """Return the uncertain numbers of a problem, with their covariance and the disturbed starts.

    They stand in [fabric.uncertainty] of each fabric, and in `uncertain`: its keys are names of
    numbers, "start", "slack" and "correlation", its values standard uncertainties or "unknown", the
    number of starts, and a list of [name, name, number from -1 to 1]. An entry of
    `uncertain` replaces the same entry of [fabric.uncertainty]. A key that stands for several
    numbers, such as a pair, gives the uncertainty to each of them that is not 0. Numbers with
    the uncertainty 0 are left out. `estimated` has the uncertainty of numbers that nobody gave,
    see `with_estimates`, where no table has it.

    Raises
    ------
    InputError
        For a key that is no number of the problem, a wrong uncertainty, or a wrong number of
        disturbed starts.
    """
    uncertainties = dict(flatten_tables(uncertain))
    starts = uncertainties.pop("start", 0)
    if not (type(starts) is int and 0 <= starts <= MOST_STARTS and starts != 1):
        allowed = f"must be a number of disturbed starts from 2 to {MOST_STARTS}, or 0"
        raise InputError(f"start = {brief(starts)}", allowed, WHERE)
    slack = uncertainties.pop("slack", 0.0)
    if isinstance(slack, str):
        slack = quantity("slack", slack, LENGTH)
    if not (is_number(slack) and slack >= 0):
        raise InputError(f"slack = {brief(slack)}", 'must be a length >= 0, as "0.1 mm"', WHERE)
    given = uncertainties.pop("correlation", ())
    correlation = list[tuple[str, str, float]]()
    numbers = dict(problem.source.numbers())  # values by name
    standard = dict[str, float]()  # standard uncertainties by name
    unknown = list[str]()
    of_curves = dict.fromkeys(OF_CURVES, 0.0)
    for prefix, fabric in problem.source.fabrics.items():
        keys = [key for key in uncertainties if key.startswith(f"{prefix}.")]
        replaced = {key.removeprefix(f"{prefix}."): uncertainties.pop(key) for key in keys}
        try:
            own = _read_fabric(fabric, replaced)
            of_fabric = own.standard(fabric)
            covariance_of(of_fabric, own.correlation)  # refuses what is contradictory
        except InputError as error:
            what = f"{prefix}.{error.what}"
            raise InputError(what, error.allowed, WHERE, error.remedy) from None
        standard |= {f"{prefix}.{key}": u for key, u in of_fabric.items()}
        stated = {f"{prefix}.{key}" for key, _ in own.deviations}
        standard |= {
            key: estimated[key] for key in estimated.keys() - stated if key.startswith(f"{prefix}.")
        }
        correlation += [(f"{prefix}.{a}", f"{prefix}.{b}", rho) for a, b, rho in own.correlation]
        for key in OF_CURVES:
            of_curves[key] = max(of_curves[key], getattr(own, key))
    for key, uncertainty in uncertainties.items():
        items = [name for name in numbers if name.startswith(f"{key}.") and numbers[name]]
        for name in items or [key]:
            if uncertainty == UNKNOWN and name in numbers:
                unknown.append(name)
            elif name in numbers:
                standard[name] = _read_deviation(problem, name, uncertainty, numbers[name])
            else:
                standard[name] = 1.0  # `choose_parameters` refuses it below
    V = covariance_of(standard, [*correlation, *correlations(given, standard)])
    known = set(standard)
    kept = [i for i, u in enumerate(standard.values()) if u]
    names = [list(standard)[i] for i in kept]
    V = V[np.ix_(kept, kept)]
    deviations = dict(zip(names, np.sqrt(np.diag(V)).tolist(), strict=True))
    # a number that is 0 has no size: its deviation says by how much it is changed
    scales = {name: u for name, u in deviations.items() if not numbers.get(name, 1.0)}
    parameters = choose_parameters(problem, names, scales) if names else ()
    unknown += [name for name in numbers_read(problem) if name not in known]
    of_fabrics = tuple(f"{prefix}." for prefix in problem.source.fabrics)
    exact = tuple(
        name
        for name, value in numbers.items()
        if value and name not in {*known, *unknown} and not name.startswith(of_fabrics)
    )
    return Inputs(parameters, V, starts, slack, tuple(unknown), exact, **of_curves)


def _read_fabric(fabric: Fabric, replaced: Mapping[str, Any]) -> Uncertainty:
    """Return the uncertainty of a fabric; entries of `replaced` replace its own."""
    table = {}
    if isinstance(fabric.uncertainty, Uncertainty):
        table = fabric.uncertainty.table()
    uncertainty = Uncertainty.read(merged(table, (), replaced))
    assert uncertainty
    return uncertainty


def _read_deviation(problem: StudyProblem, key: str, uncertainty: Any, value: float) -> float:
    """Return the standard uncertainty of the number `key`, in the SI unit of the number.

    `uncertainty` is a number in SI; a text in per cent of the `value` of the number, as "10 %";
    or, for a scene, a text with a unit, as "2 mm". Raise `InputError` for anything else, a
    number below 0, and a part of the value 0.
    """
    number = part_of(value, uncertainty, key, WHERE)
    if isinstance(number, str) and is_quantity(number):
        # a scene knows the dimension of the key, and reads the text as a value of it
        number = dict(problem.at({key: uncertainty}).source.numbers()).get(key)
    if not (is_number(number) and number >= 0):
        allowed = 'must be a standard uncertainty >= 0 in the unit of the number, or as "10 %"'
        raise InputError(f"{key} = {brief(uncertainty)}", allowed, WHERE)
    return float(number)
