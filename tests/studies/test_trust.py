"""The catalogue of trust: its set-ups."""

import numpy as np
import pytest

from studies.trust.setups import FRAMES, METHODS, MOTIONS, SETUPS, Setup, build


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
