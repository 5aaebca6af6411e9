"""Distances, force per width, drape coefficient and folds: closed forms, studies, refusals."""

import math

import numpy as np
import pytest

import fecloth as fc
from fecloth.scene.scene import load_scene
from fecloth.simulation.on_request import grip_width, shadow_area, support_area
from fecloth.simulation.probes import Observer
from fecloth.simulation.quantity import parse_quantity
from fecloth.system.state import State

DISC = fc.Cloth.disk(1.0, h=0.15)
HELD = 0.4  # radius of the support


def observed(cloth, x, names, terms=(), pins=()):
    """The row of a cloth at positions x."""
    system = fc.System(cloth, fc.Fabric(0.2, 1000.0), [fc.StVK(), *terms], pins=list(pins))
    observer = Observer.bind(system, system.rest(), names)
    return observer.row_at_rest(State(0.0, x, np.zeros_like(x)))


def lifted(cloth, height, radius=None):
    """Positions (R cos θ, R sin θ, z) of the nodes of a disc, from functions of r and θ."""
    r, theta = np.linalg.norm(cloth.X, axis=1), np.arctan2(cloth.X[:, 1], cloth.X[:, 0])
    R = r if radius is None else radius(r, theta)
    return np.column_stack([R * np.cos(theta), R * np.sin(theta), height(r, theta)])


# --- the shadow -----------------------------------------------------------------------------------


@pytest.mark.parametrize("turn", [0.0, 0.3, math.pi / 4])
def test_the_shadow_of_a_tilted_square_is_its_area_times_the_cosine(turn):
    cloth = fc.Cloth.rectangle(1.0, 1.0, h=0.25, pattern="right")
    X = cloth.X @ np.array([[math.cos(turn), math.sin(turn)], [-math.sin(turn), math.cos(turn)]])
    tilt = 0.7
    x = np.column_stack([X[:, 0], X[:, 1] * math.cos(tilt), X[:, 1] * math.sin(tilt)])
    assert shadow_area(cloth.triangles, x) == pytest.approx(math.cos(tilt), rel=2e-6)


def test_layers_over_one_another_count_once():
    """A square of 1 m folded at X = 0.75 m, its flap above it: 0.75 m². And two crossing strips."""
    cloth = fc.Cloth.rectangle(1.0, 1.0, h=0.25, pattern="right")
    X = np.where(cloth.X[:, 0] > 0.75, 1.5 - cloth.X[:, 0], cloth.X[:, 0])
    folded = np.column_stack([X, cloth.X[:, 1], 0.1 * (cloth.X[:, 0] > 0.75)])
    assert shadow_area(cloth.triangles, folded) == pytest.approx(0.75, rel=1e-9)
    first = [[-2, -0.5], [2, -0.5], [2, 0.5], [-2, 0.5]]
    x = np.array([*first, *np.array(first)[:, ::-1]], float)
    quads = np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]])
    crossing = shadow_area(quads, np.column_stack([x, np.zeros(8)]))
    assert crossing == pytest.approx(4 + 4 - 1, rel=2e-3)  # edges along the lines: order 1
    turned = x @ np.array([[0.8, 0.6], [-0.6, 0.8]])
    assert shadow_area(quads, np.column_stack([turned, np.zeros(8)])) == pytest.approx(7, rel=1e-5)


# --- drape ----------------------------------------------------------------------------------------


def inside(X):
    return np.hypot(X[:, 0], X[:, 1]) <= HELD + 1e-9


def drape(x, cloth=DISC, **more):
    return observed(cloth, x, ["drape_coefficient", "folds"], **{"pins": [fc.Pin(inside)], **more})


@pytest.mark.parametrize("shape", ["plate", "cylinder"])
def test_a_cone_over_an_obstacle(shape):
    """Beyond the support the cloth slopes by α, so that its rim is at R₀ + (R − R₀) cos α."""
    alpha, plate = 1.0, fc.shapes.Disk((0, 0, -0.01), (0, 0, -2.0), HELD, 0.02)
    body = plate if shape == "plate" else fc.shapes.Cylinder((0, 0, 0), (0, 0, 1), HELD)
    slope = lambda r, theta: np.where(r > HELD, HELD + (r - HELD) * math.cos(alpha), r)  # noqa: E731
    x = lifted(DISC, lambda r, theta: -np.maximum(r - HELD, 0) * math.sin(alpha), slope)
    rim, support = HELD + (1 - HELD) * math.cos(alpha), math.pi * HELD**2
    expected = (DISC.area * rim**2 - support) / (DISC.area - support)  # of the polygon
    result = drape(x, pins=(), terms=[fc.Obstacle(body)])["drape_coefficient"]
    assert result == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize(("part", "counts"), [(0.8, True), (1.25, False)])
def test_only_upright_obstacles_are_supports(part, counts):
    """Up to a tilt whose cosine is 0.999; a leaning cylinder leaves nothing that holds the disc."""
    tilt = part * math.acos(0.999)
    body = fc.shapes.Cylinder((0, 0, 0), (0, math.sin(tilt), math.cos(tilt)), HELD)
    system = fc.System(DISC, fc.Fabric(0.2, 1000.0), [fc.StVK(), fc.Obstacle(body)])
    assert support_area(system) == pytest.approx(math.pi * HELD**2 if counts else 0.0)


def test_a_ring_stands_for_a_disc_whose_middle_is_held():
    """A cone, and below it a fold inwards under the support, which covers nothing more."""
    radius = np.linalg.norm(DISC.X[DISC.triangles], axis=2)
    nodes, triangles = np.unique(DISC.triangles[radius.max(axis=1) > HELD], return_inverse=True)
    ring = fc.Cloth.from_arrays(DISC.X[nodes], triangles.reshape(-1, 3))
    inner = [fc.Pin(inside)]
    for cosine in (0.5, -0.5):
        slope = lambda r, theta: np.where(r > HELD, HELD + (r - HELD) * cosine, r)  # noqa: B023,E731
        rows = [
            observed(
                cloth,
                lifted(cloth, lambda r, theta: 0 * r, slope),
                ["drape_coefficient"],
                pins=inner,
            )
            for cloth in (DISC, ring)
        ]
        whole, part = (row["drape_coefficient"] for row in rows)
        assert part == pytest.approx(whole, abs=1e-5)
    flat = observed(ring, lifted(ring, lambda r, theta: 0 * r), ["drape_coefficient"], pins=inner)
    assert flat["drape_coefficient"] == pytest.approx(1.0, abs=1e-5)


@pytest.mark.parametrize("n", [2, 5, 7])
def test_waves_of_the_rim(n):
    """The rim ρ(θ) = ρ₀ + a cos nθ has the area π (ρ₀² + a²/2), and n folds."""
    a, middle = 0.1, 0.8
    cloth = fc.Cloth.disk(1.0, h=0.05)
    waves = lambda r, theta: r * (middle + a * np.cos(n * theta))  # noqa: E731
    x = lifted(cloth, lambda r, theta: -0.3 * r**2 * (1 - np.cos(n * theta)), waves)
    row = drape(x, cloth)
    system = fc.System(cloth, fc.Fabric(0.2, 1000.0), [fc.StVK()], pins=[fc.Pin(inside)])
    support = support_area(system)
    assert 0.85 * math.pi * HELD**2 < support < math.pi * HELD**2  # whole triangles
    expected = (math.pi * (middle**2 + a**2 / 2) - support) / (cloth.area - support)
    assert row["folds"] == n
    assert row["drape_coefficient"] == pytest.approx(expected, rel=5e-3)


@pytest.mark.parametrize(("amplitude", "folds"), [(0.8, 0.0), (1.25, 4.0)])
def test_waves_below_a_hundredth_of_the_radius_are_no_folds(amplitude, folds):
    tilt = lambda r, theta: 0.2 * r * np.cos(theta)  # noqa: E731  # which is no fold
    x = lifted(DISC, lambda r, theta: tilt(r, theta) + 0.01 * amplitude * np.cos(4 * theta))
    assert drape(x)["folds"] == folds


def test_a_hole_in_the_middle_does_not_count_as_rim():
    cloth = fc.Cloth.disk(1.0, h=0.15)
    middle = np.linalg.norm(cloth.X[cloth.triangles].mean(axis=1), axis=1)
    nodes, triangles = np.unique(cloth.triangles[middle > 0.6], return_inverse=True)
    ring = fc.Cloth.from_arrays(cloth.X[nodes], triangles.reshape(-1, 3))
    x = lifted(ring, lambda r, theta: np.where(r > 0.8, 0.1 * np.cos(3 * theta), np.cos(8 * theta)))
    assert observed(ring, x, ["folds"])["folds"] == 3.0


# --- force per width ------------------------------------------------------------------------------


def pulled(stretch, pins, cloth):
    system = fc.System(cloth, fc.Fabric(0.2, 800.0, 0.0), [fc.StVK()], pins=pins)
    x = np.column_stack([stretch * cloth.X[:, 0], cloth.X[:, 1], 0 * cloth.X[:, 0]])
    observer = Observer.bind(system, system.rest(), ["line_force.right.x", "line_force:left"])
    return observer.row_at_rest(State(0.0, x, np.zeros_like(x)))


@pytest.mark.parametrize("element", ["P1", "P2"])
def test_force_per_width_of_a_strip_is_that_of_its_law(element):
    """P = λ Y (λ² − 1)/2 of StVK with ν = 0 [N/m], whatever the width."""
    cloth = fc.Cloth.rectangle(1.0, 0.3, h=0.1, pattern="right", element=element)
    row = pulled(1.1, ["left", "right"], cloth)
    force = 1.1 * 800 * (1.1**2 - 1) / 2
    assert row["line_force:right.x"] == pytest.approx(force, rel=1e-9)
    assert row["line_force:left.x"] == pytest.approx(-force, rel=1e-9)
    assert row["line_force:left.y"] == pytest.approx(0.0, abs=1e-9)


def test_the_width_of_a_grip_is_where_it_meets_free_cloth():
    cloth = fc.Cloth.rectangle(1.0, 0.3, h=0.1, pattern="right")
    pins = [
        fc.Pin(lambda X: X[:, 0] < 0.21, name="jaw"),  # an area: its inner edge
        fc.Pin(lambda X: abs(X[:, 0] - 0.5) < 0.01, name="line"),  # a line, once
        fc.Pin(lambda X: (X[:, 0] > 0.99) & (X[:, 1] > 0.19), name="corner"),
    ]
    system = fc.System(cloth, fc.Fabric(0.2, 800.0), [fc.StVK()], pins=pins)
    for name, width in {"jaw": 0.3, "line": 0.3, "corner": 0.1}.items():
        assert grip_width(system, name) == pytest.approx(width)


# --- in the grammar -------------------------------------------------------------------------------

SCENE = """
[cloth]
shape = "rectangle"
width = 1.0
height = 0.25
h = 0.25
pattern = "right"
[fabric]
areal_density = 0.2
tensile_stiffness = 1000.0
[[terms]]
type = "StVK"
[[pins]]
where = "left"
[[pins]]
where = "right"
motion = ["0.1 * t", "0", "0"]
[[probes]]
name = "left edge"
where = "left"
[[probes]]
name = "grip"
where = "right"
[equilibrium]
load_steps = 2
"""
FORCE = 1.1 * 1000 * (1.1**2 - 1) / 2  # ν = 0


@pytest.fixture
def scene(tmp_path):
    def write(more):
        (tmp_path / "strip.toml").write_text(SCENE + more, encoding="utf-8")
        return load_scene(tmp_path / "strip.toml")

    return write


@pytest.mark.stories
def test_a_scene_has_the_columns_that_it_names_and_no_others(scene, tmp_path):
    expected = """[expect]
"distance of left edge and grip" = { value = 1.1, relative = 1e-9 }
"line_force:right.x" = { value = 115.5, relative = 1e-6 }
"""
    named = scene(expected)
    result = fc.run_scene(named, tmp_path / "named")
    assert result.observed["distance of left edge and grip"] == pytest.approx([1, 1.05, 1.1])
    assert result.observed["line_force:right.x"][-1] == pytest.approx(FORCE)
    plain = fc.run_scene(scene(""), tmp_path / "plain")
    more = set(result.observed) - set(plain.observed)
    assert more == {"distance of left edge and grip", *(f"line_force:right.{c}" for c in "xyz")}


def test_the_column_of_a_force_per_width():
    assert parse_quantity("line_force.grip.x at 0.3 s").column == "line_force:grip.x"
