"""The uncertain numbers of a problem, and samples of them."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import block_diag
from scipy.stats import qmc

from fecloth.errors import InputError, brief, is_number
from fecloth.fabric.fabric import Fabric
from fecloth.fabric.uncertainty import PART, Uncertainty, merged
from fecloth.quantities.units import is_quantity
from fecloth.study.change import Change
from fecloth.study.parameters import Parameter, choose_parameters, numbers_of
from fecloth.study.problems import Problem, SceneProblem

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
    """

    parameters: tuple[Parameter, ...]
    covariance: np.ndarray
    starts: int = 0

    @property
    def names(self) -> list[str]:
        """The names of the numbers."""
        return [parameter.name for parameter in self.parameters]

    def samples(self, count: int, seed: int) -> list[dict[str, float]]:
        """Values of all numbers by name, `count` times, by scrambled Sobol' points.

        Constants of fabrics that must stay positive have a logarithmic normal distribution with
        the same mean, deviation and correlation, the other numbers a normal one.
        """
        mean = np.array([p.value for p in self.parameters])
        positive = np.array([_is_positive(p) for p in self.parameters])
        scale = np.where(positive, mean, 1.0)
        V = self.covariance / np.outer(scale, scale)
        V = np.where(np.outer(positive, positive), np.log1p(V), V)
        squares, axes = np.linalg.eigh(V)  # also where correlations of ±1 make V singular
        generator = qmc.MultivariateNormalQMC(np.zeros(len(V)), rng=np.random.default_rng(seed))
        drawn = generator.random(2 ** math.ceil(math.log2(count)))[:count]
        z = drawn @ (axes * np.sqrt(np.maximum(squares, 0.0))).T
        values = np.where(positive, mean * np.exp(z - 0.5 * np.diag(V)), mean + z)
        return [dict(zip(self.names, row.tolist(), strict=True)) for row in values]


def _is_positive(parameter: Parameter) -> bool:
    """Whether a number is a constant of a fabric that must stay positive."""
    keys = parameter.name.split(".")
    is_of_fabric = keys[0] in ("fabric", "fabrics")
    return is_of_fabric and parameter.value > 0 and not set(SIGNED) & set(keys)


def read_inputs(problem: Problem, uncertain: Mapping[str, Any]) -> Inputs:
    """The inputs by [fabric.uncertainty] and a table `uncertain`, which replaces entries of it.

    Raises
    ------
    InputError
        For a key that is no number of the problem, or a wrong uncertainty.
    """
    given = dict(_flat("", uncertain))
    starts = given.pop("start", 0)
    if not (type(starts) is int and 0 <= starts <= MOST_STARTS and starts != 1):
        allowed = f"must be a number of disturbed starts from 2 to {MOST_STARTS}, or 0"
        raise InputError(f"start = {brief(starts)}", allowed, WHERE)
    known = dict(numbers_of(problem))
    names = list[str]()
    blocks = [np.zeros((0, 0))]
    for prefix, fabric in _fabrics(problem).items():
        keys = [key for key in given if key.startswith(f"{prefix}.")]
        own = {key.removeprefix(f"{prefix}."): given.pop(key) for key in keys}
        constants, covariance = _read_fabric(fabric, own)
        names += [f"{prefix}.{key}" for key in constants]
        blocks.append(covariance)
    for key, value in given.items():
        items = [name for name in known if name.startswith(f"{key}.") and known[name]]
        for name in items or [key]:
            if name not in known:  # `choose_parameters` refuses it
                names.append(name)
                blocks.append(np.ones((1, 1)))
            elif u := _deviation(problem, name, value, known[name]):
                names.append(name)
                blocks.append(np.array([[u * u]]))
    V = block_diag(*blocks)
    pairs = zip(names, np.sqrt(np.diag(V)).tolist(), strict=True)
    scales = {name: u for name, u in pairs if not known.get(name, 1.0)}
    parameters = choose_parameters(problem, names, scales) if names else ()
    return Inputs(parameters, V, starts)


def _read_fabric(fabric: Fabric, replaced: Mapping[str, Any]) -> tuple[list[str], np.ndarray]:
    """The uncertain constants of a fabric and their covariance, with some entries replaced."""
    table = {}
    if isinstance(fabric.uncertainty, Uncertainty):
        table = fabric.uncertainty.table()
    uncertainty = Uncertainty.read(merged(table, (), replaced))
    assert uncertainty
    constants = [key for key, u in uncertainty.standard(fabric).items() if u]
    return constants, uncertainty.covariance(fabric, constants)


def _flat(name: str, table: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """The entries of nested tables by their keys with dots; `name` is the key of the table."""
    for key, value in table.items():
        full_key = f"{name}.{key}" if name else str(key)
        if isinstance(value, Mapping):
            yield from _flat(full_key, value)
        else:
            yield full_key, value


def _fabrics(problem: Problem) -> dict[str, Fabric]:
    """The fabrics of a scene, by the keys of their tables."""
    if not isinstance(problem, SceneProblem):
        return {}
    scene = problem.scene
    several = (scene.fabrics or {}).items()
    tables = {"fabric": scene.fabric} | {f"fabrics.{name}": table for name, table in several}
    return {name: table.make() for name, table in tables.items() if table}


def _deviation(problem: Problem | None, key: str, given: Any, value: float) -> float:
    """A standard uncertainty of a number: in SI, a text with a unit, or a part in per cent."""
    number = given
    if isinstance(given, str) and (part := PART.fullmatch(given.strip())):
        if not value:
            remedy = "Give the uncertainty as a number."
            raise InputError(f'{key} = "{given}"', "is a part of 0", WHERE, remedy)
        number = float(part[1]) / 100 * abs(value)
    elif isinstance(given, str) and isinstance(problem, SceneProblem) and is_quantity(given):
        changed = problem.changed(Change(values={key: given}))  # which knows the unit of the key
        number = dict(numbers_of(changed)).get(key)
    if not (is_number(number) and number >= 0):
        allowed = 'must be a standard uncertainty >= 0 in the unit of the number, or as "10 %"'
        raise InputError(f"{key} = {brief(given)}", allowed, WHERE)
    return float(number)


def read_measured(given: Mapping[str, Any]) -> dict[str, tuple[float, float]]:
    """Measured values with standard uncertainties, by quantity: (value, u), u also as "2 %"."""
    measured = {}
    for name, pair in _flat("", given):  # nested by tip.x without quotation marks
        u = 0.0
        if isinstance(pair, list | tuple) and len(pair) == 2 and is_number(pair[0]):
            u = _deviation(None, f"measured {name}", pair[1], float(pair[0]))
        if not u:
            allowed = (
                'must be a value and its standard uncertainty > 0, as [0.036, 0.0005 or "2 %"]'
            )
            raise InputError(f"measured {name} = {brief(pair)}", allowed, WHERE)
        text = " ".join(name.split())
        measured[text] = (float(pair[0]), u)
    return measured
