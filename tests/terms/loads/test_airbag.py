"""A circular airbag inflated from flat: the relaxed membrane against a boundary-value problem.

Two disks joined at the rim are one disk with its mirror plane z = 0, in which the rim slides. A
material point at the radius R goes to r(R), z(R); with λ₁ = √(r′² + z′²), λ₂ = r/R, their Green
strains and the relaxed stress S₁, S₂ (nothing along the parallels where they are wrinkled) the
virtual work of W and of p on the enclosed volume gives

    (R S₁ r′)′ = S₂ r/R + p r z′,    R S₁ z′ = −p r²/2,    r(0) = 0,    r′(a) = z(a) = 0
"""

from functools import cache

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp
from scipy.optimize import brentq

import fecloth as fc

RADIUS, Y, NU = 0.5, 1000.0, 0.3


def stresses(pull, E2):
    """S₁, S₂ where λ₁ S₁ = `pull`, by tension along the meridian or in both directions."""
    stretch = brentq(lambda s: Y * s * (s * s - 1) / 2 - pull, 1.0, 10.0, xtol=1e-13)
    if E2 + NU * (stretch**2 - 1) / 2 <= 0:
        return pull / stretch, 0.0
    factor = Y / (1 - NU**2)
    stretch = brentq(lambda s: factor * s * ((s * s - 1) / 2 + NU * E2) - pull, 0.1, 10.0)
    return pull / stretch, factor * (E2 + NU * (stretch**2 - 1) / 2)


def meridian(p, centre):
    """The solution from the centre outwards, stretched there by `centre` in all directions."""

    def slopes(R, y):
        r, tension, _ = y  # tension = R S₁ r′
        down = -p * r * r / 2
        S1, S2 = stresses(np.hypot(tension, down) / R, ((r / R) ** 2 - 1) / 2)
        dz = down / (R * S1)
        return tension / (R * S1), S2 * r / R + p * r * dz, dz

    begin = 1e-6 * RADIUS
    S = Y / (1 - NU) * (centre**2 - 1) / 2
    start = (centre * begin, begin * S * centre, 0.0)
    grid = np.linspace(begin, RADIUS, 101)
    return solve_ivp(slopes, (begin, RADIUS), start, rtol=1e-8, atol=1e-12, t_eval=grid)


@cache
def airbag(p):
    """R, r, z: the largest stretch of the centre at which the rim ends upright."""

    def upright(centre):
        return meridian(p, centre).y[1, -1]

    high = 1.2
    while upright(low := 1 + (high - 1) / 1.25) > 0:
        high = low
    solution = meridian(p, brentq(upright, low, high, xtol=1e-10))
    r, _, z = solution.y
    return solution.t, r, z - z[-1]


def inflated(law, p, h):
    """System and state at rest, by backward Euler with growing steps."""
    cloth = fc.Cloth.disk(RADIUS, h=h)
    fabric = fc.Fabric(0.2, Y, NU)
    rim = fc.Slide("boundary", normal=(0, 0, 1))
    system = fc.System(cloth, fabric, [law, fc.Pressure(p)], pins=[rim])
    state, dt = system.rest(), 2e-3
    for _ in range(16):
        start, newton = system.state(state.x, state.v), fc.Newton(tolerance=1e-9)
        steps = fc.march(system, fc.BackwardEuler(), start, dt, dt, newton=newton)
        state = [end for end, _ in steps][-1]
        dt *= 1.5
    free = system.constraints.project(system.force(state))
    assert np.linalg.norm(free) < 1e-5 * p * RADIUS**2
    return system, state


@pytest.mark.stories
@pytest.mark.parametrize("p", [100.0, 400.0])
def test_rim_and_height_of_the_inflated_airbag(p):
    """Rim radius and centre height within 1 %, and closer on the finer mesh; so is the profile."""
    R, r, z = airbag(p)
    errors = []
    for h in (0.1, 0.05):
        system, state = inflated(fc.TensionField(), p, h)
        X, x = system.cloth.X, state.x
        rim = np.hypot(*x[system.cloth.nodes("boundary"), :2].T)
        height = system.cloth.interpolate(x[:, 2], np.zeros((1, 2)))[0]
        errors.append(abs(np.array([rim.mean() / r[-1] - 1, height / z[0] - 1])))
        profile = np.hypot(
            np.hypot(*x[:, :2].T) - np.interp(np.hypot(*X.T), R, r),
            x[:, 2] - np.interp(np.hypot(*X.T), R, z),
        )
    assert errors[1].max() < 0.01
    assert (errors[1] < 0.45 * errors[0]).all()
    assert rim.std() < 0.01 * r[-1]  # it stays round
    assert profile.max() < 0.01 * RADIUS


@pytest.mark.stories
def test_the_airbag_is_taut_inside_and_wrinkled_at_the_rim():
    """The states of the triangles follow the sign of S₂ in the reference."""
    R, r, z = airbag(400.0)
    system, state = inflated(fc.TensionField(), 400.0, 0.05)
    _, cells = fc.fields(system, state)
    S11, S22, S12 = cells["S11"], cells["S22"], cells["S12"]
    smaller = (S11 + S22) / 2 - np.hypot((S11 - S22) / 2, S12)
    E2 = ((r / R) ** 2 - 1) / 2
    lam1 = np.hypot(np.gradient(r, R), np.gradient(z, R))
    border = R[np.flatnonzero(E2 + NU * (lam1**2 - 1) / 2 > 0)[-1]]
    at = np.hypot(*system.cloth.X[system.cloth.triangles].mean(axis=1).T)
    assert 0.2 * RADIUS < border < 0.9 * RADIUS
    assert (smaller[at < border - 0.05] > 1.0).all()
    assert (abs(smaller[at > border + 0.05]) < 1e-6 * Y).all()


@pytest.mark.stories
def test_the_reference_becomes_the_mylar_balloon():
    """Inextensible as p → 0: rim a/∫dt/√(1 − t⁴), height ∫t²dt/√(1 − t⁴) times that (Paulsen 1994,
    What is the shape of a Mylar balloon?, Amer. Math. Monthly 101, 953–958)."""
    circle, height = (  # quad's weight is 1/√(1 − t), the rest of 1 − t⁴ is (1 + t)(1 + t²)
        quad(
            lambda t, k=k: t**k / np.sqrt((1 + t) * (1 + t * t)), 0, 1, weight="alg", wvar=(0, -0.5)
        )
        for k in (0, 2)
    )
    _, r, z = airbag(1.5)
    assert r[-1] == pytest.approx(RADIUS / circle[0], rel=1e-3)
    assert z[0] == pytest.approx(RADIUS * height[0] / circle[0], rel=1e-2)
    _, nearer_r, nearer_z = airbag(0.5)
    assert nearer_r[-1] == pytest.approx(RADIUS / circle[0], rel=3e-4)
    assert nearer_z[0] == pytest.approx(RADIUS * height[0] / circle[0], rel=3e-3)
