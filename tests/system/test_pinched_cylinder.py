"""The pinched cylinder of the shell benchmarks, rolled up from a flat sheet and sewn."""

import numpy as np
import pytest

import fecloth as fc
from fecloth.simulation.load_steps import LoadSteps
from fecloth.system.state import make_state

R, LENGTH, THICKNESS = 300.0, 600.0, 3.0
FABRIC = fc.Fabric.sheet(E=3e6, nu=0.3, thickness=THICKNESS, rho=1e-3)
# Under a unit load: Belytschko, Stolarski, Liu, Carpenter and Ong (1985), Stress projection for
# membrane and shear locking in shell finite elements, Comput. Methods Appl. Mech. Engng 51.
DEFLECTION = 1.8248e-5


def pinched(h: float, load: float = 1000.0):
    """The whole cylinder: its seam lies a quarter from the loads, and diaphragms hold its ends."""
    cloth = fc.Cloth.rectangle(2 * np.pi * R, LENGTH, h=h, pattern="right", element="P2")
    X, Y = cloth.X.T
    angle = X / R - np.pi / 2
    x = np.column_stack([R * np.cos(angle), R * np.sin(angle), Y])

    def middle(place: float) -> np.ndarray:
        return np.flatnonzero((abs(X - place * R) < 1e-6) & (abs(Y - LENGTH / 2) < 1e-6))

    ends = np.flatnonzero((Y < 1e-6) | (Y > LENGTH - 1e-6))
    system = fc.System(
        cloth,
        FABRIC,
        [
            fc.StVK(),
            fc.PlateBending(rest="start"),
            fc.PointForce(middle(np.pi / 2), (-load, 0.0, 0.0)),
            fc.PointForce(middle(3 * np.pi / 2), (load, 0.0, 0.0)),
        ],
        pins=[
            fc.Slide(ends, direction=(0, 0, 1)),
            fc.Slide(middle(np.pi), normal=(0, 0, 1)),
        ],
        start=make_state(len(x), x),
        seams=[fc.Seam("left", "right", stiffness="cloth")],
    )
    return cloth, system, LoadSteps(1), system.start


def distance(x: np.ndarray) -> float:
    """Of a loaded point from the axis."""
    near = np.flatnonzero(np.abs(x[:, 2] - LENGTH / 2) < 1.0)
    return float(abs(x[near[np.abs(x[near, 1]).argmin()], 0]))


def deflection(result) -> float:
    """The way of a loaded point per unit load; without a load it is R away."""
    return (R - distance(result.state.x)) / 1000.0


@pytest.mark.stories
@pytest.mark.filterwarnings("ignore::fecloth.FeclothWarning")
def test_the_deflection_converges_to_that_of_the_benchmark():
    """Nodes start on the cylinder; strains of its chords leave a way of order h⁴."""
    found = fc.study.converge(pinched, quantity=deflection, levels=3, h=2 * np.pi * R / 44)
    assert found.order == pytest.approx(2.0, abs=0.5)
    assert found.limit == pytest.approx(DEFLECTION, rel=0.01)
    assert abs(found.limit - DEFLECTION) < found.uncertainty


@pytest.mark.filterwarnings("ignore::fecloth.FeclothWarning")
def test_the_load_is_so_small_that_the_shell_is_linear():
    ways = []
    for load in (0.0, 1000.0, 2000.0):
        _, system, _, start = pinched(2 * np.pi * R / 22, load)
        ways.append(distance(fc.equilibrium(system, start).x))
    assert (ways[0] - ways[2]) / (ways[0] - ways[1]) == pytest.approx(2.0, rel=2e-3)
