"""The numbers of contact from both sides: at about 0.8 and 1.25 times their value."""

import math
from contextlib import nullcontext

import numpy as np
import pytest
from conftest import flat

import fecloth as fc

S = fc.shapes
GAP = 2e-3


def refusal(words):
    return pytest.raises(fc.InputError, match=words)


@pytest.mark.parametrize("part", [0.8, 1.25])
def test_the_automatic_stiffness_is_the_larger_of_weight_and_tension(part):
    """ρ g L/gap, and Y · 1 %/(L p(0.9)) with p(0.9) = 0.2 ln(10/9) + 0.01/0.9; L = 0.5 m."""
    weight = 0.3 * 9.81 * 0.5 / GAP
    resting = 0.2 * math.log(10 / 9) + 0.01 / 0.9
    tensile = part * weight * 0.5 * resting / 0.01
    fabric = fc.Fabric(0.3, (tensile, 0.5 * tensile), shear_stiffness=10.0)
    ball = fc.Obstacle(S.Sphere((0, 0, -1), 0.5), GAP)
    (term,) = fc.System(fc.Cloth.rectangle(0.5, 0.2, 0.1), fabric, [ball]).bound
    assert term.stiffness == pytest.approx(weight * max(part, 1.0), rel=1e-12)


@pytest.mark.parametrize(("part", "refused"), [(0.8, False), (1.25, True)])
def test_a_gap_is_at_most_a_tenth_of_the_cloth(part, refused):
    ball = fc.Obstacle(S.Sphere((0, 0, -1), 0.5), gap=part * 0.05)
    with refusal("must be at most 0.05 m") if refused else nullcontext():
        fc.System(fc.Cloth.rectangle(0.5, 0.2, 0.1), fc.Fabric(0.2, 100.0), [ball])


@pytest.mark.parametrize(("part", "slides"), [(0.8, False), (1.25, True)])
@pytest.mark.parametrize("kind", ["Obstacle", "SelfContact"])
def test_friction_is_whole_from_a_thousandth_of_the_cloth_a_second(part, slides, kind):
    """Up to ε it is 2 y/ε − (y/ε)² of μ N."""
    sheet = fc.Cloth.rectangle(0.2, 0.1, 0.1, "right")
    cloth, x, friction = sheet, flat(sheet) + [0, 0, 0.6 * GAP], 0.5
    contact = fc.Obstacle(S.Plane((0, 0, 0), (0, 0, 1)), GAP, friction, 100.0)
    if kind == "SelfContact":
        pytest.importorskip("ipctk")
        cloth = fc.Cloth.join([sheet, fc.Cloth.rectangle(0.4, 0.3, 0.1)], ["upper", "lower"])
        contact = fc.SelfContact(GAP, friction=friction, stiffness=100.0)
        upper = np.isin(np.arange(len(cloth.X)), cloth.nodes("upper"))[:, None]
        x = flat(cloth) + np.where(upper, [0.11, 0.08, 0.6 * GAP], [0, 0, 0])
    (term,) = fc.System(cloth, fc.Fabric(0.2, 100.0), [contact]).bound
    forces, extent = [], np.ptp(cloth.X, axis=0).max()
    above = (x[:, 2] > 0)[:, None]
    for speed in (0.0, part * 1e-3 * extent):
        forces.append(np.zeros_like(x))
        term.add_force(x, speed * np.where(above, [1.0, 0, 0], 0.0), 0.0, forces[-1])
    normal, sliding = forces[0][above[:, 0], 2].sum(), (forces[1] - forces[0])[above[:, 0], 0].sum()
    share = 1.0 if slides else 2 * part - part**2
    assert -sliding / (friction * normal) == pytest.approx(share, rel=1e-9)


@pytest.mark.parametrize(("part", "refused"), [(0.8, True), (1.25, False)])
def test_the_shortest_edge_has_three_gaps(part, refused):
    pytest.importorskip("ipctk")
    cloth = fc.Cloth.rectangle(0.3, 0.3, 0.1, "cross")
    edge = 0.1 / math.sqrt(2)
    gap = edge / (3 * part)
    contact = fc.SelfContact(0.7 * gap, thickness=0.3 * gap)
    with refusal("a third of the shortest edge") if refused else nullcontext():
        fc.System(cloth, fc.Fabric(0.2, 100.0), [contact])
