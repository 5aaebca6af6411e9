"""A cylinder of rest radius R stays at rest; opened flat it stores B/(2R²) per area (ν_b = 0).

Both ends are clamped at the start of the run, on the cylinder, and the right clamp turns with the
opening strip. So the curvature is held to the ends; free ends would take moment from one row of
triangles, an error of order h.
"""

import numpy as np
import pytest
from support.locking import strip
from support.plates import rolled
from support.tiers import stories_except

import fecloth as fc

STRIPS = ["right", "cross", "equilateral", "unstructured"]
RADIUS = 0.4  # of a strip of length 1: it turns by 143°
FABRIC = fc.Fabric(1.0, 1e3, bending_rigidity=(2.0, 5.0))


def opened(cloth, rest):
    """The system and its start on the cylinder, t = 0; its right clamp is flat at t = 1."""
    x, v = rolled(cloth.X, RADIUS), np.zeros((len(cloth.X), 3))
    start, turn = fc.State(0.0, x, v), 1.0 / RADIUS
    pins = [fc.Pin("left", clamp=True)]
    pins += [fc.Pin("right", clamp=True, rotate=fc.Rotation(centre(turn), (0, 1, 0), f"{turn}*t"))]
    angles = "start" if rest == "start" else fc.hinge_angles(cloth, x)
    return fc.System(cloth, FABRIC, [fc.PlateBending(rest=angles)], pins, start=start), start


def centre(turn):
    """The point about which the end of the cylinder turns into that of the flat strip.

    About Y by the angle a (z to x) the vector d goes to d' = (c d_x + s d_z, c d_z − s d_x), and
    p = (I − R)⁻¹ (x' − R x) stays.
    """
    end = np.array([np.sin(turn), 1 - np.cos(turn)]) / turn
    c, s = np.cos(turn), np.sin(turn)
    R = np.array([[c, s], [-s, c]])
    px, pz = np.linalg.solve(np.eye(2) - R, np.array([1.0, 0.0]) - R @ end)
    return px, 0.0, pz


def flat_energy(cloth, rest="start"):
    """Energy of the opened strip over B/(2R²) times its area."""
    system, start = opened(cloth, rest)
    assert system.energies(start)["PlateBending"] < 1e-20
    flat = fc.State(1.0, np.column_stack([cloth.X, 0 * cloth.X[:, 0]]), start.v)
    right = cloth.nodes("right")
    target, _ = system.constraints.target(0.0, 1.0, start.x)
    assert target[right] == pytest.approx(flat.x[right], abs=1e-12)
    exact = 2.0 / (2 * RADIUS**2) * cloth.area
    return system.energies(flat)["PlateBending"] / exact


@pytest.mark.parametrize("element", ["P1", "P2"])
@pytest.mark.parametrize("pattern", stories_except(STRIPS, "unstructured"))
def test_curved_rest_shape_stores_B_over_2_R2_when_opened_flat(pattern, element):
    errors = [abs(flat_energy(strip(pattern, n, element)) - 1) for n in (20, 40, 80)]
    assert errors[0] < 1e-3
    if pattern == "right":  # the same angle at every edge: exact
        assert max(errors) < 1e-12
        return
    assert np.log2(errors[0] / errors[2]) / 2 == pytest.approx(2.0, abs=0.15)


def test_rest_angles_are_those_of_the_start():
    """Angles given one by one store what `rest = "start"` stores."""
    cloth = strip("unstructured", 20, "P1")
    given, start = (flat_energy(cloth, rest) for rest in ("angles", "start"))
    assert given == pytest.approx(start, rel=1e-12)
