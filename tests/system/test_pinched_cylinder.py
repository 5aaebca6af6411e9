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


def rolled(cloth: fc.Cloth, start: float) -> np.ndarray:
    """The positions of a flat cloth on a cylinder, from the angle `start` [rad] on.

    Of its radius the quadratic arcs over the edges have no mean strain: with the angle φ of an
    edge h, h² = r² (4 sin² φ/2 + 16/3 (1 − cos φ/2)²). So the shell begins without stress.
    """
    X, Y = cloth.X.T
    h = 2 * np.diff(np.unique(X.round(6))).max()
    half = h / R / 2
    r = h / np.sqrt(4 * np.sin(half) ** 2 + 16 / 3 * (1 - np.cos(half)) ** 2)
    return np.column_stack([r * np.cos(X / R + start), r * np.sin(X / R + start), Y])


def octant(h: float, load: float = LOAD):
    """An eighth with three planes of symmetry; the load is at the corner of two of them."""
    cloth = fc.Cloth.rectangle(np.pi * R / 2, LENGTH / 2, h=h, pattern="right", element="P2")
    x = rolled(cloth, 0.0)
    system = fc.System(
        cloth,
        FABRIC,
        [
            fc.StVK(),
            fc.PlateBending(rest="start"),
            fc.PointForce(lambda X: np.linalg.norm(X, axis=1) < 1e-6, (-load / 4, 0.0, 0.0)),
        ],
        pins=[
            fc.Slide("left", normal=(0, 1, 0), clamp=True),
            fc.Slide("right", normal=(1, 0, 0), clamp=True),
            fc.Slide("bottom", normal=(0, 0, 1), clamp=True),
            fc.Slide("top", direction=(0, 0, 1)),
        ],
        start=make_state(len(x), x),
    )
    return cloth, system, None, system.start


def sewn(h: float, load: float = LOAD):
    """The whole cylinder with a seam a quarter from the loads; diaphragms hold the ends."""
    cloth = fc.Cloth.rectangle(2 * np.pi * R, LENGTH, h=h, pattern="right", element="P2")
    x = rolled(cloth, -np.pi / 2)

    def middle(place: float) -> np.ndarray:
        return np.flatnonzero(np.linalg.norm(cloth.X - (place * R, LENGTH / 2), axis=1) < 1e-6)

    ends = np.union1d(cloth.nodes("bottom"), cloth.nodes("top"))
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
    return cloth, system, None, system.start


def deflection(rest) -> float:
    """The way of the loaded point per unit load: beside it the diaphragm keeps the radius."""
    line = rest.x[(abs(rest.x[:, 1]) < 1e-2) & (rest.x[:, 0] > 0)]
    return (line[line[:, 2].argmax(), 0] - line[:, 0].min()) / LOAD


@pytest.mark.filterwarnings("ignore::fecloth.FeclothWarning")
@pytest.mark.parametrize("shell", [octant, sewn])
def test_the_load_is_so_small_that_the_shell_is_linear(shell):
    once, twice = (fc.equilibrium(*shell(2 * np.pi * R / 22, p)[1::2]) for p in (LOAD, 2 * LOAD))
    assert deflection(twice) == pytest.approx(2 * deflection(once), rel=1e-4)


@pytest.mark.filterwarnings("ignore::fecloth.FeclothWarning")
def test_an_octant_by_symmetry_converges_to_the_benchmark():
    study = fc.study.converge(octant, deflection, h=2 * np.pi * R / 44, levels=3)
    assert study.verdict.startswith("converges as it should")
    assert study.limit == pytest.approx(DEFLECTION, rel=0.01)
    assert abs(study.value - DEFLECTION) < study.uncertainty


@pytest.mark.stories
@pytest.mark.filterwarnings("ignore::fecloth.FeclothWarning")
def test_the_sewn_cylinder_agrees_with_the_octant_within_their_uncertainties():
    part = fc.study.converge(octant, deflection, h=2 * np.pi * R / 44, levels=4)
    whole = fc.study.converge(sewn, deflection, h=2 * np.pi * R / 44, levels=3)
    assert whole.verdict.startswith("converges as it should")
    assert whole.limit == pytest.approx(DEFLECTION, rel=0.01)
    assert abs(whole.value - part.value) < np.hypot(whole.uncertainty, part.uncertainty)
