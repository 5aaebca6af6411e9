"""The pinched cylinder of the shell benchmarks, rolled up from a flat sheet and sewn."""

import numpy as np
import pytest

import fecloth as fc
from fecloth.system.state import make_state

R, LENGTH, THICKNESS = 300.0, 600.0, 3.0
FABRIC = fc.Fabric.sheet(E=3e6, nu=0.3, thickness=THICKNESS, rho=1e-3)
# Under a unit load: Belytschko, Stolarski, Liu, Carpenter and Ong (1985), Stress projection for
# membrane and shear locking in shell finite elements, Comput. Methods Appl. Mech. Engng 51.
DEFLECTION = 1.8248e-5
LOAD = 10.0


def distance(n: int, load: float) -> float:
    """The distance of a loaded point from the axis, with n edges around the whole cylinder.

    The seam lies a quarter from the loads, and diaphragms hold the ends.
    """
    h = 2 * np.pi * R / n
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
    x = fc.equilibrium(system, system.start).x
    return abs(float(x[middle(np.pi / 2)[0], 0]))


def deflection(n: int, load: float) -> float:
    """The way of a loaded point per unit load.

    Without a load it moves, too: by the strain of the chords, with h⁴.
    """
    return (distance(n, 0.0) - distance(n, load)) / load


@pytest.mark.filterwarnings("ignore::fecloth.FeclothWarning")
def test_the_load_is_so_small_that_the_shell_is_linear():
    assert deflection(22, 2 * LOAD) == pytest.approx(deflection(22, LOAD), rel=1e-4)


@pytest.mark.stories
@pytest.mark.filterwarnings("ignore::fecloth.FeclothWarning")
def test_the_deflection_converges_to_that_of_the_benchmark():
    values = [deflection(n, LOAD) for n in (44, 88, 176)]
    contraction = (values[0] - values[1]) / (values[1] - values[2])
    limit = values[2] - (values[1] - values[2]) / (contraction - 1)
    assert 1.4 < np.log2(contraction) < 2.2
    assert limit == pytest.approx(DEFLECTION, rel=0.01)
