"""Energy of explicit runs with a plate, and what `Auto` chooses."""

import numpy as np
import pytest

import fecloth as fc
from fecloth.simulation.resolve import resolve
from fecloth.stability.critical_step import critical_dt


def heavy_strip(pattern, element, bending):
    """A strip of ρ g L³/B = 1000 and Y L²/B = 1e6, clamped at one end, 1/32 between nodes."""
    h = 1 / 32 if element == "P1" else 1 / 16
    cloth = fc.Cloth.rectangle(1.0, 0.25, h, pattern, element)
    fabric = fc.Fabric(1 / 9.81, 1000.0, 0.0, bending_rigidity=1e-3)
    left = fc.Pin("left", clamp=isinstance(bending, fc.PlateBending))
    return fc.System(cloth, fabric, [fc.StVK(), bending, fc.Gravity()], [left], "lumped")


@pytest.mark.stories
@pytest.mark.parametrize(("pattern", "element"), [("right", "P1"), ("unstructured", "P2")])
def test_a_falling_strip_keeps_its_energy(pattern, element):
    """15,000 explicit steps at half the limit: the total drifts by < 0.1 % of the work done."""
    system, method = heavy_strip(pattern, element, fc.PlateBending()), fc.CentralDifference()
    state, memory = system.rest(), None
    dt, rows = 0.5 * critical_dt(system, state, method), [system.energies(state)]
    for number in range(15_000):
        step = method.step(system, state, dt, None, memory)
        state, memory = step.state, step.memory
        if number % 10 == 9:
            rows.append(system.energies(state))
    total, work, bending = (
        np.array([sum(row.values()) for row in rows]),
        rows[0]["Gravity"] - np.array([row["Gravity"] for row in rows]),
        np.array([row["PlateBending"] for row in rows]),
    )
    assert work.max() > 0.3 * 0.25 * 0.2  # its weight is 0.25 N
    assert bending.max() > 0.02 * work.max()
    assert np.abs(total - total[0]).max() < 1e-3 * work.max()


@pytest.mark.parametrize("element", ["P1", "P2"])
@pytest.mark.parametrize(
    ("rigidity", "rtol", "expected"),
    [(1e-6, 1e-5, fc.CentralDifference), (100.0, 0.1, fc.GeneralizedAlpha)],
)
def test_auto_takes_implicit_steps_where_the_plate_is_stiff(rigidity, rtol, expected, element):
    """A sheet swings about its upper edge, as a limp cloth or as a board."""
    h = 0.05 if element == "P1" else 0.1
    cloth = fc.Cloth.rectangle(1.0, 1.0, h, "right", element)
    fabric = fc.Fabric(0.2, 100.0, 0.0, bending_rigidity=rigidity)
    terms = [fc.StVK(), fc.PlateBending(), fc.Gravity()]
    system = fc.System(cloth, fabric, terms, ["left"], "lumped")
    choice, _, why = resolve(system, fc.Auto(rtol), system.rest(), 2.0)
    assert isinstance(choice.method, expected), why
