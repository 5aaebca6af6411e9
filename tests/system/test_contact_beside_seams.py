"""Contact of a cloth with itself beside a seam."""

from dataclasses import replace

import numpy as np
import pytest
from support.sewn_strips import SEAM, halves

import fecloth as fc
from fecloth.mesh.surface import Surface

pytest.importorskip("ipctk")

FABRIC = fc.Fabric(0.2, 1000.0, poisson_ratio=0.3, bending_rigidity=1e-4)


@pytest.mark.filterwarnings("ignore::fecloth.FeclothWarning")
@pytest.mark.parametrize("h", [(0.05, 0.05), (0.05, 0.04)], ids=["matching", "not matching"])
def test_triangles_that_meet_at_a_seam_do_not_push_each_other(h):
    """A curved sheet of two pieces moves as without contact: nothing is near but at the seam."""
    cloth, seam = halves(h), replace(SEAM, stiffness=1e-3)
    X, Y = cloth.X.T
    x = np.column_stack([X, Y, 0.05 * np.sin(3 * X) * np.sin(5 * Y)])
    ends = []
    for terms in ([], [fc.SelfContact(gap=2e-3)]):
        system = fc.System(
            cloth, FABRIC, [fc.StVK(), fc.Gravity(), *terms], pins=["a/left"], seams=[seam]
        )
        start = system.state(system.constraints.followers.follow(x.copy()))
        newton = fc.Newton(tolerance=1e-10)
        ends.append(fc.run(system, fc.BackwardEuler(), start, dt=2e-3, t_end=0.01, newton=newton))
    np.testing.assert_allclose(ends[1].state.x, ends[0].state.x, atol=1e-8)


@pytest.mark.parametrize("element", ["P1", "P2"])
def test_triangles_that_meet_at_a_seam_do_not_count_as_intersections(element):
    a = fc.Cloth.rectangle(0.2, 0.2, h=0.05, pattern="right", element=element)
    b = fc.Cloth.rectangle(0.2, 0.2, h=0.04, pattern="right", element=element)
    cloth = fc.Cloth.join([a, replace(b, X=b.X + (0.2, 0.0))], names=["a", "b"])
    system = fc.System(cloth, FABRIC, [fc.StVK()], seams=[SEAM])
    follow = system.constraints.followers.follow
    sewn, loose = Surface.from_cloth(system.cloth), Surface.from_cloth(cloth)
    X, Y = cloth.X.T
    beyond = np.maximum(X - 0.2, 0.0)
    z = 0.02 * np.sin(30 * Y)
    # b is turned back over a: their chords cross at the seam, and nowhere else
    over = follow(np.column_stack([X - 1.5 * beyond, Y, z + 0.2 * beyond]))
    assert loose.count_intersections(over) > 10
    assert sewn.count_intersections(over) == 0
    # b lies flat in the waves of a
    through = follow(np.column_stack([X - 1.9 * beyond, Y, np.where(beyond > 0.0, 0.0, z)]))
    assert sewn.count_intersections(through) > 10


@pytest.mark.filterwarnings("ignore::fecloth.FeclothWarning")
def test_sheets_that_are_sewn_at_one_edge_touch_elsewhere():
    """The upper one of two sheets falls on the lower one, to which it is sewn, and stays above."""
    sheet = fc.Cloth.rectangle(0.2, 0.2, h=0.05)
    cloth = fc.Cloth.join([sheet, sheet], names=["a", "b"])
    seam = fc.Seam("a.left", "b.left")
    gap = 4e-3
    system = fc.System(
        cloth,
        FABRIC,
        [fc.StVK(), fc.PlateBending(), fc.Gravity(), fc.SelfContact(gap=gap)],
        pins=["a"],
        seams=[seam],
    )
    x = system.rest().x
    upper = cloth.nodes("b")
    x[upper, 2] = 0.5 * cloth.X[upper, 0]
    start = system.state(system.constraints.followers.follow(x))
    result = fc.run(system, fc.BackwardEuler(), start, dt=5e-3, t_end=0.2)
    z = result.state.x[upper, 2]
    beyond = cloth.X[upper, 0] > 0.1
    assert 0.9 * gap < z[beyond].min() < gap
    assert np.median(z[beyond]) < 1.2 * gap
