"""Quadratic triangles: the kernels on six nodes and six points, and the orders of convergence."""

import os
import subprocess
import sys
from pathlib import Path

import meshio
import numpy as np
import pytest
import scipy.linalg
import skfem
from support import oracle

import fecloth as fc
from fecloth.cli.main import main
from fecloth.mesh.elements import add_midpoints
from fecloth.mesh.flat_mesh import FlatMesh
from fecloth.output.frames import read_frame
from fecloth.runs import run_scene, warm_up
from fecloth.scene.scene import load_scene
from fecloth.stability.critical_step import critical_dt, element_bound
from fecloth.terms.kinematics import principal_stretches
from fecloth.verify import check_term, observed_order, trial_states

FABRIC = fc.Fabric(0.2, (1000.0, 600.0), 0.3, 150.0)
STATES = ["random", "compressed", "nearly degenerate"]


@pytest.fixture(scope="module")
def cloth():
    return fc.Cloth.rectangle(0.3, 0.2, h=0.1, element="P2")


def system_on(cloth, terms=None, **options):
    return fc.System(cloth, FABRIC, [fc.StVK()] if terms is None else terms, **options)


def close(a, b, tolerance=1e-12):
    assert np.abs(a - b).max() <= tolerance * np.abs(b).max()


# --- nodes and sets -------------------------------------------------------------------------------


def test_nodes_are_the_corners_and_the_middles_of_the_edges(cloth):
    linear = fc.Cloth.rectangle(0.3, 0.2, h=0.1)
    corners = len(linear.X)
    assert np.array_equal(cloth.X[:corners], linear.X)
    assert np.array_equal(cloth.triangles, linear.triangles)
    edges = {
        frozenset(pair) for t in linear.triangles for pair in zip(t, np.roll(t, 1), strict=True)
    }
    assert len(cloth.X) == corners + len(edges)
    middles = {tuple(np.round(linear.X[list(edge)].mean(axis=0), 12)) for edge in edges}
    assert {tuple(x) for x in np.round(cloth.X[corners:], 12)} == middles
    assert (cloth.source_nodes[corners:] == -1).all()
    assert np.array_equal(cloth.source_nodes[:corners], linear.source_nodes)


def test_the_orders_of_a_triangles_nodes(cloth):
    """Three corners, then the midpoints of 01, 12, 20; `cells` is counter-clockwise."""
    for nodes in (cloth.stencil, cloth.cells):
        assert nodes.shape == (len(cloth.triangles), 6)
        x = cloth.X[nodes]
        for a, b, middle in ((0, 1, 3), (1, 2, 4), (2, 0, 5)):
            np.testing.assert_allclose(x[:, middle], (x[:, a] + x[:, b]) / 2, atol=1e-15)
    assert np.array_equal(cloth.cells[:, :3], cloth.triangles)
    assert (np.sort(cloth.cells, axis=1) == np.sort(cloth.stencil, axis=1)).all()


@pytest.mark.parametrize("h", [0.1, 0.2])
@pytest.mark.parametrize("pattern", ["unstructured", "right"])
def test_sets_contain_their_midpoints(pattern, h):
    cloth = fc.Cloth.rectangle(0.3, 0.2, h, pattern, element="P2")
    x, y = cloth.X.T
    on = {"left": x < 1e-9, "right": x > 0.3 - 1e-9, "bottom": y < 1e-9, "top": y > 0.2 - 1e-9}
    for name, inside in on.items():
        assert cloth.nodes(name).tolist() == np.flatnonzero(inside).tolist()
    border = np.flatnonzero(np.any(list(on.values()), axis=0))
    assert cloth.nodes("boundary").tolist() == border.tolist()
    assert len(cloth.nodes("corners")) == 4
    assert cloth.nodes(lambda X: X[:, 0] < 1e-9).tolist() == cloth.nodes("left").tolist()


def test_sets_of_input_arrays_get_their_midpoints():
    """A curve gets its own midpoints; another set gets those between two of its nodes."""
    X = [(0, 0), (1, 0), (2, 0), (0, 1), (1, 1), (2, 1)]
    triangles = [(0, 1, 4), (0, 4, 3), (1, 2, 5), (1, 5, 4)]
    cloth = fc.Cloth.from_arrays(
        X, triangles, {"foot": [0, 1, 2], "two": [0, 5]}, regions={"west": [0, 1]}, element="P2"
    )
    at = {name: sorted(map(tuple, cloth.X[cloth.nodes(name)])) for name in ("foot", "two")}
    assert at["foot"] == [(0, 0), (0.5, 0), (1, 0), (1.5, 0), (2, 0)]
    assert at["two"] == [(0, 0), (2, 1)]
    assert len(cloth.nodes("boundary")) == 12
    assert len(cloth.region("west")) == 2


def test_sets_of_a_mesh_file_get_their_midpoints():
    """An open curve of k nodes has k − 1 midpoints, a closed one k, a region those of its edges."""
    file = Path(__file__).parents[2] / "meshes" / "panel.geo"
    linear, cloth = (fc.Cloth.read(file, 0.1, element=name) for name in ("P1", "P2"))
    count = {name: len(linear.nodes(name)) for name in linear.node_sets}
    assert len(cloth.nodes("hem")) == 2 * count["hem"] - 1
    assert len(cloth.nodes("neck")) == 2 * count["neck"]
    assert len(cloth.nodes("boundary")) == 2 * count["boundary"]
    assert cloth.nodes("sheet").tolist() == list(range(len(cloth.X)))
    west = [
        [0, 1, 4],
        [0, 4, 3],
    ]  # next to an edge of "west" nodes that is not one of its triangles
    X = [(0, 0), (1, 0), (2, 0), (0, 1), (1, 1), (2, 1), (0.5, -1)]
    mesh = FlatMesh.from_arrays(
        X,
        [*west, [1, 2, 5], [1, 5, 4], [6, 2, 1], [0, 6, 1]],
        {"west": [0, 1, 3, 4, 6]},
        triangle_sets={"west": [0, 1]},
        where="test",
    )
    middles = {
        tuple(x) for x in add_midpoints(mesh).X[add_midpoints(mesh).node_sets["west"]]
    } - set(X)
    assert middles == {(0.5, 0), (1, 0.5), (0.5, 0.5), (0.5, 1), (0, 0.5)}


def test_pin_fixes_the_midpoints(cloth):
    system = system_on(cloth, [fc.StVK(), fc.Gravity()], pins=["left"])
    start = system.state(system.rest().x * [1.05, 1.02, 1.0])
    end = fc.run(system, fc.BackwardEuler(), start, dt=0.01, t_end=0.03).state
    assert np.array_equal(end.x[cloth.nodes("left")], start.x[cloth.nodes("left")])
    assert (np.abs(end.x[cloth.nodes("right"), 2]) > 1e-4).all()


# --- kernels, mass and load -----------------------------------------------------------------------


@pytest.mark.parametrize("number", range(3), ids=STATES)
def test_kernels_equal_the_form(cloth, number):
    system, C = system_on(cloth, [fc.StVK(strain="pointwise")]), FABRIC.moduli()
    _, x, v = trial_states(cloth)[number]
    state = system.state(x, v)
    assert system.energies(state)["StVK"] == pytest.approx(oracle.energy(cloth, C, x), rel=1e-12)
    close(system.force(state), oracle.force(cloth, C, x))
    close(system.stiffness(state).toarray(), oracle.stiffness(cloth, C, x).toarray())
    damped = system_on(cloth, [fc.StrainRateDamping(0.01, strain="pointwise")])
    close(damped.force(state), oracle.viscous_force(cloth, 0.01 * C, x, v))


@pytest.mark.parametrize(
    "term",
    [
        fc.StVK(),
        fc.TensorCondition(250.0),
        fc.StrainRateDamping(0.01, tangent="exact"),
        fc.MassDamping(3.0),
        fc.UserForce(("-50 * x", "sin(9 * y)", "-3 * vz"), tangent="exact"),
        fc.Pressure(300.0, tangent="exact"),
    ],
    ids=lambda term: type(term).__name__,
)
def test_terms_have_the_right_derivatives(cloth, term):
    fabric = fc.Fabric(0.2, 1000.0, 0.3)
    tangents = (
        "v" if isinstance(term, fc.MassDamping) else ("x", "v") if hasattr(term, "tangent") else "x"
    )
    assert check_term(term, cloth, fabric, scales=[1.0], tangents=tangents)


@pytest.mark.parametrize(
    "term",
    [fc.NeoHookean(), fc.NeoHookean("compressible"), fc.TensionField()],
    ids=repr,
)
def test_laws_undefined_for_degenerate_triangles_have_the_right_derivatives(cloth, term, rng):
    pull = np.array([[2.0, 0.1], [0.2, 1.9], [0.1, 0.3]])
    x = cloth.X @ pull.T + 0.002 * rng.standard_normal((len(cloth.X), 3))
    states = [("taut", x, np.zeros_like(x))]
    assert check_term(term, cloth, fc.Fabric(0.2, 1000.0, 0.3), scales=[1.0], states=states)


def test_an_affine_motion_is_exact(cloth):
    """F, area and energy in closed form, and no force on a node that is not on the border."""
    F = np.array([[1.1, 0.2], [-0.1, 0.9], [0.3, 0.1]])
    x = cloth.X @ F.T
    system = system_on(cloth)
    E = (F.T @ F - np.eye(2)) / 2
    C11, C22, C66, C12, _, _ = FABRIC.moduli()
    W = (C11 * E[0, 0] ** 2 + C22 * E[1, 1] ** 2) / 2 + C12 * E[0, 0] * E[1, 1]
    W += 2 * C66 * E[0, 1] ** 2
    state = system.state(x)
    assert system.energies(state)["StVK"] == pytest.approx(0.06 * W, rel=1e-12)
    f = system.force(state)
    inside = np.setdiff1d(np.arange(len(cloth.X)), cloth.nodes("boundary"))
    assert np.abs(f[inside]).max() < 1e-12 * np.abs(f).max()
    stretches = np.sqrt(np.linalg.eigvalsh(F.T @ F))
    computed = principal_stretches(cloth, x)
    np.testing.assert_allclose(computed, np.tile(stretches, (len(computed), 1)), rtol=1e-12)


def test_the_patch_test():
    """If the border has an affine displacement, equilibrium is affine at all inner nodes."""
    cloth = fc.Cloth.rectangle(1.0, 0.7, h=0.25, element="P2")
    F = np.array([[1.2, 0.1], [0.05, 1.1], [0.2, 0.0]])
    x = cloth.X @ F.T
    noise = 0.02 * np.random.default_rng(3).standard_normal(x.shape)
    noise[cloth.nodes("boundary")] = 0
    system = system_on(cloth, pins=["boundary"])
    end = fc.equilibrium(system, system.state(x + noise))
    assert np.abs(end.x - x).max() < 1e-8


def test_mass_and_load(cloth):
    """∫ N_a N_b of a triangle of area 1: 6, −1, −4, 32 and 16 over 180; ∫ N_a: 0 and 1/3."""
    one = fc.Cloth.from_arrays([(0, 0), (2, 0), (0, 1)], [(0, 1, 2)], renumber=False, element="P2")
    M = np.full((6, 6), 16.0)
    M[:3, :3], M[:3, 3:], M[3:, :3] = -1, 0, 0
    M[range(6), range(6)] = [6, 6, 6, 32, 32, 32]
    for corner, opposite in ((0, 4), (1, 5), (2, 3)):
        M[corner, opposite] = M[opposite, corner] = -4
    nodes = one.stencil[0]
    np.testing.assert_allclose(one.mass().toarray()[np.ix_(nodes, nodes)], M / 180, atol=1e-12)
    np.testing.assert_allclose(one.load()[nodes], [0, 0, 0, 1 / 3, 1 / 3, 1 / 3], atol=1e-12)
    basis = skfem.Basis(cloth.mesh, skfem.ElementTriP2(), intorder=8)
    form = skfem.BilinearForm(lambda u, v, w: 0.2 * u * v).assemble(basis).toarray()
    close(system_on(cloth).scalar_mass.toarray(), form)
    assert system_on(cloth).mass_kind == "consistent"
    assert system_on(cloth).diagonal_mass.min() > 0
    assert system_on(cloth).diagonal_mass.sum() == pytest.approx(0.2 * 0.06, rel=1e-12)
    f = cloth.load(lambda X: np.column_stack([X[:, 0] ** 3, X[:, 1], 0 * X[:, 0]]))
    np.testing.assert_allclose(f.sum(axis=0), [0.3**4 / 4 * 0.2, 0.3 * 0.02, 0], atol=1e-15)
    moment = cloth.X[:, 0] @ f  # X is in the space: Σ X_a f_a = ∫ X f dA
    np.testing.assert_allclose(moment, [0.3**5 / 5 * 0.2, 0.045 * 0.02, 0], atol=1e-15)


def test_free_fall_causes_no_internal_force(cloth):
    system = system_on(cloth, [fc.StVK(), fc.Gravity(), fc.StrainRateDamping(0.01)])
    start = system.rest()
    end = fc.run(system, fc.ImplicitMidpoint(), start, dt=0.01, t_end=0.1).state
    np.testing.assert_allclose(
        end.x - start.x, np.tile([0, 0, -0.5 * 9.81 * 0.01], (len(end.x), 1)), atol=1e-9
    )


def test_pressure_is_the_form_and_its_symmetric_part(cloth):
    """∫ p N_a (F₁ × F₂) dA by scikit-fem, and K's symmetric part."""
    _, x, _ = trial_states(cloth)[0]
    p = 300.0
    basis = skfem.Basis(cloth.mesh, skfem.ElementVector(skfem.ElementTriP2(), dim=3), intorder=6)
    F = basis.interpolate(oracle.dofs(x)).grad
    n = np.cross(F[:, 0], F[:, 1], axis=0)
    form = skfem.LinearForm(lambda v, w: p * np.einsum("i...,i...", w["n"], v))
    exact = system_on(cloth, [fc.Pressure(p, tangent="exact")])
    close(exact.force(exact.state(x)).ravel(), form.assemble(basis, n=n))
    K = exact.stiffness(exact.state(x)).toarray()
    half = system_on(cloth, [fc.Pressure(p)])
    close(half.stiffness(half.state(x)).toarray(), (K + K.T) / 2)
    pinned = system_on(cloth, [fc.Pressure(p, tangent="exact")], pins=["boundary"])
    K = pinned.stiffness(pinned.state(x)).toarray()[np.ix_(pinned.free, pinned.free)]
    assert np.abs(K - K.T).max() < 1e-12 * np.abs(K).max()  # conservative where the edge is held


def test_mass_damping_is_consistent(cloth, rng):
    """d = −α M v, also at the corners."""
    rate = 3.0
    damping = fc.MassDamping(rate)
    system = system_on(cloth, [damping])
    v = rng.standard_normal((len(cloth.X), 3))
    state = system.state(system.rest().x, v)
    M = system.mass.toarray()
    close(system.force(state).ravel(), -rate * M @ v.ravel())
    close(system.damping(state).toarray(), rate * M)
    power = rate * v.ravel() @ M @ v.ravel()
    assert system.bound[0].power(state.x, v, 0.0) == pytest.approx(power, rel=1e-12)
    assert system.rate_bounds() == (0.0, rate)


@pytest.mark.parametrize("method", [fc.BackwardEuler(), fc.EnergyMomentum(), fc.GeneralizedAlpha()])
def test_methods_conserve_their_invariants(cloth, method):
    """All conserve momentum; energy–momentum also energy and angular momentum."""
    system = system_on(cloth)
    x = 1.05 * system.rest().x
    spin = np.array([1.0, -2.0, 3.0])
    start = system.state(x, np.cross(spin, x) + [1.0, 0.5, 2.0])
    newton = fc.Newton(tolerance=1e-12)
    result = fc.run(system, method, start, 2e-4, 4e-3, solver="direct", newton=newton)
    end, M = result.state, system.scalar_mass
    before, after = (M @ s.v for s in (start, end))
    np.testing.assert_allclose(after.sum(axis=0), before.sum(axis=0), rtol=1e-9)
    if isinstance(method, fc.EnergyMomentum):
        total = result.energies["kinetic"] + result.energies["StVK"]
        np.testing.assert_allclose(total, total[0], rtol=1e-9)
        turning = [np.cross(s.x, M @ s.v).sum(axis=0) for s in (start, end)]
        np.testing.assert_allclose(turning[1], turning[0], rtol=1e-8, atol=1e-12)


def test_the_frequency_of_a_taut_sheet():
    """ω² = (S/ρ)(π/a)² 2 of a square under the second Piola–Kirchhoff stress S: fourth order."""
    stretch, errors = 1.1, []
    S = 1000.0 / 0.7 * (stretch**2 - 1) / 2
    exact = 2 * np.pi**2 * S / 0.2
    for h in (1 / 4, 1 / 8):
        cloth = fc.Cloth.rectangle(1.0, 1.0, h, "right", element="P2")
        fabric = fc.Fabric(0.2, 1000.0, 0.3)
        system = fc.System(cloth, fabric, [fc.StVK()], pins=["boundary"])
        K = system.stiffness(system.state(stretch * system.rest().x)).tocsr()[2::3, 2::3]
        inside = np.setdiff1d(np.arange(len(cloth.X)), cloth.nodes("boundary"))
        K, M = (A.tocsr()[inside][:, inside].toarray() for A in (K, system.scalar_mass))
        errors.append(scipy.linalg.eigh(K, M, eigvals_only=True)[0] / exact - 1)
    assert 0 < errors[1] < 1e-3
    assert np.log2(errors[0] / errors[1]) == pytest.approx(4, abs=0.15)


def test_adaptive_steps_and_the_interpolated_point(cloth):
    """The error norm includes all nodes; a probe between nodes is on the quadratic surface."""
    system = system_on(cloth, [fc.StVK(), fc.Gravity()], pins=["left"])
    start = system.state(system.rest().x * [1.02, 1.0, 1.0])
    method = fc.Adaptive(fc.GeneralizedAlpha(), rtol=1e-2)
    probe = fc.Probe("at", point=(0.21, 0.13))
    result = fc.run(system, method, start, t_end=0.01, probes=[probe])
    basis = skfem.Basis(cloth.mesh, skfem.ElementTriP2())
    z = basis.interpolator(result.state.x[:, 2])(np.array([[0.21], [0.13]]))
    assert result.observed["at.z"][-1] == pytest.approx(z[0], rel=1e-10)
    mean = cloth.load() @ (result.state.x - start.x) / 0.06
    found = [result.observed[f"mean_displacement.{c}"][-1] for c in "xyz"]
    np.testing.assert_allclose(found, mean, rtol=1e-9, atol=1e-14)


def test_fields_between_cloths_of_two_elements():
    """P2 represents a quadratic polynomial exactly; two integrals give the same error of P1."""
    coarse = fc.Cloth.rectangle(1.0, 1.0, 0.5, "right", element="P2")
    linear = fc.Cloth.rectangle(1.0, 1.0, 0.5, "right")
    square = lambda X: X[:, 0] ** 2 - X[:, 0] * X[:, 1]  # noqa: E731
    slope = lambda X: np.column_stack([2 * X[:, 0] - X[:, 1], -X[:, 0]])  # noqa: E731
    u, w = square(coarse.X), square(linear.X)
    assert coarse.l2_error(u, square) < 1e-14
    assert coarse.h1_error(u, slope) < 1e-13
    errors = linear.l2_error(w, square), linear.h1_error(w, slope)
    assert min(errors) > 0.01
    differences = coarse.l2_difference(linear, u, w), coarse.h1_difference(linear, u, w)
    assert differences == pytest.approx(errors, rel=1e-12)
    points = np.random.default_rng(5).uniform(size=(50, 2))
    np.testing.assert_allclose(coarse.interpolate(u, points), square(points), atol=1e-14)
    assert coarse.l2_norm(u) ** 2 == pytest.approx(1 / 5 - 2 / 8 + 1 / 9, rel=1e-12)
    with pytest.raises(fc.InputError, match="Cloth.l2_error: the function's values of shape"):
        coarse.l2_error(u, lambda X: X)


def test_a_second_process_compiles_nothing(tmp_path):
    program = """
import fecloth as fc
from fecloth.terms.membranes import stvk
cloth = fc.Cloth.rectangle(1.0, 1.0, 0.5, "right", element="P2")
system = fc.System(cloth, fc.Fabric(0.2, 1000.0), [fc.StVK()])
system.force(system.rest())
print(sum(stvk.KERNELS.regge.add_force.stats.cache_misses.values()))
"""
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    environment["PYTHONPATH"] = str(Path(fc.__file__).parents[1])
    misses = [
        subprocess.run(
            [sys.executable, "-c", program], env=environment, capture_output=True, text=True
        ).stdout
        for _ in range(2)
    ]
    assert misses == ["1\n", "0\n"]


def test_element_bound_is_an_upper_bound_and_sharp(cloth):
    for terms in (
        [fc.StVK()],
        [fc.StVK(), fc.StrainRateDamping(0.01)],
        [fc.MassDamping(3.0)],
        [fc.StVK(), fc.Tether([0, 20], (0, 0, 1), 200.0, 0.5)],
        [fc.StVK(), fc.Pressure(500.0)],
    ):
        for pins in ([], ["left"]):
            system = system_on(cloth, terms, pins=pins)
            limit = critical_dt(system, system.rest())
            bound = element_bound(system)
            assert 0.2 * limit < bound <= limit * (1 + 1e-9)


# --- files and scenes -----------------------------------------------------------------------------


def test_frames_are_quadratic_triangles(cloth, tmp_path):
    system = system_on(cloth)
    state = system.state(trial_states(cloth)[0][1])
    state = fc.State(0.25, state.x, trial_states(cloth)[0][2])
    fc.write_vtk(tmp_path / "a", cloth, state, system)
    file = tmp_path / "a_000000.vtu"
    mesh = meshio.read(file)
    assert np.array_equal(mesh.cells_dict["triangle6"], cloth.cells)
    assert np.array_equal(mesh.points, state.x)
    assert mesh.cell_data["energy_density"][0].shape == (len(cloth.triangles),)
    energy = mesh.cell_data["energy_density"][0] @ cloth.weights.sum(axis=1)
    assert energy == pytest.approx(system.energies(state)["StVK"], rel=1e-12)
    again = read_frame(file, cloth)
    assert again.t == 0.25
    assert np.array_equal(again.x, state.x)
    assert np.array_equal(again.v, state.v)
    with pytest.raises(fc.InputError, match="nodes: the cloth has"):
        read_frame(file, fc.Cloth.rectangle(0.3, 0.2, h=0.1))


@pytest.mark.filterwarnings("ignore:The default value of `algorithm`")
def test_vtk_finds_the_curved_area(tmp_path):
    """VTK uses its own shape functions; a wrong order of the nodes would change the area."""
    pyvista = pytest.importorskip("pyvista")
    cloth = fc.Cloth.rectangle(1.0, 1.0, h=0.5, pattern="cross", element="P2")
    x = np.column_stack([cloth.X, 0.2 * cloth.X[:, 0] ** 2])
    fc.write_vtk(tmp_path / "b", cloth, fc.State(0.0, x, 0 * x))
    grid = pyvista.read(tmp_path / "b_000000.vtu")
    assert set(grid.celltypes) == {22}
    surface = grid.extract_surface(nonlinear_subdivision=4)
    np.testing.assert_allclose(surface.points[:, 2], 0.2 * surface.points[:, 0] ** 2, atol=1e-6)
    arc = 0.5 * np.sqrt(1.16) + np.arcsinh(0.4) / 0.8  # ∫ √(1 + (0.4 x)²) dx
    assert surface.area == pytest.approx(arc, rel=1e-4)


SCENE = """
[cloth]
shape = "rectangle"
width = 0.3
height = 0.2
h = 0.1
element = "P2"
[fabric]
areal_density = 0.2
tensile_stiffness = 100.0
[[terms]]
type = "StVK"
[[terms]]
type = "Gravity"
[[pins]]
where = "left"
[time]
method = "bdf2"
dt = 0.01
t_end = 0.05
[output]
frames = 2
"""


def test_a_scene_with_quadratic_triangles(tmp_path, capsys):
    file = tmp_path / "s.toml"
    file.write_text(SCENE)
    scene = load_scene(file)
    assert (scene.mass, scene.cloth.element) == ("consistent", "P2")
    assert main(["run", str(file), "-o", str(tmp_path / "out"), "--quiet"]) == 0
    cloth = scene.mesh()
    frames = sorted((tmp_path / "out").rglob("*.vtu"))
    last = read_frame(frames[-1], cloth)
    assert last.t == pytest.approx(0.05)
    assert last.x[cloth.nodes("right"), 2].max() < -1e-3
    assert main(["mesh", str(file), "-o", str(tmp_path / "flat.vtu")]) == 0
    assert f"{len(cloth.X)} nodes, {len(cloth.triangles)} quadratic tri" in capsys.readouterr().out
    flat = meshio.read(tmp_path / "flat.vtu")
    assert np.array_equal(flat.cells_dict["triangle6"], cloth.cells)
    for change, said in (
        (('"StVK"', '"HingeBending"'), "HingeBending on element P2"),
        (('"bdf2"', '"central_difference"'), 'Write mass = "lumped", or take an implicit'),
        (('"P2"', '"P3"'), "P1"),
    ):
        file.write_text(SCENE.replace(*change))
        with pytest.raises(fc.InputError, match=said):
            run_scene.run_scene(load_scene(file), tmp_path / "refused")


def test_a_scene_with_explicit_steps_on_quadratic_triangles(tmp_path, capsys):
    """`mass = "lumped"` and the method's name suffice; it stays near the implicit run."""
    file, ends = tmp_path / "s.toml", []
    file.write_text(SCENE)
    bending = "\n[[terms]]\ntype = 'PlateBending'\n"
    for change in ("mass='lumped'", "mass='consistent'"):
        method = "central_difference" if "lumped" in change else "generalized_alpha"
        text = SCENE.replace('method = "bdf2"\ndt = 0.01', f"method = '{method}'")
        text = text.replace("[[pins]]", f"{bending}[[pins]]").replace(
            "tensile_stiffness", "bending_rigidity = 1e-4\ntensile_stiffness"
        )
        file.write_text(f"{change}\n{text}")
        assert main(["run", str(file), "-o", str(tmp_path / method), "--quiet"]) == 0
        cloth = load_scene(file).mesh()
        last = read_frame(sorted((tmp_path / method).rglob("*.vtu"))[-1], cloth)
        ends.append(cloth.load() @ last.x[:, 2])
    assert ends[0] < -5e-4
    assert ends[0] == pytest.approx(ends[1], rel=0.01)


def test_run_compiles_all_kernels_before_the_first_step(tmp_path, monkeypatch):
    file, seen = tmp_path / "s.toml", []
    file.write_text(SCENE)
    monkeypatch.setattr(warm_up, "run", lambda system, *_, **__: seen.append(system.cloth.element))
    warm_up.compile_kernels(load_scene(file).build())
    assert set(seen) == {"P2"}


# --- orders ---------------------------------------------------------------------------------------

STRETCH, WAVE = np.array([1.2, 1.1]), 0.08


def motion(X):
    """Positions (p, 3) of a sheet stretched along both axes, with in-plane and normal waves."""
    s, t = np.pi * X[:, 0], np.pi * X[:, 1]
    return np.column_stack(
        [
            STRETCH[0] * X[:, 0] + WAVE * np.sin(s) * np.cos(t) / np.pi,
            STRETCH[1] * X[:, 1] + WAVE * np.cos(s) * np.sin(t) / np.pi,
            2 * WAVE * np.sin(s) * np.sin(t) / np.pi,
        ]
    )


def motion_gradient(X):
    """Deformation gradient F (p, 3, 2)."""
    s, t = np.pi * X[:, 0], np.pi * X[:, 1]
    cc, ss, sc, cs = (
        a * b
        for a, b in (
            (np.cos(s), np.cos(t)),
            (np.sin(s), np.sin(t)),
            (np.sin(s), np.cos(t)),
            (np.cos(s), np.sin(t)),
        )
    )
    F = np.stack(
        [
            np.stack([WAVE * cc + STRETCH[0], -WAVE * ss], -1),
            np.stack([-WAVE * ss, WAVE * cc + STRETCH[1]], -1),
            np.stack([2 * WAVE * cs, 2 * WAVE * sc], -1),
        ],
        axis=1,
    )
    return F


def stress(X):
    """(p, 3, 2) P = F S of the isotropic StVK sheet, also for complex X."""
    F, Y, nu = motion_gradient(X), 1000.0, 0.3
    E = (np.einsum("pji,pjk->pik", F, F) - np.eye(2)) / 2
    trace = np.trace(E, axis1=1, axis2=2)[:, None, None]
    S = Y / (1 - nu**2) * ((1 - nu) * E + nu * trace * np.eye(2))
    return np.einsum("pij,pjk->pik", F, S), S


def body_force(X):
    """(p, 3) −Div P [N/m²], by complex steps."""
    h = 1e-30
    shifts = 1j * h * np.eye(2)
    return -sum(stress(X + shifts[j])[0][:, :, j].imag / h for j in range(2))


def static_errors(element, n, per="node", strain="interpolated"):
    """L2 and H1 error of the equilibrium under the force that makes `motion` exact.

    Per "node" the force is integrated with the shape functions, per "area" by its nodal values.
    """
    cloth = fc.Cloth.rectangle(1.0, 1.0, 1 / n, element=element)
    values = cloth.load(body_force, order=8) if per == "node" else body_force(cloth.X)
    force = fc.UserForce(lambda x, v, t: values, per=per)
    terms = [fc.StVK(strain=strain), force]
    system = fc.System(cloth, fc.Fabric(0.2, 1000.0, 0.3), terms, pins=["boundary"])
    x = fc.equilibrium(system, system.state(motion(cloth.X))).x
    return cloth.l2_error(x, motion, 10), cloth.h1_error(x, motion_gradient, 10)


@pytest.mark.parametrize("per", ["node", "area"])
@pytest.mark.parametrize(("element", "l2", "h1"), [("P1", 2, 1), ("P2", 3, 2)])
def test_orders_in_space(element, l2, h1, per):
    points = np.random.default_rng(0).uniform(size=(500, 2))
    assert np.linalg.eigvalsh(stress(points)[1]).min() > 0  # taut: the problem is well posed
    n = (8, 16, 32)
    errors = np.array([static_errors(element, k, per) for k in n])
    orders = [observed_order(1 / np.array(n), e)[-1] for e in errors.T]
    assert orders == pytest.approx([l2, h1], abs=0.15)


def test_both_strains_have_the_orders_of_quadratic_triangles():
    errors = {
        strain: np.array([static_errors("P2", n, "node", strain) for n in (8, 16, 32)])
        for strain in ("interpolated", "pointwise")
    }
    for found in errors.values():
        orders = [observed_order(1 / np.array([8, 16, 32]), e)[-1] for e in found.T]
        assert orders == pytest.approx([3, 2], abs=0.15)
    np.testing.assert_allclose(errors["interpolated"], errors["pointwise"], rtol=0.05)
    assert (errors["interpolated"] != errors["pointwise"]).all()
