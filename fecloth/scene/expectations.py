"""What a scene expects of the columns of its run: that they are there, and their values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fecloth.errors import SceneError
from fecloth.scene.tables import Expectation, Interest
from fecloth.suggest import did_you_mean

Expected = Mapping[str, tuple[Expectation, ...]]


def refuse_times(expect: Expected, start: float, end: float, source: str) -> None:
    """Raise `SceneError` where a value is expected at a time [s] that the run does not pass."""
    for name, expectations in expect.items():
        for at in (e.at for e in expectations if e.at is not None):
            if at > end:
                allowed = f"must be at most time.t_end = {end} [s]"
                raise SceneError(f"expect.{name}.at = {at}", allowed, source)
            if at < start:
                allowed = f"must be at least time.t_start = {start} [s]"
                raise SceneError(f"expect.{name}.at = {at}", allowed, source)


def refuse_unknown(
    expect: Expected, interest: Interest | None, names: list[str], source: str
) -> None:
    """Raise `SceneError` for a quantity that is none of the columns `names`.

    [interest] may name a probe with all its components too and, at the end, the displacement.
    """
    paths = [name[:-2] for name in names if name.endswith(".x")]
    known = {"expect": names, "end": [*names, *paths, "displacement"]}
    asked = [("expect", name) for name in expect]
    asked += [(key, name) for key, given in interest or () for name in given]
    for key, name in asked:
        among = known.get(key, [*names, *paths])
        if name not in among:
            what = f"expect.{name}" if key == "expect" else f"interest.{key}: {name}"
            allowed = f"unknown quantity; this run has {', '.join(among)}"
            raise SceneError(what, allowed, source, did_you_mean(name, among))


@dataclass(frozen=True)
class Verdict:
    """A line of ``fecloth check``: the value of a column against what the scene expects.

    Attributes
    ----------
    name, at
        Column, and time [s] (the end of the run if the scene names none).
    value, expected, tolerance
        In the column's unit; `tolerance` is the allowed difference.
    passed
        Whether ``|value − expected| <= tolerance``.
    """

    name: str
    at: float
    value: float
    expected: float
    tolerance: float
    passed: bool

    def __str__(self) -> str:
        return (
            f"{'ok' if self.passed else 'FAILED':<6} {self.name} at {self.at:g} s: "
            f"{self.value:.8g}, expected {self.expected:.8g} ± {self.tolerance:.2g}"
        )


def check(
    expect: Expected,
    times: np.ndarray,
    observed: Mapping[str, np.ndarray],
    energies: Mapping[str, np.ndarray],
) -> list[Verdict]:
    """Compare a run's columns with the scene's `expect`, by `Result`'s arrays of that name.

    Between two steps values are interpolated linearly; a time that the run did not reach, and a
    value that is not a number, do not pass.
    """
    columns = {**energies, **observed}
    return [
        _verdict(name, expectation, times, columns[name])
        for name, expectations in expect.items()
        for expectation in expectations
    ]


def _verdict(name: str, expected: Expectation, times: np.ndarray, column: np.ndarray) -> Verdict:
    at = float(times[-1]) if expected.at is None else expected.at
    value = float(np.interp(at, times, column, left=np.nan, right=np.nan))
    passed = abs(value - expected.value) <= expected.tolerance
    return Verdict(name, at, value, expected.value, expected.tolerance, passed)
