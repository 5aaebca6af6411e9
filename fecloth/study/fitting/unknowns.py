"""The unknowns of a fit: constants by their logarithms where they are positive, and offsets."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fecloth.errors import InputError, is_number
from fecloth.fabric.fabric import MAX_CONSTANT
from fecloth.study.fitting.specimens import Specimen

RATIOS = ("poisson_ratio", "bending_poisson_ratio")  # of a fabric: may be negative or 0
# The unit of a ratio in u: with a standard uncertainty of 0.25, it is just told.
WIDTH_OF_RATIO = 0.5
LARGEST_RATIO = 0.999  # of a ratio that must lie between -1 and 1, where a stiffness is singular


@dataclass(frozen=True)
class Unknown:
    """A number p that is sought, p = p₀ exp(u) where it is positive, else p₀ + w u.

    Attributes
    ----------
    name
        Its name.
    start
        p₀, where the search begins.
    width
        w; 0 of a positive number.
    specimen
        The number of the specimen whose offset it is; None for a constant.
    """

    name: str
    start: float
    width: float
    specimen: int | None = None

    @property
    def is_offset(self) -> bool:
        """Whether it is an offset of an experiment, and no constant."""
        return self.specimen is not None

    def at(self, u: float) -> float:
        """p at u."""
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
        """The least and the largest u, from what a fabric admits.

        A positive number lies between 1/MAX_CONSTANT and MAX_CONSTANT. A bending Poisson's ratio
        lies between −1 and 1. Other numbers have no limits.
        """
        if not self.width:
            far = math.log(MAX_CONSTANT)
            return -far - math.log(self.start), far - math.log(self.start)
        if not self.name.endswith("bending_poisson_ratio"):
            return -math.inf, math.inf
        low = (-LARGEST_RATIO - self.start) / self.width
        high = (LARGEST_RATIO - self.start) / self.width
        return low, high


def make_unknowns(
    parameters: Mapping[str, float], specimens: tuple[Specimen, ...]
) -> tuple[Unknown, ...]:
    """Return the unknowns: the constants in the order of `parameters`, then the offsets.

    `parameters` has the start of each constant by its name. Each fitted experiment with an
    offset has one, which starts at 0. Raise `InputError` if `parameters` is no mapping, is
    empty, or has a start that is no finite number.
    """
    if not (isinstance(parameters, Mapping) and parameters):
        allowed = 'must be a mapping of names to starts, as {"fabric.tensile_stiffness": 1000.0}'
        raise InputError(f"parameters = {parameters!r}", allowed, "fit")
    constants = [_constant(name, value) for name, value in parameters.items()]
    offsets = [
        Unknown(
            name=f"offset of {specimen.experiment.label}",
            start=0.0,
            width=specimen.reach,
            specimen=i,
        )
        for i, specimen in enumerate(specimens)
        if specimen.experiment.offset and specimen.experiment.fitted
    ]
    return (*constants, *offsets)


def _constant(name: str, value: float) -> Unknown:
    """Return the unknown of a constant that starts at `value`, in SI.

    A number > 0 is sought by its logarithm, others not: Poisson's ratios, which may change
    their sign, and starts at 0 or below. Raise `InputError` if the value is no finite number.
    """
    if not is_number(value):
        what = f"parameter {name!r} = {value!r}"
        raise InputError(what, "must be a finite number, in SI", "fit")
    value = float(value)
    if name.rpartition(".")[2] in RATIOS:
        return Unknown(name, value, WIDTH_OF_RATIO)
    if value > 0:
        return Unknown(name, value, width=0.0)
    return Unknown(name, value, width=abs(value) or 1.0)  # 0 has no size of its own


def values_of(unknowns: tuple[Unknown, ...], u: np.ndarray) -> dict[str, float]:
    """The constants and offsets by name."""
    pairs = zip(unknowns, u, strict=True)
    return {unknown.name: unknown.at(float(place)) for unknown, place in pairs}
