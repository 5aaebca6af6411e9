"""The catalogue of contact sees triangles that are pierced, and that pass over a point."""

import numpy as np
import pytest

import fecloth as fc

pytest.importorskip("ipctk")
from studies.evidence.contact.catalogue_bodies import Motion, turn_about
from studies.evidence.contact.catalogue_runs import count_cut, count_swept, watch
from studies.evidence.contact.catalogue_scenes import KINDS, draw

TRIANGLE = np.array([[[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 2.0, 0.0]]])
POINT = np.zeros((1, 3))


@pytest.mark.parametrize(
    ("begin", "end", "cut"),
    [((0, 0, -1), (0, 0, 1), 1), ((0, 0, 0.1), (0, 0, 1), 0), ((1, 1, -1), (1, 1, 1), 0)],
)
def test_a_line_that_cuts_a_triangle_is_seen(begin, end, cut):
    line = np.array([[begin, end]], float)
    assert count_cut(line, TRIANGLE) == count_cut(line[:, ::-1], TRIANGLE) == cut


@pytest.mark.parametrize(
    ("begin", "end", "swept"),
    [((0, 0, -0.3), (0, 0, 0.2), 1), ((0, 0, -0.3), (0, 0, -0.2), 0), ((3, 0, -1), (3, 0, 1), 0)],
)
def test_a_triangle_that_passes_over_a_point_is_seen(begin, end, swept):
    """A turn on the way changes nothing."""
    turned = (TRIANGLE + end) @ turn_about(np.array([0.0, 0.0, 1.0]), 0.3)
    assert count_swept(POINT, TRIANGLE + begin, turned) == swept


def test_bodies_are_where_their_terms_are():
    """A body has the frame of its shape, and moves and turns it by formulas of its own."""
    motion = Motion(np.array([0.1, 0.2, -0.3]), 4.0, np.array([1.0, 2.0, 0.5]), 7.0)
    centre, x, t = np.array([0.3, -0.1, 0.2]), np.eye(3), 0.21
    shape = fc.shapes.Sphere(tuple(centre), 0.1, **motion.keys(centre))
    expected = shape.pose(t).to_body(x) - centre
    np.testing.assert_allclose(motion.to_rest(x, centre, t), expected, atol=1e-12)


@pytest.mark.parametrize("kind", ["throw", "projectile", "spin", "squeeze"])
def test_bodies_and_terms_agree_on_what_is_inside(kind, rng):
    scene = draw(kind, 1, 1)
    names = scene.system.names
    terms = [
        term
        for name, term in zip(names, scene.system.bound, strict=True)
        if name.startswith("Obstacle")
    ]
    bodies = [body for body in scene.bodies if body.depth is not None]
    for body, term in zip(bodies, terms, strict=True):
        assert body.deep(scene.start.x, 0.0).max() < 0
        x = body.centre + 0.1 * rng.standard_normal((300, 3))
        for t in (0.0, 0.03):
            assert ((term.room(x, t) < 0) == (body.deep(x, t) > 0)).all()


SEED, MOST = 8, 45  # of the scenes; iterations after which a scene is left, soon after its impact


@pytest.mark.stories
@pytest.mark.parametrize(("kind", "numbers"), zip(KINDS, (5, 4, 4, 5, 4, 4, 4), strict=True))
def test_nothing_is_crossed_inside_or_lost(kind, numbers):
    """Thirty scenes; `python -m studies.evidence.contact.catalogue` has more, to their ends."""
    for number in range(numbers):
        row = watch(kind, SEED, number, MOST)
        assert row["end"] == "finished", row["message"]
        assert (row["crossings"], row["piercings"]) == (0, 0), number
        assert min(row["least"], row["least_inside"]) > 0.0, number
