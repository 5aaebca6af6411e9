"""Membranes on quadratic triangles: orders in space, and the patch test."""

import numpy as np
import pytest
from support.tiers import stories_except

import fecloth as fc
from fecloth.verify import observed_order

FABRIC = fc.Fabric(0.2, (1000.0, 600.0), 0.3, 150.0)


STRETCH, WAVE = np.array([1.2, 1.1]), 0.08


def motion(X):
    """Positions (p, 3) of a sheet stretched along both axes, with in-plane and normal waves."""
    s, t = np.pi * X[:, 0], np.pi * X[:, 1]
    return np.column_stack(
        [
            STRETCH[0] * X[:, 0] + WAVE * np.sin(s) * np.cos(t) / np.pi,
            STRETCH[1] * X[:, 1] + WAVE * np.cos(s) * np.sin(t) / np.pi,
            2 * WAVE * np.sin(s) * np.sin(t) / np.pi,
        ]
    )


def motion_gradient(X):
    """Deformation gradient F (p, 3, 2)."""
    s, t = np.pi * X[:, 0], np.pi * X[:, 1]
    cc, ss, sc, cs = (
        a * b
        for a, b in (
            (np.cos(s), np.cos(t)),
            (np.sin(s), np.sin(t)),
            (np.sin(s), np.cos(t)),
            (np.cos(s), np.sin(t)),
        )
    )
    F = np.stack(
        [
            np.stack([WAVE * cc + STRETCH[0], -WAVE * ss], -1),
            np.stack([-WAVE * ss, WAVE * cc + STRETCH[1]], -1),
            np.stack([2 * WAVE * cs, 2 * WAVE * sc], -1),
        ],
        axis=1,
    )
    return F


def stress(X):
    """(p, 3, 2) P = F S of the isotropic StVK sheet, also for complex X."""
    F, Y, nu = motion_gradient(X), 1000.0, 0.3
    E = (np.einsum("pji,pjk->pik", F, F) - np.eye(2)) / 2
    trace = np.trace(E, axis1=1, axis2=2)[:, None, None]
    S = Y / (1 - nu**2) * ((1 - nu) * E + nu * trace * np.eye(2))
    return np.einsum("pij,pjk->pik", F, S), S


def body_force(X):
    """(p, 3) −Div P [N/m²], by complex steps."""
    h = 1e-30
    shifts = 1j * h * np.eye(2)
    return -sum(stress(X + shifts[j])[0][:, :, j].imag / h for j in range(2))


LOADS = {
    "nodal values": ("area", "interpolated"),
    "shape functions": ("node", "interpolated"),
    "pointwise strain": ("node", "pointwise"),
}


def static_errors(element, n, per, strain):
    """L2 and H1 error of the equilibrium under the force that makes `motion` exact.

    Per "node" the force is integrated with the shape functions, per "area" by its nodal values.
    """
    cloth = fc.Cloth.rectangle(1.0, 1.0, 1 / n, element=element)
    values = cloth.load(body_force, order=8) if per == "node" else body_force(cloth.X)
    force = fc.UserForce(lambda x, v, t: values, per=per)
    terms = [fc.StVK(strain=strain), force]
    system = fc.System(cloth, fc.Fabric(0.2, 1000.0, 0.3), terms, pins=["boundary"])
    x = fc.equilibrium(system, system.state(motion(cloth.X))).x
    return cloth.l2_error(x, motion, 10), cloth.h1_error(x, motion_gradient, 10)


@pytest.mark.parametrize("how", stories_except(LOADS, "nodal values"))
@pytest.mark.parametrize(("element", "l2", "h1"), [("P1", 2, 1), ("P2", 3, 2)])
def test_orders_in_space(element, l2, h1, how):
    points = np.random.default_rng(0).uniform(size=(500, 2))
    assert np.linalg.eigvalsh(stress(points)[1]).min() > 0  # taut: the problem is well posed
    n = (8, 16, 32)
    errors = np.array([static_errors(element, k, *LOADS[how]) for k in n])
    orders = [observed_order(1 / np.array(n), e)[-1] for e in errors.T]
    assert orders == pytest.approx([l2, h1], abs=0.15)


def test_the_patch_test():
    """If the border has an affine displacement, equilibrium is affine at all inner nodes."""
    cloth = fc.Cloth.rectangle(1.0, 0.7, h=0.25, element="P2")
    F = np.array([[1.2, 0.1], [0.05, 1.1], [0.2, 0.0]])
    x = cloth.X @ F.T
    noise = 0.02 * np.random.default_rng(3).standard_normal(x.shape)
    noise[cloth.nodes("boundary")] = 0
    system = fc.System(cloth, FABRIC, [fc.StVK()], pins=["boundary"])
    end = fc.equilibrium(system, system.state(x + noise))
    assert np.abs(end.x - x).max() < 1e-8
