"""Measured seconds."""

import time

import pytest

from fecloth import study


def test_the_fastest_call_after_the_first_counts():
    waits = iter((0.2, 0.05, 0.01, 0.05))
    seconds = study.measure_seconds(lambda: time.sleep(next(waits)) or 7, repeats=3)
    assert 0.01 <= seconds.wall < 0.05
    assert seconds.cpu < seconds.wall
    assert seconds.first >= 0.2
    assert seconds.compiling == pytest.approx(seconds.first - seconds.wall)
    assert seconds.value == 7
