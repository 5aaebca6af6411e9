"""The tables [[probes]], [expect] and [interest] of a scene file: results of a run."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BeforeValidator, Field, model_validator

from fecloth.errors import InputError
from fecloth.quantities.units import LENGTH, TIME
from fecloth.scene.field_types import Name
from fecloth.scene.table_model import Table, require_exactly_one
from fecloth.simulation.probes import Probe

_TAKEN = ("mean_displacement", "reaction")  # names of columns of every run


class ProbeTable(Table):
    """A named path: the mean of a node set, or a material point (X, Y) [m]."""

    name: Name
    where: str | None = None
    point: Annotated[tuple[float, float] | None, LENGTH] = None

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
    relative: float | None = Field(None, gt=0)
    absolute: float | None = Field(None, gt=0)
    at: Annotated[float | None, TIME] = Field(None, ge=0)

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
    """The quantities for which a scene is run; `studies/simplify/` compares simpler scenes by them.

    Names of probes and of columns, such as ``"tip"`` and ``"sag"``: their values at the `end`
    (there also ``"displacement"``, the field), their `path` over the run, and the `period` of
    their swing. With `end` alone the motion before it does not matter.
    """

    end: tuple[str, ...] = ()
    path: tuple[str, ...] = ()
    period: tuple[str, ...] = ()

    @model_validator(mode="after")
    def _refuse_empty(self):
        if not (self.end or self.path or self.period):
            raise InputError("interest is empty", "must name a quantity under end, path or period")
        return self


def _as_tuple(value: Any) -> Any:
    if isinstance(value, dict):
        return (value,)
    if not (isinstance(value, tuple) and value):
        raise InputError("", "must be a table { value = ... }, or a list of such tables")
    return value


Expectations = Annotated[tuple[Expectation, ...], BeforeValidator(_as_tuple)]
