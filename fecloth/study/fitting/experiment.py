"""An experiment: a specimen, what was measured of it, and how both are compared."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

from fecloth.errors import InputError, brief
from fecloth.quantities.arguments import checks_arguments
from fecloth.quantities.units import LENGTH, TIME
from fecloth.simulation.probes import Probe
from fecloth.simulation.quantity import Quantity, parse_quantity

T = "t"  # time, or the part of the loads

Sigma = str | float | None


@checks_arguments
@dataclass(frozen=True, eq=False)
class Experiment:
    """A measured curve, or measured numbers, and the problem that computes them.

    Parameters
    ----------
    problem
        The specimen with its grips: a scene, its path, or a function as for `fecloth.study.of`.
    data
        Path of a CSV file whose first line has the names of the columns with their units, as
        ``extension [mm],force [N]``; lines that begin with # are comments. Or a mapping of such
        names to values.
    quantity
        Measured columns, and the quantities of the run that they measure:
        ``{"force": "reaction.grip.x"}``.
    along
        What orders the points of a curve: ``{"extension": "grip.x"}``, a column and the
        quantity of the run that it measures, both from their starts; or "t", the column of the
        time [s] or of the part of the loads. Without it the columns have values of quantities
        such as "max tip.z". The start of a column is 0; a column whose values all lie beyond
        what the run reaches, as the distance of two clamps, starts at its first value.
    sigma
        Standard uncertainty of a measured value: "2 %" of the largest value, "0.1 N", a number
        in SI, the name of a column, or "repeats": from the scatter of the runs that the column
        ``repeat`` numbers. A mapping gives each measured column its own. Without it 2 % is
        assumed.
    offset
        Whether the value of `along` at which the specimen is no longer slack is fitted, too.
    fitted
        Whether the fit uses the experiment; else it is compared with the fit.
    name
        A name for tables; by default the name of the data file.
    h, dt, t_end, probes
        Of a function's problem, as for `fecloth.study.of`.

    Raises
    ------
    InputError
        For arguments that do not fit; `fit` says what does not fit in the data and the problem.
    """

    problem: Any
    data: str | Path | Mapping[str, Sequence[float]]
    quantity: Mapping[str, str | Quantity | Callable[..., float]]
    along: Mapping[str, str] | str | None = None
    sigma: Sigma | Mapping[str, Sigma] = None
    offset: bool = False
    fitted: bool = True
    name: str = ""
    h: Annotated[float | None, LENGTH] = None
    dt: Annotated[float | None, TIME] = None
    t_end: Annotated[float | None, TIME] = None
    probes: Sequence[Probe] = field(default=())

    def __post_init__(self) -> None:
        """Raise `InputError` for a wrong quantity, along, offset or fitted."""
        if not (isinstance(self.quantity, Mapping) and self.quantity):
            allowed = 'must be a mapping of columns, as {"force": "reaction.grip.x"}'
            raise InputError(f"quantity = {brief(self.quantity)}", allowed, "Experiment")
        along = self.along
        is_pair = isinstance(along, Mapping) and len(along) == 1
        if not (along in (None, T) or is_pair):
            allowed = 'must be "t", or a column and its quantity, as {"extension": "grip.x"}'
            raise InputError(f"along = {brief(along)}", allowed, "Experiment")
        for name in ("offset", "fitted"):
            if not isinstance(getattr(self, name), bool):
                what = f"{name} = {brief(getattr(self, name))}"
                raise InputError(what, "must be true or false", "Experiment")
        if self.offset and along is None:
            raise InputError("offset = true", "needs along, which it shifts", "Experiment")

    @property
    def label(self) -> str:
        """Its name, for tables and messages."""
        if self.name or isinstance(self.data, Mapping):
            return self.name or "data"
        return Path(self.data).name

    @property
    def order(self) -> tuple[str, Quantity | None] | None:
        """The measured column that orders the points, and its quantity.

        The quantity is None if the column has the time, or the part of the loads. Without
        `along` there is no such column, and the whole is None.
        """
        if self.along is None:
            return None
        if isinstance(self.along, str):
            return T, None
        ((column, text),) = self.along.items()
        if text == T:
            return column, None
        return column, parse_quantity(text)

    @property
    def columns(self) -> dict[str, Quantity]:
        """The measured columns, and their quantities."""
        return {column: parse_quantity(text) for column, text in self.quantity.items()}

    def sigma_of(self, column: str) -> Sigma:
        """The standard uncertainty that is given for a column, as `sigma` says it."""
        if isinstance(self.sigma, Mapping):
            return self.sigma.get(column)
        return self.sigma
