"""Measured seconds, on a clock that the function itself drives."""

import time

import pytest

from studies import harness


def test_the_fastest_call_after_the_first_counts(monkeypatch):
    clock, waits = [0.0], iter((0.2, 0.05, 0.01, 0.05))

    def work():
        clock[0] += next(waits)
        return 7

    monkeypatch.setattr(time, "perf_counter", lambda: clock[0])
    monkeypatch.setattr(time, "process_time", lambda: clock[0] / 2)
    seconds = harness.measure_seconds(work, repeats=3)
    assert (seconds.wall, seconds.cpu) == pytest.approx((0.01, 0.005))
    assert seconds.value == 7
