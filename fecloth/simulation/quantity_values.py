"""Values of quantities of interest in a run, and their differences between two runs."""

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import scipy

from fecloth.errors import InputError, amount
from fecloth.mesh.cloth import Cloth
from fecloth.simulation.quantity import Quantity

COMPONENTS = "xyz"
ROUND_OFF = 1e-9  # relative, of a change that a run ends with


@dataclass(frozen=True, eq=False)
class RunRecord:
    """What quantities are computed from: the columns of a run and the fields at its end.

    Attributes
    ----------
    times
        (s + 1,) times of the start and of the steps that have rows [s].
    columns
        Column → (s + 1,), as in energies.csv and observed.csv.
    cloth
        The cloth, which fields need.
    fields
        "displacement" [m] and "velocity" [m/s] at the end, (n, 3) each.
    probes
        Names of probes: the size of one is the length of its displacement.
    energies
        Names of the columns that are energies.
    frequencies
        Frequencies of the modes, the lowest first [Hz].
    values
        Values of functions of the result, by the text of the quantity.
    """

    times: np.ndarray
    columns: Mapping[str, np.ndarray]
    cloth: Cloth | None = None
    fields: Mapping[str, np.ndarray] = field(default_factory=dict)
    probes: tuple[str, ...] = ()
    energies: Collection[str] = ()
    frequencies: tuple[float, ...] = ()
    values: Mapping[str, float] = field(default_factory=dict)

    @cached_property
    def vectors(self) -> set[str]:
        """Names whose x, y and z are columns."""
        return {name[:-2] for name in self.columns if name.endswith(".x")}

    def moved(self, quantity: Quantity) -> np.ndarray:
        """Return the values over the run; of a probe its displacement."""
        column = self.column(quantity)
        if quantity.name.split(".")[0] in self.probes:
            return column - column[0]
        return column

    def column(self, quantity: Quantity) -> np.ndarray:
        """Return the values over the run, (s + 1, 1) of a number and (s + 1, 3) of a vector.

        A column that this run does not have is zero, as the energy of a term that was left out.
        """
        names = [quantity.column]
        if quantity.column in self.vectors:
            names = [f"{quantity.column}.{axis}" for axis in COMPONENTS]
        zero = np.zeros(len(self.times))
        return np.stack([self.columns.get(name, zero) for name in names], axis=1)


def value_of(quantity: Quantity, record: RunRecord) -> float:
    """Return the number of a quantity in SI units; of a vector, path or field its size.

    The size is as for `size_of`. Raises `InputError` for a mode that the cloth does not have, a
    time outside the run, and a signal without a period.
    """
    if quantity.how == "function":
        return float(record.values[quantity.text])
    if quantity.how == "mode":
        if quantity.mode > len(record.frequencies):
            what = f"{quantity}: this cloth has {amount(len(record.frequencies), 'mode')}"
            raise InputError(what, "needs a smaller number")
        return float(record.frequencies[quantity.mode - 1])
    if quantity.is_field or quantity.how == "path":
        return size_of(quantity, record)
    column = record.column(quantity)
    if column.shape[1] > 1:
        return size_of(quantity, record)
    values = column[:, 0]
    if quantity.how in ("max", "min"):
        return float(getattr(np, f"nan{quantity.how}")(values))
    if quantity.how in ("period", "frequency"):
        period = signal_period(record.times, values, quantity.name)
        if quantity.how == "period":
            return period
        return 1 / period
    return float(_at(quantity, record, column)[0])


def is_number(quantity: Quantity, record: RunRecord) -> bool:
    """Whether the quantity is a number, not a field, a path or a vector."""
    if quantity.is_field or quantity.how == "path":
        return False
    return quantity.how != "value" or record.column(quantity).shape[1] == 1


def size_of(quantity: Quantity, record: RunRecord) -> float:
    """Return the size with which a difference is compared; of probes that of the displacement.

    It is the magnitude of a number, the length of a vector, the norm of a field, and the root
    mean square of a path over the run.
    """
    if quantity.is_field:
        return _norm(quantity, record, record, 0.0)
    if quantity.name and quantity.how in ("value", "path"):
        column = record.moved(quantity)
        if quantity.how == "path":
            return _rms(record.times, column)
        return float(np.linalg.norm(_at(quantity, record, column)))
    return abs(value_of(quantity, record))


def difference_of(quantity: Quantity, a: RunRecord, b: RunRecord) -> float:
    """Return the size of b − a: |b − a| of numbers, the norm of vectors and fields.

    Of probes it is the difference of their displacements. Of paths it is the root mean square
    √(∫ |b − a|² dt / T) over the steps of the run with fewer steps. Each step counts with its
    end, because reactions have no value at the start.
    """
    if quantity.is_field:
        return _norm(quantity, a, b, 1.0)
    if quantity.how == "path":
        times, path_a, path_b = _common_paths(quantity, a, b)
        return _rms(times, path_b - path_a)
    if quantity.how == "value":
        value_a = _at(quantity, a, a.moved(quantity))
        value_b = _at(quantity, b, b.moved(quantity))
        return float(np.linalg.norm(value_b - value_a))
    return abs(value_of(quantity, b) - value_of(quantity, a))


def _common_paths(
    quantity: Quantity, a: RunRecord, b: RunRecord
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the times of the run with fewer steps, and both paths at these."""
    times = min(a.times, b.times, key=len)
    return times, _path_at(times, quantity, a), _path_at(times, quantity, b)


def _path_at(times: np.ndarray, quantity: Quantity, record: RunRecord) -> np.ndarray:
    """Return the path of a run at other times, linear between its steps."""
    columns = record.moved(quantity).T
    return np.column_stack([np.interp(times, record.times, column) for column in columns])


def relative_difference(quantity: Quantity, a: RunRecord, b: RunRecord) -> float:
    """Return the difference over the size in `a`; 0 for 0/0, infinity for any other x/0."""
    apart = difference_of(quantity, a, b)
    size = size_of(quantity, a)
    if quantity.how == "path":
        times, path, _ = _common_paths(quantity, a, b)
        size = _rms(times, path)
    if size:
        return apart / size
    if apart:
        return math.inf
    return 0.0


def _at(quantity: Quantity, record: RunRecord, column: np.ndarray) -> np.ndarray:
    """Return the values at the quantity's time or place, linear between steps.

    Of a quantity that is gained it is the difference of two places.
    """
    if quantity.at is None:
        return column[-1]
    if not quantity.place:
        return _at_time(quantity, quantity.at, record, column)
    values = _at_place(quantity, quantity.at, record, column)
    if quantity.begin is not None:
        values = values - _at_place(quantity, quantity.begin, record, column)
    return values


def _at_time(quantity: Quantity, t: float, record: RunRecord, column: np.ndarray) -> np.ndarray:
    """Return the values at a time; raise `InputError` if it lies outside of the run."""
    first, last = record.times[0], record.times[-1]
    if not first <= t <= last:
        allowed = f"must lie in the run, {first:g} to {last:g} s"
        raise InputError(f"{quantity}: t = {t:g} s", allowed)
    return np.array([np.interp(t, record.times, values) for values in column.T])


def _at_place(
    quantity: Quantity, place: float, record: RunRecord, column: np.ndarray
) -> np.ndarray:
    """Return the values where the column of `quantity.place` has changed by `place` − slack.

    A specimen that is still slack has the values of the start. Reactions, which have none there,
    go on straight from their first two.
    """
    assert quantity.at is not None
    change = place - quantity.slack
    is_taut = change * quantity.at > 0
    t = _time_of(quantity, change, record) if is_taut else float(record.times[0])
    known = np.flatnonzero(np.isfinite(column).all(axis=1))
    if len(known) > 1 and t < record.times[known[0]]:
        i, j = known[:2]
        slope = (column[j] - column[i]) / (record.times[j] - record.times[i])
        return np.asarray(column[i] + slope * (t - record.times[i]))
    return _at_time(quantity, t, record, column)


def _time_of(quantity: Quantity, place: float, record: RunRecord) -> float:
    """Return the first time at which the column of `quantity.place` has changed by `place`.

    The column is linear between steps. Raises `InputError` if it never changes so much.
    """
    change = record.columns[quantity.place] - record.columns[quantity.place][0]
    beyond = (change - place) * np.sign(place)
    reached = np.flatnonzero(beyond >= -ROUND_OFF * abs(place))
    if not len(reached):
        farthest = change[np.argmax(change * np.sign(place))]
        allowed = f"is not reached: {quantity.place} changes by at most {farthest:.6g}"
        raise InputError(f"{quantity}", allowed, "", "Move it farther.")
    i = max(int(reached[0]), 1)
    part = (place - change[i - 1]) / (change[i] - change[i - 1] or 1.0)
    return float(record.times[i - 1] + min(part, 1.0) * (record.times[i] - record.times[i - 1]))


def _rms(times: np.ndarray, values: np.ndarray) -> float:
    """Return √(∫ |values|² dt / T) of values (s + 1, k); each step counts with its end."""
    steps = np.diff(times)
    return float(np.sqrt(steps @ np.sum(values[1:] ** 2, axis=1) / steps.sum()))


def _norm(quantity: Quantity, a: RunRecord, b: RunRecord, minus: float) -> float:
    """Return the norm of b − minus · a over the cloth."""
    if a.cloth is None or b.cloth is None:
        raise InputError(f"{quantity}", "needs the cloth and the field of a whole run")
    field_a = minus * a.fields[quantity.name]
    field_b = b.fields[quantity.name]
    norm = getattr(a.cloth, f"{quantity.norm}_difference")
    return float(norm(b.cloth, field_a, field_b))


LEAST_SAMPLES = 4  # of a swing: a cubic through fewer points does not turn twice


def signal_period(times: np.ndarray, values: np.ndarray, name: str = "the signal") -> float:
    """Return the period of a signal that swings about a constant level [unit of times].

    The times at which a cubic spline through the samples passes the level are
    t_k = t_0 + k T/2 + (−1)^k c; T is fitted by least squares. c, which is the shift by a wrong
    level, needs three passages; with only two, T is twice the time between them. The level is
    midway between the extremes or, with three passages, the mean over whole periods.

    Raises `InputError` for fewer than four samples, and for a signal that passes its level less
    than twice.
    """
    where = f"period of {name}"
    if len(times) < LEAST_SAMPLES:
        allowed = f"must be at least {LEAST_SAMPLES}"
        raise InputError(amount(len(times), "sample"), allowed, where)
    spline = scipy.interpolate.CubicSpline(times, values)
    turns = spline.derivative().roots(extrapolate=False)
    extremes = spline(np.append(turns[np.isfinite(turns)], [times[0], times[-1]]))
    passed = _passages(spline, (extremes.min() + extremes.max()) / 2)
    if len(passed) > 2:  # over whole periods the mean is the level of the swing
        whole_periods = passed[: len(passed) - (len(passed) + 1) % 2]
        first = whole_periods[0]
        last = whole_periods[-1]
        passed = _passages(spline, spline.integrate(first, last) / (last - first))
    if len(passed) < 2:
        remedy = "Take a greater t_end."
        raise InputError("the run", "passes its middle less than twice", where, remedy)
    k = np.arange(len(passed))
    columns = [np.ones(len(k)), 0.5 * k]  # of t_0, T and c
    if len(k) > 2:
        columns.append((-1.0) ** k)
    fitted = np.linalg.lstsq(np.column_stack(columns), passed, rcond=None)[0]
    return float(fitted[1])


def _passages(spline, level: float) -> np.ndarray:
    """Return the times inside the samples at which the spline passes a level."""
    times = spline.solve(level, extrapolate=False)
    return np.sort(times[np.isfinite(times)])
