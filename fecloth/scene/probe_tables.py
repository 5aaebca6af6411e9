"""The tables [[probes]], [expect] and [interest] of a scene file: results of a run."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BeforeValidator, Field, model_validator

from fecloth.errors import InputError
from fecloth.quantities.units import LENGTH, TIME
from fecloth.scene.field_types import Name
from fecloth.scene.table_model import Table, require_exactly_one
from fecloth.simulation.probes import TAKEN, Probe
from fecloth.simulation.quantity import FIELDS, Quantity, parse_quantity

_TAKEN = (*TAKEN, *FIELDS, "reaction", "energy")  # names in the grammar of quantities


class ProbeTable(Table):
    """A named path: the mean of a node set, or a material point (X, Y) [m]."""

    name: Name
    """Name of the columns."""
    where: str | None = None
    """A node set, whose mean position is recorded."""
    point: Annotated[tuple[float, float] | None, LENGTH] = None
    """In place of `where`: a material point (X, Y) [m]."""

    @model_validator(mode="after")
    def _one_place(self):
        require_exactly_one(self, "where", "point")
        if self.name in _TAKEN:
            raise InputError(f"name = {self.name!r}", "is the name of a column of every run")
        return self

    def probe(self) -> Probe:
        return Probe(self.name, self.where, self.point)


class Expectation(Table):
    """A value within a relative or absolute tolerance, at the end or at a time [s]."""

    value: float
    """The expected value, in SI."""
    relative: float | None = Field(None, gt=0)
    """Tolerance relative to the value."""
    absolute: float | None = Field(None, gt=0)
    """In place of `relative`: tolerance in the unit of the value."""
    at: Annotated[float | None, TIME] = Field(None, ge=0)
    """Time [s]; left out: the end."""

    @model_validator(mode="before")
    @classmethod
    def _refuse_unquoted_dots(cls, data: Any) -> Any:
        for key, value in data.items() if isinstance(data, dict) else ():
            if isinstance(value, dict):
                remedy = f'A name with a dot needs quotes, as in "mean_displacement.{key}".'
                raise InputError(f"{key} = {value}", "unknown key", "", remedy)
        return data

    @model_validator(mode="after")
    def _one_tolerance(self):
        require_exactly_one(self, "relative", "absolute")
        if self.relative and self.value == 0:
            raise InputError(
                "relative is given", "must not be used with value = 0", "", "Use absolute."
            )
        return self

    @property
    def tolerance(self) -> float:
        """Allowed difference, in the unit of the value."""
        return self.absolute or (self.relative or 0.0) * abs(self.value)


class Interest(Table):
    """The quantities for which a scene is run, and by which studies compare runs.

    With values at the end alone the motion before it does not matter.
    """

    quantities: tuple[str, ...] = ()
    """Quantities in their grammar, see above, as in ["max tip.z"]."""
    end: tuple[str, ...] = ()
    """Short for values at the end: "tip.z"; also displacement, the field."""
    path: tuple[str, ...] = ()
    """Short for "path of NAME": columns whose course over the run matters."""
    period: tuple[str, ...] = ()
    """Short for "period of NAME": columns whose period of swing matters."""

    @model_validator(mode="after")
    def _refuse_empty(self):
        if not (self.quantities or self.end or self.path or self.period):
            allowed = "must name a quantity under quantities, end, path or period"
            raise InputError("interest is empty", allowed)
        _ = self.parsed  # refuses texts outside the grammar
        return self

    @property
    def parsed(self) -> dict[str, tuple[Quantity, ...]]:
        """The quantities by the key that names them."""
        texts = {
            "quantities": self.quantities,
            "end": self.end,
            "path": [f"path of {name}" for name in self.path],
            "period": [f"period of {name}" for name in self.period],
        }
        return {key: tuple(map(parse_quantity, names)) for key, names in texts.items()}

    @property
    def at_end_only(self) -> bool:
        """Whether the motion before the end does not matter."""
        return all(one.how == "value" and one.at is None for one in self.all)

    @property
    def all(self) -> tuple[Quantity, ...]:
        """All quantities."""
        return tuple(one for group in self.parsed.values() for one in group)


def _as_tuple(value: Any) -> Any:
    if isinstance(value, dict):
        return (value,)
    if not (isinstance(value, tuple) and value):
        raise InputError("", "must be a table { value = ... }, or a list of such tables")
    return value


Expectations = Annotated[tuple[Expectation, ...], BeforeValidator(_as_tuple)]
