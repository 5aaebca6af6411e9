"""Self-contact: force and tangent, no intersection, momentum, refusals."""

import builtins

import numpy as np
import pytest
from support.obstacles import check_slopes, two_layers
from support.tiers import stories_except

import fecloth as fc
from fecloth.errors import InputError
from fecloth.linalg.block_matrix import BlockMatrix, BlockPattern
from fecloth.mesh.surface import Surface
from fecloth.system.constraints import Constraints

# steps are coarse and meshes small by intent
pytestmark = pytest.mark.filterwarnings("ignore::fecloth.errors.FeclothWarning")

pytest.importorskip("ipctk")
FABRIC = fc.Fabric(0.2, 500.0, 0.3, bending_rigidity=2e-6)
GAP = 0.01


@pytest.mark.parametrize("element", ["P1", "P2"])
@pytest.mark.parametrize("thickness", [0.0, 0.002])
def test_force_and_tangent_are_derivatives(element, thickness, rng):
    cloth, x, _ = two_layers(GAP, 0.1 if element == "P1" else 0.2, element)
    system = fc.System(cloth, FABRIC, [fc.SelfContact(GAP, thickness=thickness, stiffness=300.0)])
    check_slopes(system, x, 0.0, rng, size=1e-7)  # on longer ways edges become parallel


def test_the_force_on_a_flat_layer_is_the_pressure_of_the_barrier():
    """On two equal meshes at one distance: κ b'(s) on the area, from each side."""
    layer = fc.Cloth.rectangle(0.4, 0.4, 0.04, pattern="right")
    n = len(layer.X)
    cloth = fc.Cloth.join([layer, layer], ["lower", "upper"])
    x = np.column_stack([np.vstack([layer.X, layer.X]), np.repeat([0.0, 0.7 * GAP], n)])
    x[n:, :2] += 0.013  # no node over another
    system = fc.System(cloth, FABRIC, [fc.SelfContact(GAP, stiffness=300.0)])
    f = system.force(system.state(x))
    s = 0.7
    slope = -(8 * s * (s**2 - 1) * np.log(s) + 2 * (s**2 - 1) ** 2 / s)
    inner = np.flatnonzero((abs(x[:n, :2] - 0.2) < 0.11).all(axis=1))
    share = layer.diagonal_mass(np.ones(len(layer.triangles)))[inner].sum()
    assert f[inner, 2].sum() == pytest.approx(8 / 3 * 300.0 * slope * share, rel=0.02)
    assert abs(f.sum(axis=0)).max() < 1e-12 * abs(f).sum()


def test_the_sum_with_a_coupling_is_that_of_dense_matrices(rng):
    cloth, x, _ = two_layers(GAP)
    system = fc.System(cloth, FABRIC, [fc.StVK(), fc.SelfContact(GAP)], pins=["lower"])
    state = system.state(x)
    J = system.project(system.assemble(BlockMatrix.zeros(system.pattern), state, 0.5, wa=2.0))
    K = system.coupling(state, 0.5).toarray()
    free = np.repeat(~np.isin(np.arange(len(x)), system.constraints.nodes), 3)
    expected = J.to_scipy().toarray() + np.where(np.outer(free, free), K, 0.0)
    whole = system.couple(J, state, 0.5)
    assert abs(whole.to_scipy().toarray() - expected).max() < 1e-12 * abs(expected).max()
    assert (np.diff(whole.pattern.indices)[np.diff(whole.pattern.rows) == 0] > 0).all()
    bare = fc.System(cloth, FABRIC, [fc.StVK()])
    assert bare.couple(J, state, 0.5) is J


def test_a_projected_matrix_is_that_of_projectors(rng):
    cloth = fc.Cloth.rectangle(1.0, 1.0, 0.5, pattern="right")
    pins = Constraints.bind([fc.Pin("left"), fc.Slide("right", direction=(0.6, 0.8, 0.0))], cloth)
    n = len(cloth.X)
    pairs = np.column_stack([np.arange(n), np.roll(np.arange(n), 1)]).astype(np.int32)
    A = BlockMatrix.zeros(BlockPattern.union(n, [pairs]))
    A.values[:] = rng.standard_normal(A.values.shape)
    P = np.column_stack([pins.project(e.reshape(n, 3)).ravel() for e in np.eye(3 * n)])
    dense = A.to_scipy().toarray()
    assert abs(pins.project_matrix(A.to_scipy()).toarray() - P @ dense @ P).max() < 1e-13


@pytest.mark.stories
@pytest.mark.parametrize("solver", ["pcg", "direct"])
def test_colliding_pieces_keep_their_momentum_and_make_no_energy(solver):
    cloth, x, upper = two_layers(GAP)
    x[upper, 2] += 0.03
    v = np.zeros_like(x)
    v[upper] = [0.3, 0.0, -1.0]
    system = fc.System(cloth, FABRIC, [fc.StVK(), fc.HingeBending(), fc.SelfContact(GAP)])
    start, surface, touched = system.state(x, v), Surface.from_cloth(cloth), 0
    energy = sum(system.energies(start).values())
    newton = fc.Newton(tolerance=1e-10)
    steps = fc.march(
        system,
        fc.BackwardEuler(),
        start,
        4e-3,
        0.08,
        solver=fc.solver_for(system, fc.BackwardEuler(), 4e-3, solver, newton)[0],
    )
    momentum = system.nodal_mass @ v
    for state, _ in steps:
        touched += len(system.bound[-1].sets.at(state.x)) > 0
        assert surface.count_intersections(state.x) == 0
        assert abs(system.nodal_mass @ state.v - momentum).max() < 1e-8 * abs(momentum).max()
        now = sum(system.energies(state).values())
        assert now <= energy * (1 + 1e-9)
        energy = now
    assert touched > 3
    assert state.v[upper, 2].mean() > -0.6  # without contact it would still be -1


@pytest.mark.parametrize("friction", stories_except([0.2, 0.6], 0.6))
def test_a_patch_slides_on_a_held_layer_as_coulomb_says(friction):
    """Its acceleration on a slope is g (sin φ − μ cos φ), or it rests; heat is what it loses."""
    phi, g, dt, count = np.radians(25.0), 9.81, 2e-3, 40
    lower = fc.Cloth.rectangle(0.5, 0.2, 0.03)
    upper = fc.Cloth.rectangle(0.1, 0.1, 0.028)
    cloth = fc.Cloth.join([lower, upper], ["lower", "upper"])
    x = np.column_stack([cloth.X, np.zeros(len(cloth.X))])
    over = cloth.nodes("upper")
    gap = 2e-3
    x[over] = np.column_stack([upper.X @ [[0.97, 0.24], [-0.24, 0.97]] + [0.1, 0.04], 0 * over])
    x[over, 2] += 0.97 * gap
    gravity = fc.Gravity((g * np.sin(phi), 0.0, -g * np.cos(phi)))
    terms = [fc.StVK(), gravity, fc.SelfContact(gap, friction=friction, restitution=1.0)]
    system = fc.System(cloth, FABRIC, terms, pins=["lower"])
    result = fc.run(system, fc.BackwardEuler(), system.state(x), dt, count * dt)
    mass = system.nodal_mass[over]
    speed = mass @ result.state.v[over, 0] / mass.sum()
    expected = max(0.0, g * (np.sin(phi) - friction * np.cos(phi))) * count * dt
    assert speed == pytest.approx(expected, rel=0.05, abs=1e-5)
    heat = result.energies["dissipated:SelfContact"][-1]
    way = mass @ (result.state.x - x)[over, 0] / mass.sum()
    if expected:
        assert heat == pytest.approx(friction * mass.sum() * g * np.cos(phi) * way, rel=0.1)


def test_mistakes():
    cloth, x, upper = two_layers(GAP)
    with pytest.raises(InputError, match="a third of the shortest edge"):
        fc.System(cloth, FABRIC, [fc.SelfContact(0.05)])
    system = fc.System(cloth, FABRIC, [fc.StVK(), fc.SelfContact(GAP, thickness=0.007)])
    with pytest.raises(InputError, match="two layers start at a distance of 0.00"):
        fc.run(system, fc.BackwardEuler(), system.state(x), 0.01, 0.01)
    crossed = x.copy()
    crossed[upper, 2] -= 0.6 * GAP + 0.01 * (x[upper, 0] - 0.12)
    with pytest.raises(InputError, match=r"triangles intersect at the start: \d+ and \d+"):
        fc.run(system, fc.BackwardEuler(), system.state(crossed), 0.01, 0.01)
    system = fc.System(cloth, FABRIC, [fc.StVK(), fc.SelfContact(GAP)])
    with pytest.raises(InputError, match="BackwardEuler"):
        fc.run(system, fc.ImplicitMidpoint(), system.state(x), 0.01, 0.01)


def test_a_missing_toolkit_is_named(monkeypatch):
    find = builtins.__import__

    def refuse(name, *rest):
        if name == "ipctk":
            raise ImportError(name)
        return find(name, *rest)

    monkeypatch.setattr(builtins, "__import__", refuse)
    cloth = fc.Cloth.rectangle(1.0, 1.0, 0.5, pattern="right")
    with pytest.raises(InputError, match=r"^SelfContact: needs .* pip install '\.\[contact\]'"):
        fc.System(cloth, FABRIC, [fc.SelfContact()])
