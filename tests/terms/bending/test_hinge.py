"""Hinge bending: derivatives, closed forms, orthotropy, the homogenised tensor, damping."""

import numpy as np
import pytest
from conftest import flat, rough

import fecloth as fc
from fecloth.homogenisation import CELLS, bending_tensor, strip_rigidity
from fecloth.runs.run_scene import run_scene
from fecloth.scene.scene import load_scene
from fecloth.terms.bending.hinge import hinge_angles, hinge_stiffness
from fecloth.verify import check_term

# steps are coarse and meshes small by intent
pytestmark = pytest.mark.filterwarnings("ignore::fecloth.errors.FeclothWarning")

B = 3e-5
PATTERNS = ["unstructured", "right", "cross", "equilateral"]


@pytest.fixture(scope="module")
def woven():
    return fc.Fabric(0.15, (2000.0, 900.0), 0.2, 60.0, bending_rigidity=(4e-5, 1e-5))


def pair(fold, X=((0.0, -0.1), (0.0, 0.2), (-0.3, 0.0), (0.4, 0.1))):
    """Two triangles at the edge from node 0 to 1, the right one raised by the angle `fold`."""
    X = np.array(X)
    cloth = fc.Cloth.from_arrays(X, [[0, 1, 2], [1, 0, 3]], renumber=False)
    x = flat(cloth)
    x[3] = [X[3, 0] * np.cos(fold), X[3, 1], X[3, 0] * np.sin(fold)]
    return cloth, x


# --- the angle ------------------------------------------------------------------------------------


@pytest.mark.parametrize("fold", [0.0, 1e-9, 0.3, -1.0, 2.0, 3.1, -3.13])
def test_the_angle_is_the_fold(fold, rng):
    cloth, x = pair(fold)
    turn, _ = np.linalg.qr(rng.standard_normal((3, 3)))
    turn *= np.linalg.det(turn)
    assert hinge_angles(cloth, x @ turn + 2.0)[0] == pytest.approx(fold, rel=1e-12, abs=1e-14)


@pytest.mark.parametrize("pattern", PATTERNS)
def test_hinges_are_the_interior_edges(pattern):
    cloth = fc.Cloth.rectangle(1.0, 0.6, h=0.1, pattern=pattern)
    hinges = cloth.hinges
    count = (3 * len(cloth.triangles) - len(cloth.edge_sets["boundary"])) // 2
    edges = np.sort(hinges.nodes[:, :2], axis=1)
    assert len(np.unique(edges, axis=0)) == len(edges) == count
    for side, (p, q, r) in enumerate([(0, 1, 2), (1, 0, 3)]):
        own = cloth.triangles[hinges.sides[:, side]]
        expected = hinges.nodes[:, [p, q, r]]
        turned = [(np.roll(own, s, axis=1) == expected).all(axis=1) for s in range(3)]
        assert np.any(turned, axis=0).all()  # the same triangle, in the same sense


# --- the energy -----------------------------------------------------------------------------------


@pytest.mark.parametrize(("fold", "rest"), [(0.4, None), (-1.2, 0.3), (3.0, (-0.5,))])
def test_energy_of_one_hinge(fold, rest):
    cloth, x = pair(fold)
    system = fc.System(cloth, fc.Fabric(0.2, 1.0, bending_rigidity=B), [fc.HingeBending(rest)])
    rest = 0.0 if rest is None else np.ravel(rest)[0]
    area = 0.5 * 0.3 * (0.3 + 0.4)
    expected = 0.5 * B * 0.3**2 / area * (fold - rest) ** 2
    assert system.energies(system.state(x))["HingeBending"] == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("fold", [0.0, 1e-6, 3.0])
def test_derivatives_flat_and_nearly_folded(fold, rng):
    cloth, x = pair(fold)
    fabric = fc.Fabric(0.2, 1.0, bending_rigidity=B)
    check_term(fc.HingeBending(0.1), cloth, fabric, [("fold", x, 0 * x)], scales=(1e-3, 1.0, 1e3))


# --- orthotropy, grain, regions -------------------------------------------------------------------


@pytest.mark.parametrize("grain", [0.0, 0.4, np.pi / 4, np.pi / 2, -1.2])
def test_rigidity_across_the_edge(grain):
    """The normal of the edge makes the angle 0.3 with X, and so 0.3 − grain with the warp."""
    c, s = np.cos(0.3), np.sin(0.3)
    X = np.array([[0.0, -0.1], [0.0, 0.2], [-0.3, 0.0], [0.4, 0.1]]) @ [[c, s], [-s, c]]
    cloth, _ = pair(0.0, X)
    fabric = fc.Fabric(0.2, 1.0, bending_rigidity=(4e-5, 1e-5))
    panel = fc.System(cloth, fabric, [], grain=grain).panel
    c, s = np.cos(0.3 - grain), np.sin(0.3 - grain)
    rigidity = 4e-5 * c**4 + 1e-5 * s**4 + 2 * 2e-5 * c**2 * s**2
    area = 0.5 * 0.3 * (0.3 + 0.4)
    assert hinge_stiffness(panel, "")[0] == pytest.approx(rigidity * 0.3**2 / area, rel=1e-13)


def test_two_fabrics_bend_in_series():
    """Under one moment M the turns h_i/2 · M/B_i of the two sides add up to θ."""
    X = np.array([[0.0, -0.1], [0.0, 0.2], [-0.3, 0.0], [0.4, 0.1]])
    regions = {"a": [0], "b": [1]}
    cloth = fc.Cloth.from_arrays(X, [[0, 1, 2], [1, 0, 3]], renumber=False, regions=regions)
    stiff, soft = (fc.Fabric(0.2, 1.0, bending_rigidity=b) for b in (5e-5, 1e-5))
    panel = fc.System(cloth, {"a": stiff, "b": soft}, []).panel
    flexibility = 0.5 * 0.3 / 5e-5 + 0.5 * 0.4 / 1e-5  # θ per moment and length of the edge
    assert hinge_stiffness(panel, "")[0] == pytest.approx(0.3 / flexibility, rel=1e-13)


# --- what the model is on a pattern ---------------------------------------------------------------

# ½ B [(κ11 + κ12)² + (κ22 + κ12)² + 4 κ12²]; ½ B [(κ11 − κ22)² + (κ11 + κ22)²/3 + 2 κ12²] after the
# middle node has moved by (κ11 + κ22) h²/24; ½ B Σ (κ_nn − κ_tt/3)² over three directions
CLOSED = {
    "right": [[1, 0, 1 / 2], [0, 1, 1 / 2], [1 / 2, 1 / 2, 3 / 2]],
    "cross": [[4 / 3, -2 / 3, 0], [-2 / 3, 4 / 3, 0], [0, 0, 1 / 2]],
    "equilateral": [[1, -1 / 3, 0], [-1 / 3, 1, 0], [0, 0, 2 / 3]],
}


@pytest.mark.parametrize("pattern", CELLS)
def test_bending_tensor(pattern):
    np.testing.assert_allclose(
        bending_tensor(pattern, B), B * np.array(CLOSED[pattern]), atol=1e-10 * B
    )


@pytest.mark.parametrize("pattern", CELLS)
@pytest.mark.parametrize("across", [1, 2, 7])
def test_free_strip_does_not_depend_on_its_width(pattern, across):
    free = {"right": 4 / 5, "cross": 1.0, "equilateral": 8 / 9}[pattern]
    assert 1 / np.linalg.inv(bending_tensor(pattern))[0, 0] == pytest.approx(free, rel=1e-10)
    assert strip_rigidity(pattern, across) == pytest.approx(free, rel=1e-10)


def test_orthotropic_tensor():
    """On `right` the three edges bend the cloth along X, Y and a diagonal: (κ11 + κ12)² B₁, …"""
    warp, weft = 4.0, 1.0
    bias = (0.5 * np.sqrt(warp) + 0.5 * np.sqrt(weft)) ** 2
    rows = np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1]])  # of κ11, κ22, 2 κ12
    expected = rows.T @ np.diag([warp, weft, bias]) @ rows
    np.testing.assert_allclose(bending_tensor("right", (warp, weft)), expected, atol=1e-10)


AREA = "area = { value = 0.5, relative = 0.1 }"
STRIP = """
[cloth]
shape = "rectangle"
width = 1.0
height = 0.5
h = 0.25
pattern = "{}"

[fabric]
areal_density = 0.2
tensile_stiffness = 100.0
bending_rigidity = 1e-4

[[terms]]
type = "{}"

[time]
method = "backward_euler"
dt = 0.1
t_end = 0.1

[expect]
{}
"""


@pytest.mark.parametrize(
    ("pattern", "term", "expect", "said"),
    [
        ("cross", "HingeBending", AREA, "1.00 B (narrow strip)"),
        ("cross", "QuadraticBending", AREA, "to 1.33 B (wide)"),
        ("cross", "HingeBending", "", ""),
        ("unstructured", "HingeBending", AREA, ""),
        ("cross", "StVK", AREA, ""),
    ],
)
def test_scene_reports_the_bending_bias_of_its_pattern(tmp_path, pattern, term, expect, said):
    file = tmp_path / "strip.toml"
    file.write_text(STRIP.format(pattern, term, expect))
    run_scene(load_scene(file), tmp_path / "out")
    log = (tmp_path / "out" / "run.log").read_text()
    assert ("bends along X" in log) == bool(said)
    assert said in log


# --- damping --------------------------------------------------------------------------------------


def test_damping_force_is_on_the_angle_rate(sheet, woven, rng):
    x, v = rough(sheet, rng), rng.standard_normal((len(sheet.X), 3))
    system = fc.System(sheet, woven, [fc.BendingDamping(0.02)])
    rate = (hinge_angles(sheet, x + 1e-6 * v) - hinge_angles(sheet, x - 1e-6 * v)) / 2e-6
    power = system.bound[0].power(x, v, 0.0)
    assert power == pytest.approx(0.02 * hinge_stiffness(system.panel, "") @ rate**2, rel=1e-6)


@pytest.mark.stories
def test_decay_of_one_mode():
    """A free hinge swings as θ̈ = −ω² (θ + τ θ̇): exp(−τω²t/2) cos(ω√(1 − ζ²) t + …), ζ = ω τ/2.

    The fold ±h at the two sides of a line that is held is the mode; each apex of mass m at the
    height h from the line has the inertia m h², and θ is twice its turn.
    """
    X = np.array([[0.0, -0.1], [0.0, 0.1], [-0.2, 0.0], [0.2, 0.0]])
    cloth = fc.Cloth.from_arrays(X, [[0, 1, 2], [1, 0, 3]], renumber=False)
    fabric = fc.Fabric(0.3, 1.0, bending_rigidity=2e-4)
    k = 2e-4 * 0.2**2 / (2 * 0.02)
    m, h = 0.3 * 0.02 / 3, 0.2
    omega = np.sqrt(k * 4 / (2 * m * h**2))  # ½ 2 m h² φ̇² and ½ k (2φ)²
    zeta = 0.2
    tau = 2 * zeta / omega
    terms = [fc.HingeBending(), fc.BendingDamping(tau)]
    system = fc.System(cloth, fabric, terms, pins=[fc.Pin([0, 1])])
    start = 1e-5
    x = flat(cloth)
    x[2:, 2] = start * h
    period = 2 * np.pi / (omega * np.sqrt(1 - zeta**2))
    result = fc.run(system, fc.ImplicitMidpoint(), system.state(x), period / 400, period)
    decay = np.exp(-2 * np.pi * zeta / np.sqrt(1 - zeta**2))
    assert hinge_angles(cloth, result.state.x)[0] / (2 * start) == pytest.approx(decay, rel=1e-3)
