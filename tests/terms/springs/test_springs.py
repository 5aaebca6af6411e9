"""Spring networks: Hooke, Provot's classes, Van Gelder, Delingette = StVK, homogenised moduli."""

import numpy as np
import pytest
from conftest import flat, rough
from support.tiers import in_turn

import fecloth as fc
from fecloth.terms.springs.networks import BEND, EDGE, SHEAR, WARP, WEFT, edges, structural

# steps are coarse and meshes small by intent
pytestmark = pytest.mark.filterwarnings("ignore::fecloth.errors.FeclothWarning")

SQUARE = fc.Fabric(0.2, 1000.0, 0.3)


def spring_energy(net, k, cloth, x):
    i, j = net.nodes.T
    stretch = np.linalg.norm(x[j] - x[i], axis=1) - np.linalg.norm(cloth.X[j] - cloth.X[i], axis=1)
    return 0.5 * np.sum(k * stretch**2)


def test_edges_of_an_unstructured_mesh(sheet, rng):
    """Every edge once, Hooke's energy, one k for all: √3/2 Y, or what is given."""
    pairs = {tuple(sorted(p)) for t in sheet.triangles for p in zip(t, np.roll(t, 1), strict=True)}
    net = structural(sheet)
    assert {tuple(sorted(p)) for p in net.nodes.tolist()} == pairs
    assert len(net.nodes) == len(pairs)
    assert (net.kind == EDGE).all()
    x = rough(sheet, rng)
    for springs, k in ((fc.Springs(), 0.75**0.5 * 1000.0), (fc.Springs(stiffness=70.0), 70.0)):
        system = fc.System(sheet, SQUARE, [springs])
        expected = spring_energy(net, k, sheet, x)
        assert system.energies(system.state(x))["Springs"] == pytest.approx(expected, rel=1e-13)


def test_classes_on_a_grid():
    """4 × 3 cells of 0.1 × 0.1: Provot's counts, lengths and directions."""
    cloth = fc.Cloth.rectangle(0.4, 0.3, h=0.1, pattern="right")
    net = structural(cloth, bend=1.0)
    counts = {kind: int(np.sum(net.kind == kind)) for kind in (EDGE, WARP, WEFT, SHEAR, BEND)}
    assert counts == {EDGE: 0, WARP: 16, WEFT: 15, SHEAR: 24, BEND: 3 * 4 + 5 * 2}
    length = np.hypot(*net.vectors.T)
    expected = np.select([net.kind == SHEAR, net.kind == BEND], [0.1 * 2**0.5, 0.2], 0.1)
    np.testing.assert_allclose(length, expected, rtol=1e-12)
    assert (abs(net.vectors[net.kind == WARP][:, 1]) < 1e-15).all()
    slopes = np.sign(np.prod(net.vectors[net.kind == SHEAR], axis=1))
    assert sorted(slopes) == [-1.0] * 12 + [1.0] * 12
    pairs = {tuple(sorted(p)) for p in net.nodes.tolist()}
    assert len(pairs) == len(net.nodes)  # none twice


def test_other_meshes_have_no_classes(sheet):
    for cloth in (sheet, fc.Cloth.rectangle(0.4, 0.3, h=0.1, pattern="equilateral")):
        assert (structural(cloth).kind == EDGE).all()


def test_van_gelder_is_area_over_length_squared(sheet, rng):
    """k of each edge, summed triangle by triangle."""
    k = {}
    for triangle in sheet.triangles.tolist():
        a, b, c = sheet.X[triangle]
        area = 0.5 * ((b - a)[0] * (c - a)[1] - (b - a)[1] * (c - a)[0])
        for i in range(3):
            pair = tuple(sorted((triangle[i], triangle[(i + 1) % 3])))
            length = np.linalg.norm(sheet.X[pair[0]] - sheet.X[pair[1]])
            k[pair] = k.get(pair, 0.0) + 1000.0 * area / length**2
    net, x = edges(sheet), rough(sheet, rng)
    stiffness = np.array([k[tuple(sorted(pair))] for pair in net.nodes.tolist()])
    system = fc.System(sheet, SQUARE, [fc.Springs("van_gelder")])
    energy = system.energies(system.state(x))["Springs"]
    assert energy == pytest.approx(spring_energy(net, stiffness, sheet, x), rel=1e-13)


@pytest.mark.parametrize(
    ("pattern", "nu"), in_turn(["unstructured", "right", "cross", "equilateral"], [0.0, 0.3, -0.4])
)
def test_biquadratic_springs_are_stvk(pattern, nu, rng):
    cloth = fc.Cloth.rectangle(1.0, 0.7, h=0.15, pattern=pattern)
    fabric = fc.Fabric(0.2, 1000.0, nu)
    springs = fc.System(cloth, fabric, [fc.Springs("biquadratic")])
    membrane = fc.System(cloth, fabric, [fc.StVK()])
    state = membrane.state(rough(cloth, rng))
    energy = membrane.energies(state)["StVK"]
    assert springs.energies(state)["Springs"] == pytest.approx(energy, rel=1e-12)
    for of in (lambda system: system.force(state), lambda system: system.stiffness(state)):
        assert abs(of(springs) - of(membrane)).max() < 1e-12 * abs(of(membrane)).max()


def test_damping_of_biquadratic_springs_is_strain_rate_damping(sheet, rng):
    """k_d = τ k on l² is τ ℂ on Ė."""
    springs = fc.System(sheet, SQUARE, [fc.Springs("biquadratic", damping=0.02)])
    membrane = fc.System(sheet, SQUARE, [fc.StVK(), fc.StrainRateDamping(0.02)])
    state = membrane.state(rough(sheet, rng), rng.standard_normal((len(sheet.X), 3)))
    expected = membrane.force(state)
    assert abs(springs.force(state) - expected).max() < 1e-12 * abs(expected).max()


def test_newton_does_not_take_damped_springs_for_a_potential(sheet):
    """A line search on the energy alone would be blind to the damping force."""
    from fecloth.nonlinear.newton import StageEquation

    for damping, expected in ((0.0, True), (0.01, False)):
        system = fc.System(sheet, SQUARE, [fc.Springs(damping=damping)])
        equation = StageEquation(system, None, "on_failure")
        assert (equation.potential is not None) is expected


# --- which material a network is ------------------------------------------------------------------


LATTICE = [[1, 1 / 3, 0], [1 / 3, 1, 0], [0, 0, 1 / 3]]  # of three directions
COTTON = fc.Fabric(0.2, (2000.0, 900.0), 0.2, 60.0)
K, Q, B = 137.0, 41.0, 17.0  # along the sides, along both diagonals, from node to next but one
GRID = [[2060.0, 60.0, 0], [60.0, 960.0, 0], [0, 0, 60.0]]
MODULI = [
    # ν = 1/3, Y = 2 k/√3; the derived k has the fabric's Y
    (fc.Springs(stiffness=K), SQUARE, "equilateral", 2 * 0.75**1.5 * K * np.array(LATTICE)),
    (fc.Springs(), SQUARE, "equilateral", 1125.0 * np.array(LATTICE)),
    (fc.Springs("van_gelder"), SQUARE, "equilateral", 1125.0 * np.array(LATTICE)),
    (fc.Springs(stiffness=K, shear=0.0), SQUARE, "right", np.diag([K, K, 0.0])),
    (  # a spring with unit vector n gives k l²/A n_i n_j n_k n_l; l² = 2 h² and 4 h²
        fc.Springs(stiffness=K, shear=Q, bend=B),
        SQUARE,
        "right",
        [[K + Q + 4 * B, Q, 0], [Q, K + Q + 4 * B, 0], [0, 0, Q]],
    ),
    # C33 = G, C11 − C12 = Y₁, C22 − C12 = Y₂
    (fc.Springs(), COTTON, "right", GRID),
    (fc.Springs(), COTTON, "cross", GRID),
    # Van Gelder's k: Y on the sides, Y/2 on the one diagonal: not isotropic, not orthotropic
    (
        fc.Springs("van_gelder"),
        SQUARE,
        "right",
        250.0 * np.array([[5, 1, 1], [1, 5, 1], [1, 1, 1]]),
    ),
]


@pytest.mark.parametrize(("springs", "fabric", "pattern", "expected"), MODULI)
def test_moduli_of_a_lattice(springs, fabric, pattern, expected):
    C = fc.plane_moduli(springs, fabric, pattern)
    np.testing.assert_allclose(C, expected, atol=1e-10 * np.abs(expected).max())


def test_moduli_count_the_relaxation_inside_a_period(monkeypatch):
    """Rows that are stiff and soft by turns: in series, not in parallel."""
    from fecloth.terms.springs.networks import Net

    k1, k2 = 100.0, 300.0

    def alternating(self, panel, given):
        y = panel.cloth.X[self.nodes, 1]
        row = np.round(y / (0.1 * 0.75**0.5)).astype(int)
        return np.where(row[:, 0] == row[:, 1], 0.0, np.where(row.min(axis=1) % 2, k1, k2))

    monkeypatch.setattr(Net, "structural_stiffness", alternating)
    C = fc.plane_moduli(fc.Springs(), SQUARE, "equilateral")
    series = 2 * k1 * k2 / (k1 + k2)
    # two springs of 60° for each node: C22 = 2 k l² s⁴ / A with A = √3/2 l²
    assert C[1, 1] == pytest.approx(2 * series * 0.75**2 / 0.75**0.5, rel=1e-10)


def test_damping_along_the_axis():
    """Two nodes that part at 3 m/s and pass each other at 4 m/s: only the first is resisted."""
    cloth = fc.Cloth.rectangle(1.0, 1.0, h=1.0, pattern="right")
    system = fc.System(cloth, SQUARE, [fc.Springs("van_gelder", damping=0.1)])
    v = np.zeros((4, 3))
    right = cloth.nodes("right")
    v[right] = [3.0, 0.0, 4.0]
    state = system.state(flat(cloth), v)
    k_side, k_diagonal = 500.0, 1000.0 / 2  # Y A / l², one triangle; two at the diagonal
    diagonal = 0.5 * 0.1 * k_diagonal * 3.0  # n·v = 3/√2, its X component 3/2
    force = system.force(state)
    assert -force[right, 0].sum() == pytest.approx(2 * 0.1 * k_side * 3.0 + diagonal, rel=1e-12)
    assert abs(force[:, 2]).max() == 0.0
    power = system.bound[0].power(state.x, state.v, 0.0)
    assert power == pytest.approx(-np.vdot(force, v), rel=1e-12)
