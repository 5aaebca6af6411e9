"""The tables [time] and [output] of a scene file: a method, its steps, and when a frame is due."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from fecloth.errors import InputError
from fecloth.integrators import EXPLICIT, METHODS
from fecloth.output.vtkhdf_writer import h5py
from fecloth.quantities.units import RATE, SPEED, TIME
from fecloth.scene.table_model import Table, exactly_one, one_of, table_of
from fecloth.simulation.error_control import Adaptive
from fecloth.simulation.method_choice import Auto
from fecloth.simulation.stability_limited import AtLimit

MOST_STEPS = 10_000_000
_METHODS = METHODS | EXPLICIT


class AutoMethod(Table):
    """``method = "auto"``: explicit or implicit, whichever is foretold to be faster."""

    type: Literal["auto"]


_MethodTable = one_of(
    "type", {name: table_of(cls, name) for name, cls in _METHODS.items()} | {"auto": AutoMethod}
)


class Time(Table):
    """The method and its step dt, from t_start to t_end [s].

    With ``dt = "auto"`` the steps are chosen: by their error where `rtol` [1/s] or `atol` [m/s]
    are given, as for `Adaptive`, and for implicit methods in any case; else, for explicit ones,
    0.9 of the largest stable one.
    """

    method: _MethodTable = Field(description=", ".join([*_METHODS, "auto"]))
    dt: Annotated[Annotated[float, Field(gt=0)] | Literal["auto"], TIME] = "auto"
    t_end: Annotated[float, TIME]
    t_start: Annotated[float, TIME] = 0.0
    rtol: Annotated[float | None, RATE] = Field(None, ge=0)
    atol: Annotated[float | None, SPEED] = Field(None, ge=0)

    @model_validator(mode="before")
    @classmethod
    def _method_by_name(cls, data: Any) -> Any:
        if isinstance(data, dict) and "method" not in data:
            raise InputError("method is missing", f"must be one of {', '.join(_METHODS)}, auto")
        if isinstance(data, dict) and isinstance(data.get("method"), str):
            return data | {"method": {"type": data["method"]}}
        return data

    @model_validator(mode="after")
    def _finitely_many(self):
        if not self.t_end > self.t_start:
            allowed = f"must be greater than {self.t_start:g} [s]"
            raise InputError(f"t_end = {self.t_end!r}", allowed)
        if self.dt == "auto":
            self.stepping()
            return self
        for key in ("rtol", "atol"):
            if getattr(self, key) is not None:
                raise InputError(f"{key} = {getattr(self, key)!r}", 'needs dt = "auto"')
        if self.method.type == "auto":
            raise InputError(f"dt = {self.dt!r}", 'must be "auto" with method = "auto"')
        steps = (self.t_end - self.t_start) / self.dt
        if steps > MOST_STEPS:
            what = f"dt = {self.dt!r} makes {steps:.2g} steps"
            allowed, remedy = f"must be at most {MOST_STEPS:.0e}", "A bare number is in seconds."
            raise InputError(what, allowed, "", remedy)
        return self

    def stepping(self) -> tuple[object, float | None]:
        """The method and dt, as `march` takes them."""
        given = {k: getattr(self, k) for k in ("rtol", "atol") if getattr(self, k) is not None}
        if self.method.type == "auto":
            return Auto(**given), None
        method = self.method.make()
        if self.dt != "auto":
            return method, self.dt
        if method.traits.explicit and not given:
            return AtLimit(method), None
        return Adaptive(method, **given), None


class Output(Table):
    """Frames: their number (about), or the seconds or steps between two of them.

    With `restart_steps` or `restart_every` a restart file at the start, after every so many steps
    or seconds of the motion, and at the end.
    """

    frames: int | None = Field(None, ge=1)
    every: Annotated[float | None, TIME] = Field(None, gt=0)
    every_steps: int | None = Field(None, ge=1)
    format: Literal["vtu", "vtkhdf"] = Field("vtu", description="a file a frame, or one for all")
    restart_steps: int | None = Field(None, ge=1)
    restart_every: Annotated[float | None, TIME] = Field(None, gt=0)

    @model_validator(mode="before")
    @classmethod
    def _default(cls, data: Any) -> Any:
        given = not isinstance(data, dict) or data.keys() & {"frames", "every", "every_steps"}
        return data if given else {"frames": 50} | data

    @model_validator(mode="after")
    def _one_spacing(self):
        exactly_one(self, "frames", "every", "every_steps")
        if self.restart_steps and self.restart_every:
            exactly_one(self, "restart_steps", "restart_every")
        if self.format == "vtkhdf":
            h5py()
        return self

    def steps(self, time: Time) -> int | None:
        """Steps between two frames, rounded to the nearest; None for frames at the `stops`."""
        if self.every_steps or time.dt == "auto":
            return self.every_steps
        return max(1, round(self._seconds(time) / time.dt))

    def stops(self, time: Time) -> tuple[float, ...]:
        """Times of the frames at which a step must end, where the steps are chosen."""
        if self.every_steps or time.dt != "auto":
            return ()
        seconds = self._seconds(time)
        count = math.ceil((time.t_end - time.t_start) / seconds - 1e-9)
        return tuple(time.t_start + seconds * i for i in range(1, count))

    def _seconds(self, time: Time) -> float:
        return self.every or (time.t_end - time.t_start) / (self.frames or 1)
