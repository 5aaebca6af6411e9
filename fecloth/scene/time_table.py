"""The table [time] of a scene file: the method and its steps."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field, model_validator

from fecloth.errors import InputError
from fecloth.integrators import EXPLICIT, METHODS
from fecloth.integrators.protocol import StepChoice
from fecloth.quantities.units import RATE, SPEED, TIME
from fecloth.scene.table_model import Table, one_of, table_of
from fecloth.simulation.method_choice import Auto
from fecloth.simulation.resolve import choose_steps
from fecloth.simulation.step_times import EARLIER, coarse_clock

MOST_STEPS = 10_000_000
CHOSEN = ("rtol", "atol", "longest")  # parameters of `Adaptive` and `Auto`
_METHODS = METHODS | EXPLICIT


class AutoMethod(Table):
    """``method = "auto"``: explicit or implicit, whichever is predicted to be faster."""

    type: Literal["auto"]


METHOD_TABLES = {name: table_of(cls, name) for name, cls in _METHODS.items()} | {"auto": AutoMethod}
_MethodTable: Any = one_of("type", METHOD_TABLES)


class Time(Table):
    """The method and its steps.

    With ``dt = "auto"`` explicit methods take 0.9 of their largest stable step. With `rtol` or
    `atol`, and for implicit methods always, the error determines the steps; see `Adaptive`.
    """

    method: _MethodTable = None
    """The name of a method, or a table { type = name, … }. Without `method` and `dt`, "auto"."""
    dt: Annotated[Annotated[float, Field(gt=0)] | Literal["auto"], TIME] = "auto"
    """The step [s]; "auto": chosen, see `fecloth/integrators/README.md`."""
    t_end: Annotated[float, TIME]
    """The end [s]."""
    t_start: Annotated[float, TIME] = 0.0
    """The start [s]."""
    rtol: Annotated[float | None, RATE] = Field(None, ge=0)
    """Error of the chosen steps, relative to the cloth's size [1/s]."""
    atol: Annotated[float | None, SPEED] = Field(None, ge=0)
    """Error of the chosen steps [m/s]."""
    longest: Annotated[float | None, TIME] = Field(None, gt=0)
    """The longest chosen step [s]; see `Adaptive`."""

    unit: ClassVar[str] = " s"

    @model_validator(mode="before")
    @classmethod
    def _method_by_name(cls, data: Any) -> Any:
        if isinstance(data, dict) and "method" not in data:
            if data.get("dt", "auto") != "auto":
                remedy = "Or leave dt out, too: then both are chosen."
                allowed = f"must be one of {', '.join(_METHODS)}"
                raise InputError("method is missing", allowed, "", remedy)
            return data | {"method": {"type": "auto"}}
        if isinstance(data, dict) and isinstance(data.get("method"), str):
            return data | {"method": {"type": data["method"]}}
        return data

    @model_validator(mode="after")
    def _finitely_many(self):
        if not self.t_end > self.t_start:
            allowed = f"must be greater than {self.t_start:g} [s]"
            raise InputError(f"t_end = {self.t_end!r}", allowed)
        if self.dt == "auto":
            self.steps()
            return self
        for key in CHOSEN:
            if getattr(self, key) is not None:
                raise InputError(f"{key} = {getattr(self, key)!r}", 'needs dt = "auto"')
        if self.method.type == "auto":
            raise InputError(f"dt = {self.dt!r}", 'must be "auto" with method = "auto"')
        if problem := coarse_clock(max(abs(self.t_start), abs(self.t_end)), self.dt):
            raise InputError(f"dt = {self.dt!r}", problem, "", EARLIER)
        steps = (self.t_end - self.t_start) / self.dt
        if steps > MOST_STEPS:
            what = f"dt = {self.dt!r} makes {steps:.2g} steps"
            allowed, remedy = f"must be at most {MOST_STEPS:.0e}", "A bare number is in seconds."
            raise InputError(what, allowed, "", remedy)
        return self

    def steps(self) -> StepChoice | Auto:
        """Return the method with the choice of its steps, as `march` takes it."""
        tolerances = {k: getattr(self, k) for k in CHOSEN if getattr(self, k) is not None}
        if self.method.type == "auto":
            return Auto(**tolerances)
        dt = None if self.dt == "auto" else self.dt
        return choose_steps(self.method.make(), dt, tolerances)
