"""The recovered stress at a point and at the nodes, against a closed form."""

import numpy as np
import pytest

import fecloth as fc
from fecloth.mesh.recovery import QUADRATIC, recovery_gap
from fecloth.system.recovered_stress import StressAtPoint, along_axes, stress_at_nodes

Y, NU = 1000.0, 0.3
K = 2.0  # of the displacement: 1/m
SMALL = 1e-7
STRETCH = 1.01  # keeps the sheet taut, so that it stays flat
INSIDE = np.array([(0.31, 0.33), (0.43, 0.37), (0.62, 0.41), (0.38, 0.64), (0.57, 0.59)])


def displaced(X):
    """s X + ∇φ with φ = c e^(K X) cos(K Y): no divergence, no curl, so that no force is needed."""
    growth = SMALL * K * np.exp(K * X[:, 0])
    x = STRETCH * np.pad(X, ((0, 0), (0, 1)))
    x[:, 0] += growth * np.cos(K * X[:, 1])
    x[:, 1] -= growth * np.sin(K * X[:, 1])
    return x


def exact(X):
    """S = ℂ : E of s I + ∇∇φ, to the first order in φ: (p, 3) xx, yy, xy [N/m]."""
    even = Y / (1 - NU) * (STRETCH**2 - 1) / 2
    curved = SMALL * K**2 * np.exp(K * X[:, 0])
    shear_modulus = Y / (2 * (1 + NU))
    xx = 2 * shear_modulus * STRETCH * curved * np.cos(K * X[:, 1])
    xy = -2 * shear_modulus * STRETCH * curved * np.sin(K * X[:, 1])
    return np.column_stack([even + xx, even - xx, xy])


def solved(element, h, pattern="unstructured", grain=0.0, term=None):
    cloth = fc.Cloth.rectangle(1.0, 1.0, h=h, pattern=pattern, element=element)
    fabric = fc.Fabric(0.2, Y, NU, bending_rigidity=1e-5)
    terms = [term or fc.StVK()]
    system = fc.System(cloth, fabric, terms, [fc.Pin("boundary")], grain=grain)
    return system, fc.equilibrium(system, system.state(displaced(cloth.X)), tolerance=1e-11)


def errors(element, h):
    """The errors inside: at points, and at the nodes of the middle."""
    system, rest = solved(element, h)
    X = system.cloth.X
    scale = np.abs(exact(INSIDE)[:, 2]).max()  # of what varies
    at = np.array([StressAtPoint.of(system, point)(rest.x) for point in INSIDE])
    nodes = (np.abs(X - 0.5) < 0.25).all(axis=1)
    nodal = stress_at_nodes(system, rest.x)[nodes] - exact(X[nodes])
    return [np.sqrt(np.mean(gap**2)) / scale for gap in (at - exact(INSIDE), nodal)]


@pytest.mark.parametrize(("element", "least"), [("P1", 1.5), ("P2", 2.5)])
def test_the_order_inside(element, least):
    coarse, fine = np.array([errors(element, h) for h in (1 / 8, 1 / 24)])
    assert (np.log(coarse / fine) / np.log(3) >= least).all()
    assert (fine < 0.01).all()


@pytest.mark.parametrize("strain", ["interpolated", "pointwise"])
def test_the_axes_are_x_and_y_whatever_the_grain(strain):
    at = []
    for grain in (0.0, 0.7):
        system, rest = solved("P2", 0.1, grain=grain, term=fc.StVK(strain=strain))
        at.append(StressAtPoint.of(system, (0.4, 0.3))(rest.x))
    assert at[1] == pytest.approx(at[0], rel=1e-6)
    assert at[0] == pytest.approx(exact(np.array([[0.4, 0.3]]))[0], rel=1e-3)


def test_a_turned_tensor():
    angle = 0.4
    R = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    S = np.array([[3.0, 0.7], [0.7, -1.0]])
    turned = R @ S @ R.T
    given = np.array([[[S[0, 0], S[1, 1], S[0, 1]]]])
    expected = [turned[0, 0], turned[1, 1], turned[0, 1]]
    assert along_axes(given, np.array([angle]))[0, 0] == pytest.approx(expected)


def test_the_point_and_the_nodes_agree_with_the_recovery_of_the_error_in_space():
    system, rest = solved("P2", 0.25, pattern="right", term=fc.StVK(strain="pointwise"))
    cloth = system.cloth
    S = system.bound[0].sampled_stress(rest.x, np.arange(len(cloth.triangles)))
    groups = system.panel.material
    gap = recovery_gap(cloth.X, cloth.stencil[:, :3], groups, S, QUADRATIC)
    cell, q = 5, 2
    point = QUADRATIC.points[q] @ cloth.X[cloth.stencil[cell, :3]]
    assert StressAtPoint.of(system, point)(rest.x) == pytest.approx((S + gap)[cell, q], rel=1e-9)
    nodal = stress_at_nodes(system, rest.x)
    for node in (cloth.stencil[7, 1], cloth.stencil[7, 4]):
        at = StressAtPoint.of(system, cloth.X[node])(rest.x)
        assert nodal[node] == pytest.approx(at, rel=1e-3)


def test_points_outside_and_cloths_without_a_stress_are_refused():
    system, _ = solved("P1", 0.5)
    with pytest.raises(fc.InputError, match=r"stress at \(3, 0\).*0 <= X <= 1 m"):
        StressAtPoint.of(system, (3.0, 0.0))
    springs = fc.System(system.cloth, system.fabric, [fc.Springs()])
    with pytest.raises(fc.InputError, match="StVK"):
        StressAtPoint.of(springs, (0.5, 0.5))
    assert stress_at_nodes(springs, springs.rest().x) is None


def test_two_membranes_add_up():
    one = solved("P1", 0.25)[0]
    x = displaced(one.cloth.X)
    two = fc.System(one.cloth, one.fabric, [fc.StVK(), fc.StVK()])
    assert stress_at_nodes(two, x) == pytest.approx(2 * stress_at_nodes(one, x))
