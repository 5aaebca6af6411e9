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
    """Which frames, restart files and rows a run writes.

    With `restart_steps` or `restart_every` there are restart files at the start and the end, too.
    Where a term or a pin needs Python, each step of an explicit run has a row.
    """

    frames: int | None = Field(default=None, ge=1)
    """Number of frames, about; 50 where no spacing is given."""
    every: Annotated[float | None, TIME] = Field(default=None, gt=0)
    """In place of `frames`: time between two frames [s]."""
    every_steps: int | None = Field(default=None, ge=1)
    """In place of `frames`: steps between two frames."""
    format: Literal["vtu", "vtkhdf"] = "vtu"
    """A file for each frame (vtu), or one for all (vtkhdf)."""
    restart_steps: int | None = Field(default=None, ge=1)
    """Steps between two restart files."""
    restart_every: Annotated[float | None, TIME] = Field(default=None, gt=0)
    """In place of `restart_steps`: time of the motion between two restart files [s]."""
    rows: int = Field(default=ROWS, ge=1)
    """Rows of the tables of a long explicit run, evenly spread; more where the error in time needs
    them."""
    intersections: bool = True
    """Whether the pairs of triangles that intersect are counted at frames."""
    error_density: bool = False
    """Whether frames have the error in space of each triangle."""

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
