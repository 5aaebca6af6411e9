"""A ribbon twisted by a whole turn, with ν = 0.3 in the membrane and in bending.

The helicoid of an endless ribbon is the independent solution. By its symmetry (a screw motion along
the axis, half a turn about any line across) the equilibrium of a uniformly twisted ribbon is

    x = (a X, y cos τX, y sin τX),   y = y(Y) odd,

with the stretch a of the axis and the shape y across. Green's strain and the curvature are

    E₁₁ = ½ (a² + τ²y² − 1),   E₂₂ = ½ (y'² − 1),   κ₁₂ = a τ y'/√(a² + τ²y²),   E₁₂ = κ₁₁ = κ₂₂ = 0

and the energy per length, minimised over a and y, shares nothing with triangles or hinge angles. As
κ₁₁ = κ₂₂ = 0 the ends of a finite ribbon have no moment: it is enough to hold their nodes. With
ν = 0 in bending the energy would be 41 % higher.
"""

import numpy as np
import pytest
from scipy.optimize import minimize
from support.tiers import stories_except

import fecloth as fc

NU, B, Y, WIDTH, TURN = 0.3, 1.0, 1e5, 0.05, 2 * np.pi  # of a ribbon of length 1
FABRIC = fc.Fabric(1.0, Y, NU, bending_rigidity=B, bending_poisson_ratio=NU)
TERMS = [fc.StVK(), fc.PlateBending()]


def helicoid():
    """Energy per length, the stretch a, and the function y."""
    points, weights = np.polynomial.legendre.leggauss(20)
    scale = (1 - NU) * B * TURN**2 * WIDTH  # of bending without stretch

    def across(c):  # y over W/2 as a function of 2Y/W
        odd = np.column_stack([np.zeros(len(c)), c]).ravel()
        return np.polynomial.Polynomial(odd)

    def energy(q):
        a, shape = q[0], across(q[1:])
        y, dy = 0.5 * WIDTH * shape(points), shape.deriv()(points)
        E1, E2 = (a**2 + (TURN * y) ** 2 - 1) / 2, (dy**2 - 1) / 2
        membrane = Y / (1 - NU**2) * (E1**2 + E2**2 + 2 * NU * E1 * E2)
        twist = a * TURN * dy / np.sqrt(a**2 + (TURN * y) ** 2)
        bending = 4 * (1 - NU) * B / 2 * twist**2
        return weights @ (0.5 * WIDTH * 0.5 * (membrane + bending)) / scale

    least = minimize(energy, [1.0, 1.0, 0.0, 0.0], method="BFGS", options={"gtol": 1e-7})
    shape = across(least.x[1:])
    return scale * least.fun, least.x[0], lambda Y: 0.5 * WIDTH * shape(2 * Y / WIDTH)


def held_at_the_helicoid(pattern, element, n):
    """Energy of a ribbon with n nodes across over that of the helicoid, minus 1."""
    exact, a, y = helicoid()
    cloth = fc.Cloth.rectangle(1.0, WIDTH, WIDTH / n * (element == "P1" or 2), pattern, element)
    along, across = TURN * cloth.X[:, 0], y(cloth.X[:, 1] - WIDTH / 2)
    x = np.column_stack([a * cloth.X[:, 0], across * np.cos(along), across * np.sin(along)])
    system = fc.System(cloth, FABRIC, TERMS, ["left", "right"])
    twisted = fc.equilibrium(system, system.state(x), tolerance=1e-8)
    return sum(system.energies(twisted).values()) / exact - 1


@pytest.mark.stories
@pytest.mark.parametrize(
    "pattern", stories_except(["right", "equilateral", "unstructured"], "right")
)
def test_ribbon_twisted_by_a_whole_turn_is_a_helicoid(pattern):
    linear = [held_at_the_helicoid(pattern, "P1", n) for n in (4, 8)]
    quadratic = [held_at_the_helicoid(pattern, "P2", n) for n in (4, 8)]
    assert linear[1] < 0.008
    assert 1.6 < np.log2(linear[0] / linear[1]) < 2.15
    assert quadratic[0] < 0.004
    assert abs(quadratic[1]) < 4e-4


@pytest.mark.stories
def test_linear_triangles_converge_to_the_helicoid_with_order_2():
    errors = [held_at_the_helicoid("right", "P1", n) for n in (8, 16)]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.1)


def test_the_helicoid_of_a_narrow_ribbon_stores_its_twist_only():
    """½ · 4 D₆₆ τ² per area, and 1/720 Y τ⁴ W⁵ of the stretch of its edges."""
    exact, a, y = helicoid()
    twist = (1 - NU) * B * TURN**2 * WIDTH
    stretch = Y * TURN**4 * WIDTH**5 / 1440
    assert exact == pytest.approx(twist + stretch, rel=0.01)
    assert a == pytest.approx(1 - (TURN * WIDTH) ** 2 / 24, abs=4e-4)
    assert y(WIDTH / 2) == pytest.approx(WIDTH / 2, rel=0.01)
