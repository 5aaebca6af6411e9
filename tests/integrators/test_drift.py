"""Energy over 10⁴ steps of a nonlinear swing: symplectic methods keep it in a band, others do not.

Two masses on taut triangles, let go 10 % stretched; ω dt = 0.64 in the fastest mode. Energies are
relative to the largest kinetic energy that the swing reaches.
"""

import numpy as np
import pytest
from support.tiers import slow_except

import fecloth as fc
from fecloth.integrators import EXPLICIT, METHODS

DT, STEPS = 8e-4, 10_000
BANDS = {  # steps at DT, the band there, and the band over a fifth of the steps at DT/2
    "symplectic_euler": (STEPS, 0.56, 0.28),
    "central_difference": (STEPS, 0.07, 0.0175),
    "implicit_midpoint": (STEPS, 0.008, 0.002),
    "newmark": (STEPS // 5, 0.016, 0.004),
    "energy_momentum": (STEPS // 5, 1e-8, 1e-8),  # what Newton's tolerance leaves
}
WIDEST = 0.56
OTHERS = sorted({*METHODS, *EXPLICIT} - set(BANDS))


def made(name):
    """The method; forward Euler's limit is 0 here, and is not asked."""
    if name == "forward_euler":
        return fc.ForwardEuler(beyond_limit=True)
    return {**METHODS, **EXPLICIT}[name]()


@pytest.fixture(scope="module")
def swing():
    """The system, its start, and the largest kinetic energy [J] of 300 finer steps."""
    cloth = fc.Cloth.rectangle(0.4, 0.3, h=0.2, pattern="right")
    fabric = fc.Fabric(areal_density=0.2, tensile_stiffness=1000.0, poisson_ratio=0.3)
    system = fc.System(cloth, fabric, [fc.StVK()], pins=["left", "right"])
    x = np.column_stack([1.1 * cloth.X, np.zeros(len(cloth.X))])
    v = np.array([0.5, 0.3, 2.0]) * (1 + cloth.X[:, 1:])
    start = system.state(x, system.constraints.project(v))
    run = fc.march(system, fc.CentralDifference(), start, DT / 4, 75 * DT)
    return system, start, max(system.energies(state)["kinetic"] for state, _ in run)


def changes(swing, name, dt, steps):
    """Change of the energy since the start after each step."""
    system, start, scale = swing
    begin = sum(system.energies(start).values())
    newton = fc.Newton(tolerance=1e-10)
    run = fc.march(system, made(name), start, dt, steps * dt, solver="direct", newton=newton)
    for state, _ in run:
        yield (sum(system.energies(state).values()) - begin) / scale


@pytest.mark.parametrize("name", slow_except(BANDS, "symplectic_euler", "central_difference"))
def test_the_energy_stays_in_a_band(name, swing):
    """Which narrows with dt as the method's order says, and in which nothing drifts."""
    many, wide, narrow = BANDS[name]
    for dt, steps, band in ((DT, many, wide), (DT / 2, many // 5, narrow)):
        change = np.fromiter(changes(swing, name, dt, steps), float)
        drift = change[steps // 2 :].mean() - change[: steps // 2].mean()
        print(f"{name} dt {dt}: from {change.min():.2e} to {change.max():.2e}, drift {drift:.1e}")
        assert np.ptp(change) < band
        assert abs(drift) < 0.05 * band or name == "energy_momentum"


@pytest.mark.parametrize("name", OTHERS)
def test_others_leave_the_widest_band(name, swing):
    for step, change in enumerate(changes(swing, name, DT, STEPS), start=1):
        if abs(change) > WIDEST:
            print(f"{name} left after {step} steps")
            return
    pytest.fail(f"the energy has changed by {change:.3g} only")
