"""A cloth that is laid down starts at rest on what carries it."""

import math

import numpy as np
import pytest
from conftest import flat

import fecloth as fc

GAP, MU = 1e-3, 0.3
FABRIC = fc.Fabric(0.2, 1000.0, 0.3, bending_rigidity=1e-4)
CLOTH = fc.Cloth.rectangle(0.2, 0.1, h=0.05)
TERMS = [fc.StVK(), fc.PlateBending(), fc.Gravity()]


def on_a_slope(part, **keys):
    """A sheet 10 mm above a slope of the angle atan(part × μ); down it, and the normal."""
    angle = math.atan(part * MU)
    c, s = math.cos(angle), math.sin(angle)
    slope = fc.Obstacle(fc.shapes.Plane((0, 0, 0), (s, 0, c)), gap=GAP, friction=MU, **keys)
    n = np.array([s, 0, c])
    x = CLOTH.X @ np.array([[c, 0, -s], [0, 1, 0]]) + 0.011 * n
    return fc.System(CLOTH, FABRIC, [*TERMS, slope]), x, np.array([c, 0, -s]), n


@pytest.mark.parametrize("dt", [0.02, 1e-3])
@pytest.mark.parametrize("keys", [{}, {"restitution": 0.0}], ids=["elastic", "dead"])
def test_a_sheet_laid_on_a_slope_neither_hops_nor_slides(keys, dt):
    """Its nodes carry their own weight; the springs of friction give way by their part of it."""
    system, x, down, n = on_a_slope(0.8, **keys)
    start = fc.lay_down(system, system.state(x, np.ones_like(x)))
    assert not start.v.any()
    push = system.bound[-1].push(start.x, 0.0) @ n
    np.testing.assert_allclose(push, 9.81 * system.nodal_mass * n[2], rtol=1e-9)
    for state, _ in fc.march(
        system, fc.BackwardEuler(), start, dt, 0.02, newton=fc.Newton(tolerance=1e-8)
    ):
        assert abs(state.x @ n - start.x @ n).max() < 1e-9 * GAP
        assert abs((state.x - start.x) @ down).max() < 0.01 * GAP


def test_each_free_piece_is_laid_down_on_a_ball():
    """The load and the push balance along the push; a piece that pins hold stays."""
    pieces = [fc.Cloth.rectangle(0.05, 0.05, h=0.025) for _ in range(3)]
    cloth = fc.Cloth.join(pieces, names=["left", "right", "held"])
    x = flat(cloth)
    for name, place in (("left", (-0.05, 0, 0.2)), ("right", (0.02, 0, 0.1)), ("held", (0, 1, 0))):
        nodes = cloth.nodes(name)
        x[nodes] += place - x[nodes].min(axis=0)
    ball = fc.Obstacle(fc.shapes.Sphere((0, 0, -0.3), 0.3), gap=GAP)
    system = fc.System(cloth, FABRIC, [*TERMS, ball], ["held"])
    laid = fc.lay_down(system, system.state(x))
    push = system.bound[-1].push(laid.x, 0.0)
    for name in ("left", "right"):
        nodes = cloth.nodes(name)
        p, weight = push[nodes].sum(axis=0), 9.81 * system.nodal_mass[nodes].sum()
        assert p @ p == pytest.approx(p[2] * weight, rel=1e-3)
    held = cloth.nodes("held")
    np.testing.assert_array_equal(laid.x[held], x[held])
