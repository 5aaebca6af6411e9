"""The unknowns of a fit: constants by their logarithms where they are positive, and offsets."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fecloth.errors import InputError, is_number
from fecloth.fabric.fabric import MAX_CONSTANT
from fecloth.study.fitting.specimens import Specimen

RATIOS = ("poisson_ratio", "bending_poisson_ratio")  # of a fabric: may be negative or 0
RATIO_WIDTH = 0.5  # the unit of a ratio
LIMIT = 0.999  # of a ratio that must lie between -1 and 1


@dataclass(frozen=True)
class Unknown:
    """A number that is sought, p = p₀ exp(u) where it is positive, else p₀ + w u."""

    name: str
    start: float
    width: float  # w; 0 of a positive number
    specimen: int | None = None  # whose offset it is, if it is one

    @property
    def is_offset(self) -> bool:
        return self.specimen is not None

    def at(self, u: float) -> float:
        if self.width:
            return self.start + self.width * u
        return self.start * math.exp(u)

    def slope(self, u: float) -> float:
        """dp/du."""
        return self.width or self.at(u)

    def spread(self, u: float, distance: float) -> tuple[float, float]:
        """p at u − distance and at u + distance."""
        return self.at(u - distance), self.at(u + distance)

    @property
    def bounds(self) -> tuple[float, float]:
        """Limits of u, from what a fabric admits."""
        if self.width:
            bounded = self.name.endswith("bending_poisson_ratio")
            low, high = (
                ((s * LIMIT - self.start) / self.width if bounded else s * math.inf)
                for s in (-1.0, 1.0)
            )
            return low, high
        far = math.log(MAX_CONSTANT)
        return -far - math.log(self.start), far - math.log(self.start)


def make_unknowns(
    parameters: Mapping[str, float], specimens: tuple[Specimen, ...]
) -> tuple[Unknown, ...]:
    """The constants in the order of `parameters`, then the offsets of fitted experiments."""
    if not (isinstance(parameters, Mapping) and parameters):
        allowed = 'must be a mapping of names to starts, as {"fabric.tensile_stiffness": 1000.0}'
        raise InputError(f"parameters = {parameters!r}", allowed, "fit")
    constants = [_constant(name, value) for name, value in parameters.items()]
    offsets = [
        Unknown(f"offset of {each.experiment.label}", 0.0, each.reach, i)
        for i, each in enumerate(specimens)
        if each.experiment.offset and each.experiment.fitted
    ]
    return (*constants, *offsets)


def _constant(name: str, value: float) -> Unknown:
    if not is_number(value):
        raise InputError(f"parameter {name!r} = {value!r}", "must be a finite number, in SI", "fit")
    value = float(value)
    if name.rpartition(".")[2] in RATIOS:
        return Unknown(name, value, RATIO_WIDTH)
    return Unknown(name, value, 0.0 if value > 0 else abs(value) or 1.0)


def values_of(unknowns: tuple[Unknown, ...], u: np.ndarray) -> dict[str, float]:
    """The constants and offsets by name."""
    return {each.name: each.at(float(at)) for each, at in zip(unknowns, u, strict=True)}
