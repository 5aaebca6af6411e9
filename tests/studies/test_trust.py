"""The catalogue of trust: its set-ups, the errors and the verdicts."""

import numpy as np
import pytest

from studies.evidence.trust.__main__ import verdict
from studies.evidence.trust.cases import error_in_time, frame_times, judge
from studies.evidence.trust.setups import FRAMES, METHODS, MOTIONS, SETUPS, Setup, build


def test_the_catalogue_covers_motions_methods_and_frames():
    assert len(set(SETUPS)) == len(SETUPS) >= 60
    assert {one.motion for one in SETUPS} == set(MOTIONS)
    assert {one.method for one in SETUPS} == set(METHODS)
    assert {one.frame for one in SETUPS} == set(FRAMES)


@pytest.mark.parametrize("frame", ["20 m/s", "falling", "spinning"])
def test_a_frame_adds_a_rigid_motion_alone(frame):
    rest = build(Setup("breathing", "midpoint", 1e-3))
    seen = build(Setup("breathing", "midpoint", 1e-3, frame), refine=4)
    assert seen.dt == 0.25e-3
    assert np.array_equal(seen.state.x, rest.state.x)
    assert ("Gravity" in seen.system.names) == (frame == "falling")
    v, r = seen.state.v - rest.state.v, rest.state.x - rest.state.x.mean(axis=0)
    turning = np.column_stack([-r[:, 1], r[:, 0], 0 * r[:, 0]])
    assert np.allclose(v, FRAMES[frame].velocity + FRAMES[frame].spin * turning)


def test_refined_reruns_and_the_error_between_them():
    """The drum at 20 ms is far off; a step of 1 ms is not, and both count."""
    coarse = judge("drum", "midpoint", 0.02, "rest", 400)
    assert coarse["counts"]
    assert coarse["error"] > 0.5
    assert verdict(coarse | {"status": "ok"}).startswith("wrong")
    run = build(Setup("drum", "midpoint", 0.02))
    assert len(frame_times(run)) == 15
    x = run.state.x
    moved = x + [0.0, 0.0, 1.0] * np.outer(np.sin(3 * x[:, 0]), np.ones(3))
    assert error_in_time(run, np.array([moved]), np.array([moved])) == 0.0
    half = np.array([0.5 * (x + moved)])
    assert 0.499 < error_in_time(run, half, np.array([moved])) < 0.501
