"""Where pins carry a cloth: rigid motions, stretches, and what they do not tell."""

import numpy as np
import pytest
from conftest import flat

import fecloth as fc
from fecloth.system.carried import carry

CLOTH = fc.Cloth.rectangle(0.3, 0.1, h=0.05)
FABRIC = fc.Fabric(0.2, 1000.0, 0.3, bending_rigidity=1e-5)
TERMS = [fc.StVK(), fc.PlateBending(), fc.Gravity()]
TURN = fc.Rotation((0.1, 0.0, 0.2), (0.2, 1.0, 0.3), "2.5*t")


def moved(left, right, height=0.0):
    system = fc.System(CLOTH, FABRIC, TERMS, [left, right])
    x = flat(CLOTH) + [0, 0, height] * np.sin(10 * CLOTH.X[:, :1])
    target, _ = system.constraints.target(0.0, 1.0, x)
    return x, carry(system, x, target)


def test_pins_that_turn_and_move_alike_take_the_cloth_along():
    ways = [fc.Pin(side, motion=("0.4*t", 0, "t"), rotate=TURN) for side in ("left", "right")]
    x, end = moved(*ways, height=0.1)
    arm = (x - TURN.point) @ TURN.matrix(1.0, since=0.0).T
    np.testing.assert_allclose(end, TURN.point + arm + [0.4, 0, 1], atol=1e-9)


def test_pins_that_are_drawn_apart_stretch_the_cloth_alike():
    x, end = moved(fc.Pin("left"), fc.Pin("right", motion=("0.06*t", 0, 0)))
    np.testing.assert_allclose(end, x + np.outer(x[:, 0] / 0.3, [0.06, 0, 0]), atol=1e-12)


def test_slides_count_across_their_directions_only():
    """What slides up and down is drawn along x."""
    grip = fc.Slide("right", normal=(1, 0, 0), motion=("0.06*t", 0, "9*t"))
    x, end = moved(fc.Pin("left"), grip)
    np.testing.assert_allclose(end[:, 0], 1.2 * x[:, 0], atol=1e-12)
    assert abs(end[:, 2] - x[:, 2]).max() < 0.05


def test_a_short_edge_that_turns_does_not_swing_the_cloth():
    """Two nodes, 0.05 m apart, turn against each other; the far end stays where it is."""
    corner = np.flatnonzero((CLOTH.X[:, 0] < 1e-9) & (CLOTH.X[:, 1] < 0.06))
    turn = fc.Rotation((0, 0.025, 0), (0, 0, 1), "t")
    system = fc.System(CLOTH, FABRIC, TERMS, [fc.Pin(corner, rotate=turn)])
    x = flat(CLOTH)
    target, _ = system.constraints.target(0.0, 1.0, x)
    end = carry(system, x, target)
    others = np.setdiff1d(np.arange(len(x)), corner)
    np.testing.assert_allclose(end[others], x[others], atol=0.01)
    np.testing.assert_allclose(end[corner], target[corner], atol=0)


@pytest.mark.parametrize(
    "way", [("0.1*t", 0, 0), (0, 0, "0.1*t"), (0, 0, "5*t"), ("0.2*t", "0.3*t", "-0.1*t")]
)
def test_a_cloth_between_two_grips_that_move_alike_does_not_crumple(way):
    """Also farther than ten extents: it hangs as between grips at rest, and as soon."""
    hung = []
    for motion in ((0, 0, 0), way):
        pins = [fc.Pin(side, motion=motion) for side in ("left", "right")]
        system = fc.System(CLOTH, FABRIC, TERMS, pins)
        end = fc.equilibrium(system, system.rest(), load_steps=1)
        hung.append(end)
    carried = hung[0].x + hung[1].x[CLOTH.nodes("left")[0]] - [*CLOTH.X[CLOTH.nodes("left")[0]], 0]
    np.testing.assert_allclose(hung[1].x, carried, atol=1e-7)
    assert hung[1].iterations <= hung[0].iterations + 2
