"""The tables [time], [equilibrium] and [output] of a scene: its steps, and what it writes."""

import math
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import Field, model_validator

from fecloth.errors import InputError
from fecloth.integrators import EXPLICIT, METHODS
from fecloth.integrators.protocol import StepChoice
from fecloth.output.frame_reader import h5py
from fecloth.quantities.units import RATE, SPEED, TIME
from fecloth.scene.table_model import Table, one_of, require_exactly_one, table_of
from fecloth.simulation.error_control import Adaptive
from fecloth.simulation.fused_march import ROWS
from fecloth.simulation.load_steps import LoadSteps
from fecloth.simulation.method_choice import Auto
from fecloth.simulation.resolve import choose_steps
from fecloth.simulation.step_times import EARLIER, coarse_clock

MOST_STEPS = 10_000_000  # of a scene: more are taken for a mistake, such as dt in ms
CHOSEN = ("rtol", "atol", "longest")  # parameters of `Adaptive` and `Auto`
_METHODS = METHODS | EXPLICIT


class AutoMethod(Table):
    """``method = "auto"``: explicit or implicit, whichever is predicted to be faster."""

    type: Literal["auto"]


METHOD_TABLES: dict[str, type[Table]]
METHOD_TABLES = {name: table_of(cls, name) for name, cls in _METHODS.items()}
METHOD_TABLES["auto"] = AutoMethod
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
    error_in_time: Literal["sampled", "companion", "none"] = "sampled"
    """How the error in time is estimated: from samples of the run; by a second run with other
    steps beside it, which costs about as much again; or not."""

    unit: ClassVar[str] = " s"

    @model_validator(mode="before")
    @classmethod
    def _make_method_a_table(cls, data: Any) -> Any:
        """Return the table with its method as a table, in place of a name or of none.

        A missing method is "auto". Raise `InputError` if it is missing beside a fixed dt, which
        only a method that the user has chosen can take.
        """
        if not isinstance(data, dict):
            return data
        if "method" not in data:
            if data.get("dt", "auto") != "auto":
                remedy = "Or leave dt out, too: then both are chosen."
                allowed = f"must be one of {', '.join(_METHODS)}"
                raise InputError("method is missing", allowed, remedy=remedy)
            return data | {"method": {"type": "auto"}}
        if isinstance(data["method"], str):
            return data | {"method": {"type": data["method"]}}
        return data

    @model_validator(mode="after")
    def _check_steps(self):
        """Raise `InputError` for an end before the start, or for steps that cannot be taken.

        With dt = "auto" these are tolerances that `Adaptive` refuses. With a fixed dt these are
        keys of chosen steps, a dt too small for the clock of a run, and too many steps.
        """
        if not self.t_end > self.t_start:
            allowed = f"must be greater than {self.t_start:g} [s]"
            raise InputError(f"t_end = {self.t_end!r}", allowed)
        if self.dt == "auto":
            self.steps()  # raises `InputError` for wrong tolerances
            return self
        for key in CHOSEN:
            if getattr(self, key) is not None:
                raise InputError(f"{key} = {getattr(self, key)!r}", 'needs dt = "auto"')
        if self.method.type == "auto":
            raise InputError(f"dt = {self.dt!r}", 'must be "auto" with method = "auto"')
        if problem := coarse_clock(max(abs(self.t_start), abs(self.t_end)), self.dt):
            raise InputError(f"dt = {self.dt!r}", problem, remedy=EARLIER)
        steps = (self.t_end - self.t_start) / self.dt
        if steps > MOST_STEPS:
            what = f"dt = {self.dt!r} makes {steps:.2g} steps"
            allowed = f"must be at most {MOST_STEPS:.0e}"
            remedy = "A bare number is in seconds."
            raise InputError(what, allowed, remedy=remedy)
        return self

    def taking(self, steps: Adaptive) -> Self:
        """Return the table with the steps that `Auto` has chosen."""
        names = {cls: name for name, cls in _METHODS.items()}
        name = names[type(steps.method)]
        method = METHOD_TABLES[name].model_validate({"type": name})
        return self.model_copy(
            update={"method": method, **{key: getattr(steps, key) for key in CHOSEN}}
        )

    def steps(self) -> StepChoice | Auto:
        """Return the method with the choice of its steps, as `march` takes it."""
        values = {key: getattr(self, key) for key in CHOSEN}
        tolerances = {key: value for key, value in values.items() if value is not None}
        if self.method.type == "auto":
            return Auto(**tolerances)
        dt = None if self.dt == "auto" else self.dt
        return choose_steps(self.method.make(), dt, tolerances)


class EquilibriumTable(Table):
    """The equilibrium under the loads, which grow to their value in `load_steps` equal steps.

    Frames, tables and restart files are as for a run in time, with the part of the loads, from
    0 to 1, as t; pins and obstacles that move are where their motion has them at that t. The
    last row and frame are the equilibrium; the first is the start. Whether it is stable is
    reported: the least eigenvalue of K on the free directions. The `unit` follows a value of t
    in words.
    """

    tolerance: Annotated[float, Field(ge=1e-13, lt=1)] | Literal["auto"] = "auto"
    """On the sum of all forces, relative to them. "auto": the error left in the positions
    is below 1e-6 of the largest displacement, or as small as round-off allows."""
    load_steps: int = Field(1, ge=1)
    """Equal steps in which the loads grow to their value; at least 20 with `BendingFriction`."""
    friction: Literal["laid", "shaken"] = "laid"
    """Of `BendingFriction`. "laid": as the loads grow; "shaken": then its moments sink
    to zero in ten more steps, and the elastic equilibrium is left."""
    max_iterations: int = Field(500, ge=1)
    """Newton iterations of a load step after which it has failed."""

    unit: ClassVar[str] = " of the loads"
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
        return LoadSteps(self.load_steps, self.tolerance, self.max_iterations, self.friction)


class Output(Table):
    """Which frames, restart files and rows a run writes.

    With `restart_steps` or `restart_every` there are restart files at the start and the end,
    too. Where a term or a pin needs Python, each step of an explicit run has a row.
    """

    frames: int | None = Field(default=None, ge=1)
    """Number of frames, about; 50 where no spacing is given."""
    every: Annotated[float | None, TIME] = Field(default=None, gt=0)
    """In place of `frames`: time between two frames [s]."""
    every_steps: int | None = Field(default=None, ge=1)
    """In place of `frames`: steps between two frames."""
    format: Literal["vtu", "vtkhdf"] = "vtu"
    """A file for each frame (vtu); or one for all (vtkhdf), into which a run gathers them at its
    end."""
    restart_steps: int | None = Field(default=None, ge=1)
    """Steps between two restart files."""
    restart_every: Annotated[float | None, TIME] = Field(default=None, gt=0)
    """In place of `restart_steps`: time of the motion between two restart files [s]."""
    rows: int = Field(default=ROWS, ge=1)
    """Rows of the tables of a long explicit run, evenly spread; more where the error
    in time needs them."""
    intersections: bool = True
    """Whether the pairs of triangles that intersect are counted at frames."""
    error_density: bool = False
    """Whether frames have the error in space of each triangle."""

    @model_validator(mode="before")
    @classmethod
    def _default(cls, data: Any) -> Any:
        if not isinstance(data, dict) or data.keys() & {"frames", "every", "every_steps"}:
            return data
        return {"frames": 50} | data

    @model_validator(mode="after")
    def _check_spacings(self):
        """Raise `InputError` for two spacings of frames or of restart files, or without h5py."""
        require_exactly_one(self, "frames", "every", "every_steps")
        if self.restart_steps and self.restart_every:
            require_exactly_one(self, "restart_steps", "restart_every")
        if self.format == "vtkhdf":
            h5py()
        return self

    @property
    def restarts(self) -> int | float | None:
        """Steps (an int) or seconds between two restart files; None for no files."""
        return self.restart_steps or self.restart_every

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
        """Return the time between two frames [s]."""
        return self.every or (time.t_end - time.t_start) / (self.frames or 1)
