"""Obstacles: force and tangent, no node inside, rest on a plane, refusals."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import flat
from scipy.spatial import cKDTree
from support.obstacles import check_slopes, near
from support.planned import warnings_before
from support.tiers import stories_except

import fecloth as fc
from fecloth.errors import InputError
from fecloth.linalg.block_matrix import BlockMatrix
from fecloth.terms.contact import barrier
from fecloth.terms.contact.inside import cutting_depth
from fecloth.terms.contact.obstacle import BoundSkeleton
from fecloth.terms.contact.points import points_of

S = fc.shapes
UP = (0, 0, 1)
STORIES = pytest.mark.stories
FABRIC = fc.Fabric(0.2, 1000.0, 0.3, bending_rigidity=1e-5)
GAP = 0.02
BELOW = {  # each has its top near (0.15, 0.1, 0)
    "plane": S.Plane((0, 0, 0), (0.1, -0.05, 1)),
    "sphere": S.Sphere((0.15, 0.1, -0.3), 0.3),
    "cylinder": S.Cylinder((0.15, 0.1, -0.2), (1, 0.2, 0), 0.2),
    "capsule": S.Capsule((0.1, 0.1, -0.2), (0.2, 0.1, -0.2), 0.2),
    "box": S.Box((0.15, 0.1, -0.1), (0.137, 0.103, 0.2)),
    "disk": S.Disk((0.15, 0.1, -0.05), (0.1, 0, 1), 0.1, 0.1),
    "sdf": S.Sdf("z - 0.02*sin(20*x)*cos(10*y) + 0.5*(x - 0.15)**2", radius=0.1),
    "turned": S.Box(
        (0.15, 0.1, -0.1), (0.217, 0.203, 0.2), rotate=fc.Rotation((0, 0, -0.1), UP, "t")
    ),
}


@pytest.fixture
def analytic(monkeypatch):
    """Without ipctk, where a box and a disk act on points of the cloth, by their distance."""
    monkeypatch.setattr("fecloth.terms.contact.obstacle.is_installed", lambda: False)


@pytest.mark.usefixtures("analytic")
@pytest.mark.parametrize("element", ["P1", "P2"])
@pytest.mark.parametrize("name", BELOW)
def test_derivatives_where_the_curvature_jumps(name, element, rng):
    """Between a face and an edge ∇²d jumps, so that no point may pass there: short differences.

    All shapes move and turn here, and are looked at later.
    """
    cloth, t = fc.Cloth.rectangle(0.3, 0.2, h=0.1, element=element), 0.4
    turn = fc.Rotation((0.1, 0, 0), (0.1, 0.2, 1), "0.5*t")
    shape = replace(BELOW[name], motion=("0.02*t", 0, "0.1*t"), rotate=turn)
    obstacle = fc.Obstacle(shape, gap=GAP, stiffness=200.0)
    system = fc.System(cloth, FABRIC, [obstacle])
    check_slopes(system, near(cloth, obstacle, t, rng.uniform(0, 6)), t, rng)


@pytest.mark.usefixtures("analytic")
@pytest.mark.parametrize("name", BELOW)
def test_the_definite_tangent_is(name, rng):
    cloth = fc.Cloth.rectangle(0.3, 0.2, h=0.1)
    obstacle = fc.Obstacle(BELOW[name], gap=GAP)
    system = fc.System(cloth, FABRIC, [fc.StVK(), obstacle])
    state = system.state(near(cloth, obstacle, 0.0, rng.uniform(0, 6)))
    J = BlockMatrix.zeros(system.pattern)
    term = system.bound[1]
    term.add_tangent(state.x, state.v, 0.0, 1.0, 0.0, J, definite=True)
    values = np.linalg.eigvalsh(J.to_scipy().toarray())
    assert values[0] > -1e-12 * values[-1]
    assert values[-1] > 0


def test_the_areas_are_those_of_the_cloth():
    """Whatever the number of points, a pressure acts on the whole area."""
    for element in ("P1", "P2"):
        cloth = fc.Cloth.disk(0.3, h=0.1, element=element)
        for gap in (0.06, 0.01, 0.002):
            obstacle = fc.Obstacle(S.Sphere((0, 0, 0), 0.1), gap=gap)
            bound = fc.System(cloth, FABRIC, [obstacle]).bound[0]
            areas = [points.areas.sum() for points in bound.points]
            assert sum(areas) == pytest.approx(cloth.area, rel=1e-12)


def test_points_of_quadratic_triangles_lie_in_the_four_triangles_between_nodes(rng):
    cloth = fc.Cloth.rectangle(0.1, 0.1, h=0.1, element="P2")
    x = np.column_stack([cloth.X, 0.05 * rng.standard_normal(len(cloth.X))])
    kinds = points_of(cloth, 4, lambda stencil: stencil)
    points = [each.values(x, np.arange(len(each.areas))) for each in kinds]
    i, j = np.array([(i, j) for i in range(3) for j in range(3 - i)]).T
    weights = np.column_stack([2 - i - j, i, j]) / 2
    triangles = cloth.cells[:, cloth.kind.parts].reshape(-1, 3)
    expected = np.einsum("pk,skc->spc", weights, x[triangles]).reshape(-1, 3)
    trees = cKDTree(np.vstack(points)), cKDTree(expected)
    for one, other in (trees, trees[::-1]):
        assert one.query(other.data)[0].max() < 1e-12


def least_distance(bound, x, t=0.0):
    """Of all points of the cloth, not only those near the obstacle."""
    if isinstance(bound, BoundSkeleton):
        return bound.body.distance(bound.place(x, t), t).min()
    pose, distances = bound.shape.pose(t), []
    for points in bound.points:
        y = pose.to_body(points.values(x, np.arange(len(points.areas))))
        distances.append(bound.shape.distance(y, t).min())
    return min(distances)


@pytest.mark.parametrize(
    "method", stories_except([fc.BackwardEuler(), fc.BDF2()], fc.BDF2()), ids=["be", "bdf2"]
)
@pytest.mark.parametrize(
    "name",
    ["plane", "sphere", *(pytest.param(n, marks=STORIES) for n in ("capsule", "box", "sdf"))],
)
def test_a_sheet_thrown_at_an_obstacle_never_enters(name, method):
    """At 3 m/s and 10 ms a node would go 30 gaps a step."""
    cloth = fc.Cloth.rectangle(0.3, 0.2, h=0.06)
    obstacle = fc.Obstacle(BELOW[name], gap=1e-3)
    system = fc.System(cloth, FABRIC, [fc.StVK(), fc.PlateBending(), fc.Gravity(), obstacle])
    start = system.state(flat(cloth) + [0, 0, 0.06], np.tile([0.0, 0, -3.0], (len(cloth.X), 1)))
    energy, least = [sum(system.energies(start).values())], []
    for state, _ in fc.march(system, method, start, dt=0.01, t_end=0.12):
        least.append(least_distance(system.bound[-1], state.x))
        energy.append(sum(system.energies(state).values()))
    assert max(energy) <= energy[0] * (1 + 1e-9)  # contact makes no energy
    assert 0 < min(least) < 1e-3  # it has met the obstacle


@pytest.mark.stories
def test_an_obstacle_that_moves_pushes_the_cloth():
    """Each by many gaps a step: a table, a disk thinner than its way in a step, a formula of t."""
    cloth = fc.Cloth.rectangle(0.3, 0.2, h=0.06)
    table = fc.Obstacle(S.Plane((0, 0, -0.01), UP, motion=("0", "0", "2*t")))
    disk = S.Disk((0.15, 0.1, 0.02), UP, 0.05, 1e-3, motion=("0", "0", "-0.5*t"))
    wave = fc.Obstacle(S.Sdf("z + 0.01 - 2*t - 0.01*sin(20*(x - t))", radius=0.2))
    for obstacle, sign in ((table, 1), (fc.Obstacle(disk), -1), (wave, 1)):
        system = fc.System(cloth, FABRIC, [fc.StVK(), fc.PlateBending(), obstacle])
        for state, _ in fc.march(system, fc.BackwardEuler(), system.rest(), dt=0.01, t_end=0.1):
            assert least_distance(system.bound[-1], state.x, state.t) > 0
        assert sign * state.v[:, 2].mean() > 0.05


def test_a_ball_does_not_dip_into_triangles_between_their_nodes():
    """Of triangles as large as the ball, no place is inside; nodes alone would let it through."""
    cloth = fc.Cloth.rectangle(0.3, 0.3, h=0.1)
    ball = fc.Obstacle(S.Sphere((0.15, 0.15, -0.04), 0.04), gap=2e-3)
    held = fc.System(cloth, FABRIC, [fc.StVK(), fc.PlateBending(), fc.Gravity(), ball], ["corners"])
    for state, _ in fc.march(held, fc.BDF2(), held.state(flat(cloth) + [0, 0, 0.01]), 0.01, 0.2):
        parts = np.array([(i, j, 20 - i - j) for i in range(21) for j in range(21 - i)]) / 20
        places = np.einsum("pa,mai->mpi", parts, state.x[cloth.triangles]).reshape(-1, 3)
        assert ball.shape.distance(places, 0.0).min() > 0
    assert ball.shape.distance(state.x, 0.0).min() > 0.01  # it lies on the insides alone


def test_a_stretched_triangle_dips_deeper_by_the_square_of_its_stretch():
    """A fast ball and P2: deeper than at rest, but not than by the stretch of that triangle."""
    cloth = fc.Cloth.rectangle(0.2, 0.2, 0.05, element="P2")
    ball = S.Sphere((0.1, 0.11, -0.018), 0.016, motion=(0, 0, "5*t"))
    fabric = fc.Fabric(0.2, 300.0, 0.3, bending_rigidity=1e-5)
    terms = [fc.StVK(), fc.PlateBending(), fc.Obstacle(ball, 1e-3)]
    system = fc.System(cloth, fabric, terms, ["boundary"])
    parts = np.array([(i, j, 16 - i - j) for i in range(17) for j in range(17 - i)]) / 16
    triangles = cloth.cells[:, cloth.kind.parts].reshape(-1, 3)

    def edges(X):
        corners = X[triangles]
        return np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)

    deepest = bound = 0.0
    for state, _ in fc.march(system, fc.BDF2(), system.rest(), 5e-3, 0.012):
        y = ball.pose(state.t).to_body(np.einsum("pa,mai->mpi", parts, state.x[triangles]))
        depth = -ball.distance(y.reshape(-1, 3), 0.0).reshape(len(triangles), -1).min(axis=1)
        stretch = (edges(state.x) / edges(cloth.X)).max(axis=1)
        deepest, bound = max((deepest, bound), (depth.max(), stretch[depth.argmax()] ** 2))
    at_rest = cutting_depth(ball, 1e-3, cloth)
    assert at_rest < deepest < bound * at_rest


@pytest.mark.usefixtures("analytic")
def test_edges_that_may_cut_into_large_triangles_are_told(small):
    """Without ipctk; with it the edges of the box act themselves."""
    box = fc.Obstacle(S.Box((0.2, 0.15, -0.5), (0.1, 0.1, 0.1)), gap=1e-4)
    for gap, told in ((1e-4, True), (2e-2, False)):
        system = fc.System(small, FABRIC, [fc.StVK(), replace(box, gap=gap)])
        words = warnings_before(system, 0.01, 0.1)
        assert any("Obstacle has edges that may cut up to" in each for each in words) == told


@pytest.mark.usefixtures("analytic")
@pytest.mark.parametrize(
    ("shape", "words"),
    [
        (S.Sphere((0.2, 0.15, -0.5), 0.05), "curves so much that it may cut"),
        (S.Sdf("sqrt(x**2 + y**2) - 0.01 + 0*z", radius=0.01), "curves so much that it may cut"),
        (
            S.Sdf("abs(z) - 0.01 + 0*x*y"),
            "no radius: its edges may cut .* or give its radius",
        ),
    ],
)
def test_only_a_shape_with_edges_is_said_to_cut_by_them(small, shape, words):
    system = fc.System(small, FABRIC, [fc.StVK(), fc.Obstacle(shape, gap=1e-5)])
    assert any(re.search(words, each) for each in warnings_before(system, 0.01, 0.1))


@pytest.mark.parametrize("gap", [1e-3, 4e-3])
def test_at_rest_on_a_plane_the_reaction_is_the_weight(gap):
    cloth = fc.Cloth.rectangle(0.3, 0.2, h=0.06)
    obstacle = fc.Obstacle(S.Plane((0, 0, 0), UP), gap=gap)
    system = fc.System(cloth, FABRIC, [fc.StVK(), fc.PlateBending(), fc.Gravity(), obstacle])
    rest = fc.equilibrium(system, system.state(flat(cloth) + [0, 0, 1.5 * gap]))
    f = np.zeros_like(rest.x)
    system.bound[-1].add_force(rest.x, rest.v, 0.0, f)
    weight = 0.2 * 9.81 * cloth.area
    np.testing.assert_allclose(f.sum(axis=0), [0, 0, weight], rtol=0, atol=1e-6 * weight)
    assert 0.8 * gap < rest.x[:, 2].min() <= rest.x[:, 2].max() < gap


SCENE = """
cloth = { shape = "rectangle", width = "30 cm", height = "20 cm", h = "10 cm" }
start = { shift = [0, 0, "2 mm"] }
time = { method = "bdf2", dt = "10 ms", t_end = "0.3 s" }
[fabric]
areal_density = "200 g/m^2"
tensile_stiffness = 1000.0
poisson_ratio = 0.3
bending_rigidity = 1e-4
[[terms]]
type = "StVK"
[[terms]]
type = "PlateBending"
[[terms]]
type = "Gravity"
[[terms]]
type = "MassDamping"
rate = 30.0
[[terms]]
type = "Obstacle"
shape = { type = "Plane", point = ["0 mm", 0, 0], normal = [0, 0, 1], motion = [0, 0, "0.01*t"] }
gap = "1 mm"
friction = 0.2
"""


@pytest.mark.filterwarnings("ignore::fecloth.errors.FeclothWarning")
def test_a_scene_with_an_obstacle(tmp_path):
    """Units, motion, the columns of observed.csv, and the words about the gap."""
    (tmp_path / "table.toml").write_text(SCENE)
    done = fc.run_scene(fc.load_scene(tmp_path / "table.toml"), tmp_path / "out")
    weight, damping = 0.2 * 9.81 * 0.06, 30.0 * 0.2 * 0.06 * 0.01
    reaction = done.observed["reaction:Obstacle.z"][-1]
    assert reaction == pytest.approx(weight + damping, rel=1e-3)
    least = done.observed["least_distance:Obstacle"]
    assert 0 < least.min() < 1e-3
    assert least[0] == pytest.approx(2e-3)
    assert done.state.x[:, 2].min() == pytest.approx(0.003 + least[-1])
    assert done.energies["work:Obstacle"][-1] > 0.9 * weight * 0.002
    assert re.search(
        r"rests 0.9\d* mm away from Obstacle, .*: an error of .* % from the gap and -",
        done.contact_in_words,
    )
    assert done.contact_in_words in (tmp_path / "out" / "run.log").read_text()
    assert done.summary["contact_in_words"] == done.contact_in_words


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ('"Plane"', r"shape.type = 'Plain': must be one of Box.*Did you mean 'Plane'\?"),
        ("point", "terms.4.shape.place = .*unknown key.*point, normal, motion, rotate"),
        ('"2 mm"', r"start: \d+ of the nodes, the deepest .*start inside the Plane.*1 mm, the gap"),
        ('"bdf2"', r'Obstacle in Newmark.*in scenes method = "bdf2", or Auto'),
    ],
)
def test_mistakes_in_a_scene_are_named(tmp_path, wrong, words):
    right = {'"Plane"': '"Plain"', "point": "place", '"2 mm"': '"-2 mm"', '"bdf2"': '"newmark"'}
    (tmp_path / "wrong.toml").write_text(SCENE.replace(wrong, right[wrong], 1))
    with pytest.raises(InputError, match=words):
        fc.load_scene(tmp_path / "wrong.toml").build()


@pytest.mark.filterwarnings("ignore::fecloth.errors.FeclothWarning")
def test_auto_takes_bdf2(small):
    system = fc.System(
        small, FABRIC, [fc.StVK(), fc.Gravity(), fc.Obstacle(S.Plane((0, 0, -0.01), UP))]
    )
    result = fc.run(system, fc.Auto(rtol=0.05), system.rest(), t_end=0.06)
    assert isinstance(result.method.method, fc.BDF2)
    assert result.state.x[:, 2].min() > -0.01


def test_a_start_inside_is_refused_with_the_nodes(small):
    ball = fc.Obstacle(S.Sphere((0.2, 0.15, 0), 0.06))
    system = fc.System(small, FABRIC, [fc.StVK(), ball])
    words = r"1 of the nodes, the deepest \d+ \(\d.* mm\), start inside the Sphere.*gap, away"
    x = flat(small)
    x[0] = 0.2, 0.15, 0.02
    only = [0]
    x[1:, 2] += 0.5
    assert ball.shape.distance(x[only], 0.0) < 0
    for call in (
        lambda: fc.run(system, fc.BDF2(), system.state(x), dt=0.01, t_end=0.1),
        lambda: fc.equilibrium(system, system.state(x)),
    ):
        with pytest.raises(InputError, match=words):
            call()


@pytest.mark.parametrize("function", ["pressure", "curvature"])
def test_the_barrier_has_these_derivatives(function):
    s, h = np.linspace(0.05, 0.99, 50), 1e-6
    of = {"pressure": barrier.value, "curvature": barrier.pressure}[function]
    slope = -(of(s + h) - of(s - h)) / (2 * h)
    np.testing.assert_allclose(getattr(barrier, function)(s), slope, rtol=1e-6, atol=1e-9)
    assert (getattr(barrier, function)(s) > 0).all()
    assert barrier.value(np.array([0.0, -1.0])).tolist() == [np.inf, np.inf]


@pytest.mark.filterwarnings("ignore::fecloth.errors.FeclothWarning")
def test_the_scene_of_the_page_runs(tmp_path):
    page = Path(fc.__file__).parent / "terms" / "contact" / "README.md"
    computed = re.findall(r"```\w+\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)
    python, toml, pieces = computed
    exec(python, {})
    pytest.importorskip("ipctk")
    exec("import fecloth as fc\n" + pieces, {})
    (tmp_path / "drop.toml").write_text(toml.replace('"4 cm"', '"8 cm"').replace("0.2 s", "0.05 s"))
    scene = fc.load_scene(tmp_path / "drop.toml")
    assert isinstance(scene.build().system.terms[-1].shape, S.Sphere)
    assert fc.run_scene(scene, tmp_path / "out").status == "done"
