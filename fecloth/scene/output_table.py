"""The table [output] of a scene file: when a frame and a restart file are written."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from fecloth.output.vtkhdf_writer import h5py
from fecloth.quantities.units import TIME
from fecloth.scene.equilibrium_table import EquilibriumTable
from fecloth.scene.table_model import Table, require_exactly_one
from fecloth.scene.time_table import Time
from fecloth.simulation.record_steps import ROWS


class Output(Table):
    """Frames: their approximate number, or the seconds or steps between two of them.

    `restart_steps` or `restart_every` ask for restart files: at the start, every that many steps
    or seconds of the motion, and at the end. An explicit run of more steps than `rows` has about
    that many rows in its tables, evenly spread, and those that the error in time needs, where no
    term and no pin needs Python.
    """

    frames: int | None = Field(default=None, ge=1)
    every: Annotated[float | None, TIME] = Field(default=None, gt=0)
    every_steps: int | None = Field(default=None, ge=1)
    format: Literal["vtu", "vtkhdf"] = Field(
        default="vtu", description="a file a frame, or one for all"
    )
    restart_steps: int | None = Field(default=None, ge=1)
    restart_every: Annotated[float | None, TIME] = Field(default=None, gt=0)
    rows: int = Field(default=ROWS, ge=1)
    intersections: bool = True
    error_density: bool = False

    @model_validator(mode="before")
    @classmethod
    def _default(cls, data: Any) -> Any:
        complete = not isinstance(data, dict) or data.keys() & {"frames", "every", "every_steps"}
        return data if complete else {"frames": 50} | data

    @model_validator(mode="after")
    def _one_spacing(self):
        require_exactly_one(self, "frames", "every", "every_steps")
        if self.restart_steps and self.restart_every:
            require_exactly_one(self, "restart_steps", "restart_every")
        if self.format == "vtkhdf":
            h5py()
        return self

    def steps(self, time: Time | EquilibriumTable) -> int | None:
        """Return the steps between two frames, rounded; None for frames at the `stops`."""
        if self.every_steps or time.dt == "auto":
            return self.every_steps
        return max(1, round(self._seconds(time) / time.dt))

    def stops(self, time: Time | EquilibriumTable) -> tuple[float, ...]:
        """Return the times of frames at which a step must end, if the method chooses dt."""
        if self.every_steps or time.dt != "auto":
            return ()
        seconds = self._seconds(time)
        count = math.ceil((time.t_end - time.t_start) / seconds - 1e-9)
        return tuple(time.t_start + seconds * i for i in range(1, count))

    def _seconds(self, time: Time | EquilibriumTable) -> float:
        return self.every or (time.t_end - time.t_start) / (self.frames or 1)
