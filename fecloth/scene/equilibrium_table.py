"""The table [equilibrium] of a scene file, in place of [time]: the scene is static."""

from __future__ import annotations

from typing import ClassVar

from pydantic import Field, model_validator

from fecloth.errors import InputError
from fecloth.scene.table_model import Table
from fecloth.scene.time_table import MOST_STEPS
from fecloth.simulation.load_steps import LoadSteps


class EquilibriumTable(Table):
    """The equilibrium under the loads, which grow to their value in `load_steps` equal steps.

    Frames, tables and restart files are as for a run in time, with the part of the loads, from 0
    to 1, as t. The last row and frame are the equilibrium; the first is the start. Whether it is
    stable is reported: the least eigenvalue of K on the free directions.
    """

    tolerance: float = Field(1e-9, ge=1e-13, lt=1)
    """On the sum of all forces, relative to them."""
    load_steps: int = Field(1, ge=1)
    """Equal steps in which the loads grow to their value."""
    max_iterations: int = Field(200, ge=1)
    """Newton iterations of a load step after which it has failed."""

    unit: ClassVar[str] = " of the loads"  # of t
    t_start: ClassVar[float] = 0.0
    t_end: ClassVar[float] = 1.0

    @model_validator(mode="after")
    def _not_too_many(self):
        if self.load_steps > MOST_STEPS:
            allowed = f"must be at most {MOST_STEPS:.0e}"
            raise InputError(f"load_steps = {self.load_steps}", allowed)
        return self

    @property
    def dt(self) -> float:
        """The part of the loads that a step adds."""
        return 1 / self.load_steps

    def steps(self) -> LoadSteps:
        """Return the search in load steps, as `march` takes it."""
        return LoadSteps(self.load_steps, self.tolerance, self.max_iterations)
