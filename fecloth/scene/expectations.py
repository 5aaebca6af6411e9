"""The expected values of a scene, compared with the columns of its run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fecloth.errors import InputError, SceneError
from fecloth.scene.probe_tables import Expectation, Interest
from fecloth.suggest import did_you_mean

Expected = Mapping[str, tuple[Expectation, ...]]


def refuse_times(expect: Expected, start: float, end: float, source: str, unit: str = " s") -> None:
    """Raise `SceneError` for a value expected at a t outside the run."""
    most = f"time.t_end = {end} [s]" if unit == " s" else f"{end:g}{unit}"
    for name, expectations in expect.items():
        for at in (e.at for e in expectations if e.at is not None):
            if at > end:
                allowed = f"must be at most {most}"
                raise SceneError(f"expect.{name}.at = {at}", allowed, source)
            if at < start:
                allowed = f"must be at least time.t_start = {start} [s]"
                raise SceneError(f"expect.{name}.at = {at}", allowed, source)


def refuse_unknown(
    expect: Expected, interest: Interest | None, names: list[str], source: str
) -> None:
    """Raise `SceneError` for a quantity that is not among the columns `names`."""
    for name in expect:
        if name not in names:
            allowed = f"unknown quantity; this run has {', '.join(names)}"
            raise SceneError(f"expect.{name}", allowed, source, did_you_mean(name, names))
    for key, quantities in interest.parsed.items() if interest else ():
        for quantity in quantities:
            try:
                quantity.require_known(names, f"interest.{key}")
            except InputError as error:
                raise SceneError(error.what, error.allowed, source, error.remedy) from None


@dataclass(frozen=True)
class Verdict:
    """A line of ``fecloth check``: the value of a column and the expected one."""

    # Column and time [s]; the end of the run if the scene gives no time.
    name: str
    at: float
    # In the column's unit; `tolerance` is the allowed difference.
    value: float
    expected: float
    tolerance: float
    passed: bool  # whether ``|value − expected| <= tolerance``
    unit: str = " s"  # of `at`: " s", or " of the loads" of a static scene

    def __str__(self) -> str:
        return (
            f"{'ok' if self.passed else 'FAILED':<6} {self.name} at {self.at:g}{self.unit}: "
            f"{self.value:.8g}, expected {self.expected:.8g} ± {self.tolerance:.2g}"
        )


def check(
    expect: Expected,
    times: np.ndarray,
    observed: Mapping[str, np.ndarray],
    energies: Mapping[str, np.ndarray],
    unit: str = " s",
) -> list[Verdict]:
    """Compare the columns of a run, as in `Result`, with the expected values.

    Values are interpolated linearly between steps. A time outside the run and a value that is not
    a number fail.
    """
    columns = {**energies, **observed}
    return [
        _verdict(name, expectation, times, columns[name], unit)
        for name, expectations in expect.items()
        for expectation in expectations
    ]


def _verdict(
    name: str, expected: Expectation, times: np.ndarray, column: np.ndarray, unit: str
) -> Verdict:
    at = float(times[-1]) if expected.at is None else expected.at
    value = float(np.interp(at, times, column, left=np.nan, right=np.nan))
    passed = abs(value - expected.value) <= expected.tolerance
    return Verdict(name, at, value, expected.value, expected.tolerance, passed, unit)
