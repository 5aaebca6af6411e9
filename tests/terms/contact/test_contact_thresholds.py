"""The numbers of contact from both sides: at about 0.8 and 1.25 times their value."""

import math
from contextlib import nullcontext

import numpy as np
import pytest
from conftest import flat

import fecloth as fc
from fecloth.terms.contact.advance import advance, goes_through
from fecloth.terms.contact.inside import cutting_depth
from fecloth.terms.step_difference import StepDifference

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
def test_a_cloth_that_is_pressed_on_slides_beyond_a_thousandth_of_the_gap(part, slides, kind):
    """Up to there friction is the part of μ N; less pressed on, it slides sooner."""
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
    over = term.over_step(StepDifference.between(x, 0.01, 0.0))
    above, f = x[:, 2] > 0, np.zeros_like(x)
    over.add_force(x + part * 1e-3 * GAP * np.outer(above, [1.0, 0, 0]), x, 0.01, f)
    share = -f[above, 0].sum() / (friction * f[above, 2].sum())
    assert share == pytest.approx(1.0 if slides else part, rel=1e-3)  # pairs move, so N does


@pytest.mark.parametrize(("part", "refused"), [(0.8, True), (1.25, False)])
def test_the_shortest_edge_has_three_gaps(part, refused):
    pytest.importorskip("ipctk")
    cloth = fc.Cloth.rectangle(0.3, 0.3, 0.1, "cross")
    edge = 0.1 / math.sqrt(2)
    gap = edge / (3 * part)
    contact = fc.SelfContact(0.7 * gap, thickness=0.3 * gap)
    with refusal("a third of the shortest edge") if refused else nullcontext():
        fc.System(cloth, fc.Fabric(0.2, 100.0), [contact])


# --- how far a point may go -----------------------------------------------------------------------


def distance_left(shape, d, way):
    """The distance of a point above z = 0, over the gap, after the way that it may go."""
    y = np.array([[0.0, 0.0, d * GAP]])
    (part,) = advance(shape, y, GAP * np.array([way]), 0.0, GAP)
    return (d + part * way[2]) if part < 1 else -1.0


@pytest.mark.parametrize(("d", "left"), [(0.5, 0.1), (1.0, 0.2), (4.0, 0.2)])
def test_a_point_leaves_a_fifth_of_its_distance_or_of_the_gap(d, left):
    plane = S.Plane((0, 0, 0), (0, 0, 1))
    assert distance_left(plane, d, (1.0, 0.0, -9.0)) == pytest.approx(left)


@pytest.mark.parametrize(("part", "through"), [(0.8, False), (1.25, True)])
@pytest.mark.parametrize("shape", [S.Sphere((0, 0, 0), 1.0), S.Sdf("x**2 + y**2 + z**2 - 1")])
def test_a_way_goes_through_where_it_leaves_more_than_a_right_angle_from_where_it_enters(
    shape, part, through
):
    """The normals of a chord at the distance cos a from the centre are 2 a apart."""
    a = part * math.pi / 4
    begin, end = np.array([[[-1.5, math.cos(a), 0.0]], [[4.0, math.cos(a), 0.0]]])
    assert goes_through(shape, begin, end, 0.0) == through
    assert not goes_through(shape, begin, 0.2 * end, 0.0)  # it ends inside
    assert not goes_through(shape, begin, begin - [[1.0, 0.0, 0.0]], 0.0)


@pytest.mark.parametrize(("end", "through"), [((3.0, 0.1, 0.5), True), ((0.5, 3.0, 0.0), False)])
def test_a_way_past_the_edge_of_a_box_does_not_go_through(end, through):
    box = S.Box((0, 0, 0), (2, 2, 2))
    assert goes_through(box, np.array([[-3.0, 0.1, 0.5]]), np.array([end]), 0.0) == through


# --- points of the cloth --------------------------------------------------------------------------


def bound_triangle(dip, gap=GAP):
    """A ball on one triangle, between whose nodes it would dip in by `dip` [gap]."""
    X = np.array([[0, 0], [0.1, 0], [0.05, 0.08]])
    cloth = fc.Cloth.from_arrays(X, [[0, 1, 2]])
    radius = 0.1**2 / (6 * dip * gap) - gap
    ball = fc.Obstacle(S.Sphere((0, 0, -1), radius), gap, stiffness=1.0)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("fecloth.terms.contact.obstacle.is_installed", lambda: False)
        (term,) = fc.System(cloth, fc.Fabric(0.2, 100.0), [ball]).bound
    parts = round((math.sqrt(1 + 8 * sum(len(each.areas) for each in term.points)) - 3) / 2)
    return term, cloth, parts


@pytest.mark.parametrize(("part", "parts"), [(0.8, 1), (1.25, 2)])
def test_an_edge_is_divided_where_a_triangle_dips_in_by_a_quarter_of_the_gap(part, parts):
    assert bound_triangle(0.25 * part)[2] == parts


@pytest.mark.parametrize(("needed", "parts", "cuts"), [(7, 7, False), (8, 8, False), (10, 8, True)])
def test_an_edge_has_eight_parts_at_most_and_the_rest_is_told(needed, parts, cuts):
    term, cloth, divided = bound_triangle(0.25 * (needed - 0.1) ** 2)
    assert divided == parts
    assert sum(each.areas.sum() for each in term.points) == pytest.approx(cloth.area)
    assert (cutting_depth(term.shape, term.gap, cloth) > 0) == cuts


def test_what_is_told_is_how_deep_a_part_dips_into_a_ball():
    """The centre of an equilateral triangle whose corners lie on the ball, a gap farther out."""
    term, cloth, _ = bound_triangle(0.25 * 9.9**2)
    radius, edge = 0.1**2 / (6 * 0.25 * 9.9**2 * GAP), 0.1 / 8
    exact = radius - math.sqrt(radius**2 - edge**2 / 3)
    assert cutting_depth(term.shape, term.gap, cloth) == pytest.approx(exact, rel=0.05)


@pytest.mark.parametrize(("dip", "stretch"), [(0.25 * 9.9**2, 1.7), (0.24, 1.2)])
def test_stretched_triangles_dip_deeper(dip, stretch):
    """Of the same ball: by the square of the stretch, also where nothing is told at rest."""
    term, cloth, parts = bound_triangle(dip)
    radius = 0.1**2 / (6 * dip * GAP)
    exact = radius - math.sqrt(radius**2 - (stretch * 0.1 / parts) ** 2 / 3)
    told = cutting_depth(term.shape, term.gap, cloth, stretch)
    assert told == pytest.approx(exact, rel=0.05)
