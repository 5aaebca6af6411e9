"""Modes against closed forms and dense eigensolvers: orders, repeated, rigid and unstable modes."""

import math
import re
import warnings

import meshio
import numpy as np
import pytest
from conftest import flat
from scipy import sparse
from scipy.linalg import eigh
from scipy.optimize import brentq
from scipy.sparse.linalg import LinearOperator
from scipy.special import jn_zeros, jv
from support.plates import on_sides, square
from support.tiers import stories_except

import fecloth as fc
from fecloth.errors import IndefiniteMatrix
from fecloth.linalg.block_matrix import BlockMatrix
from fecloth.linalg.low_rank_update import LowRankUpdate
from fecloth.linalg.select import direct
from fecloth.nonlinear.eigenpairs import find_all, least_eigenpairs
from studies.references.plates import square_frequencies

# steps are coarse and meshes small by intent
pytestmark = [
    pytest.mark.stories,
    pytest.mark.filterwarnings("ignore::fecloth.errors.FeclothWarning"),
]

DRUM = fc.Fabric(areal_density=0.2, tensile_stiffness=1e4, poisson_ratio=0.3)
ORDERS = {"P1": 2.0, "P2": 4.0}


def dense(system, state, unit_mass=False):
    """All eigenvalues and vectors of the free directions, by LAPACK."""
    Z, K = system.admissible, system.stiffness(state).toarray()
    for c, u in system.dense(state):
        K += c * np.outer(u.ravel(), u.ravel())
    K = Z.T @ (0.5 * (K + K.T)) @ Z
    M = np.eye(len(K)) if unit_mass else (Z.T @ system.mass @ Z).toarray()
    return eigh(K, M)


def orders(errors):
    """Observed order of each mode, of errors on two meshes of which the second is half as fine."""
    return np.log2(np.divide(*errors))


def omega2(system, state, count):
    return fc.modes(system, state, count=count).eigenvalues


# --- membranes ------------------------------------------------------------------------------------


def tension(stretch=1.01):
    """The stress resultant [N/m] of a drum that is stretched alike in both directions."""
    return DRUM.tensile[0] / (1 - DRUM.poisson_ratio) * (stretch**2 - 1) / 2


def drum(cloth, *terms, stretch=1.01, strain="interpolated"):
    """A pinned membrane, stretched alike in both directions, and its state."""
    membrane = fc.StVK(strain=strain)
    system = fc.System(cloth, DRUM, [membrane, *terms], ["boundary"], mass="consistent")
    return system, system.state(flat(cloth) * [stretch, stretch, 1.0])


def errors_on(sizes, make, exact):
    """Relative errors of the lowest ω² of a system and its state on meshes of these sizes."""
    return [omega2(*make(h), len(exact)) / exact - 1 for h in sizes]


@pytest.mark.parametrize(
    ("element", "pattern"),
    [("P1", "cross"), ("P2", "cross"), ("P1", "equilateral"), ("P2", "right")],
)
def test_square_drum(element, pattern):
    """T (m² + n²) π²/ρ with every repeated one, in order 2 and 4."""
    squares = sorted(m * m + n * n for m in range(1, 9) for n in range(1, 9))[:8]
    errors = errors_on(
        (1 / 10, 1 / 20) if pattern == "cross" else (1 / 16, 1 / 32),
        lambda h: drum(fc.Cloth.rectangle(1.0, 1.0, h, pattern, element)),
        np.array(squares) * tension() / 0.2 * math.pi**2,
    )
    assert np.min(errors) > 0  # the consistent mass: from above
    np.testing.assert_allclose(orders(errors), ORDERS[element], atol=0.15)


def strip_spectrum(length, width, stretches, moduli, rho, count):
    """All ω² of a strip that slides along its sides: for each n, m one across, two in its plane."""
    (a, b), (C11, C12, C22, C66) = stretches, moduli
    E1, E2 = (a * a - 1) / 2, (b * b - 1) / 2
    S1, S2 = C11 * E1 + C12 * E2, C12 * E1 + C22 * E2
    result = []
    for n in range(16):
        for m in range(16):
            k, q = n * math.pi / length, m * math.pi / width
            across = S1 * k * k + S2 * q * q
            if n:
                result.append(across)
            A = C11 * a * a * k * k + C66 * a * a * q * q + across
            B = C22 * b * b * q * q + C66 * b * b * k * k + across
            D = a * b * k * q * (C12 + C66)
            plane = np.linalg.eigvalsh([[A, D], [D, B]])
            result += plane.tolist() if n and m else [A] if n else [B] if m else []
    return np.sort(result)[:count] / rho


@pytest.mark.parametrize("element", ["P1", "P2"])
def test_taut_strip_with_its_modes_in_the_plane(element):
    """u = (A sin kX cos qY, B cos kX sin qY, C sin kX cos qY) solve the linearised balance."""
    length, width, rho, stretches = 1.0, 0.5, 0.2, np.array([1.3, 1.1])
    fabric = fc.Fabric(rho, 100.0, 0.3)
    C = 100.0 / (1 - 0.3**2)
    moduli = C, 0.3 * C, C, 100.0 / (2 * 1.3)
    X0, Y0 = (lambda X: np.isin(X[:, 0], [0.0, length])), (lambda X: np.isin(X[:, 1], [0.0, width]))
    pins = [
        fc.Pin(lambda X: X0(X) & Y0(X)),
        fc.Slide(lambda X: X0(X) & ~Y0(X), direction=(0, 1, 0)),
        fc.Slide(lambda X: Y0(X) & ~X0(X), normal=(0, 1, 0)),
    ]

    def taut(h):
        cloth = fc.Cloth.rectangle(length, width, h, "right", element)
        system = fc.System(cloth, fabric, [fc.StVK()], pins, mass="consistent")
        return system, system.state(flat(cloth) * [*stretches, 1.0])

    sizes = (1 / 16, 1 / 32) if element == "P1" else (1 / 10, 1 / 20)
    exact = strip_spectrum(length, width, stretches, moduli, rho, 12)
    in_plane = abs(fc.modes(*taut(sizes[1]), count=12).shapes[:, :, :2]).max(axis=(1, 2)) > 1e-6
    assert 0 < in_plane.sum() < 12  # both kinds are among them
    np.testing.assert_allclose(orders(errors_on(sizes, taut, exact)), ORDERS[element], atol=0.2)


@pytest.mark.parametrize("strain", ["interpolated", "pointwise"])
def test_round_drum_of_quadratic_triangles(strain):
    """T j²/(ρ a²) with the zeros j of J₀ and J₁, in order 4: the edges follow the circle."""
    a = 0.5
    exact = np.array([jn_zeros(0, 1)[0], *[jn_zeros(1, 1)[0]] * 2]) ** 2 * tension() / 0.2 / a**2
    errors = errors_on(
        (0.1, 0.05), lambda h: drum(fc.Cloth.disk(a, h, element="P2"), strain=strain), exact
    )
    assert np.max(errors[-1]) < 3e-5
    assert (orders(errors) > 3.5).all()


def test_kettledrum_of_gas_meets_its_characteristic_equation():
    """T k² J₀(ka) + κ π a² J₂(ka) = 0 with κ = γ p/V: J₀(kr) − J₀(ka) balances its own pressure."""
    a, depth, p, stretch = 0.5, 1.0, 2000.0, 1.01
    volume = math.pi * a**2 * stretch**2 * depth / 3  # the cone to `origin`
    gas = fc.Gas(p, volume, ambient=p, exponent=1.4, origin=(0.0, 0.0, -depth))
    kappa = 1.4 * p / volume * stretch**4  # u is the area of the stretched cloth over that at rest
    T = tension(stretch)

    def equation(ka):
        return T * (ka / a) ** 2 * jv(0, ka) + kappa * math.pi * a**2 * jv(2, ka)

    symmetric = brentq(equation, 2.5, 5.2)
    pair = jn_zeros(1, 1)[0]
    assert symmetric > 1.1 * jn_zeros(0, 1)[0]  # the gas makes it stiffer
    exact = np.sort([symmetric, pair, pair]) ** 2 * T / (0.2 * a**2)
    errors = errors_on(
        (0.1, 0.05), lambda h: drum(fc.Cloth.disk(a, h), gas, stretch=stretch), exact
    )
    assert np.max(np.abs(errors[-1])) < 0.02
    assert (orders(np.abs(errors)) > 1.7).all()


def test_hanging_strip_swings_as_a_chain():
    """f = j₀,ₙ √(g/L) / 4π across a strip that hangs under its own weight (D. Bernoulli 1733)."""
    length, errors = 1.0, []
    exact = jn_zeros(0, 3) * math.sqrt(9.81 / length) / (4 * math.pi)
    for h in (0.05, 0.025):
        cloth = fc.Cloth.rectangle(h, length, h, "right", "P2")
        pins = ["top", fc.Slide(lambda X: X[:, 1] < length - 1e-9, normal=(1, 0, 0))]
        terms = [fc.StVK(), fc.Gravity((0.0, -9.81, 0.0))]
        system = fc.System(cloth, fc.Fabric(0.2, 1e5), terms, pins)
        result = fc.modes(system, fc.equilibrium(system, system.rest(), tolerance=1e-8), count=9)
        nearest = abs(result.frequencies[:, None] - exact).min(axis=0)  # its edges also swing apart
        errors.append(nearest / exact)
        assert result.verdict.startswith("stable")
    assert errors[-1].max() < 1e-3
    assert (errors[-1] < errors[0])[1:].all()


# --- plates ---------------------------------------------------------------------------------------

D = [[1.0, 0.3, 0.0], [0.3, 1.0, 0.0], [0.0, 0.0, 0.35]]
PLATE = fc.Fabric(1.0, 1e5, bending_rigidity=1.0, bending_poisson_ratio=0.3)


def plate_rates(cloth, pins, count):
    system = fc.System(cloth, PLATE, [fc.StVK(), fc.PlateBending()], pins, mass="consistent")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return fc.modes(system, system.rest(), count=count)


@pytest.mark.parametrize(
    ("element", "pattern"),
    [("P1", "cross"), ("P2", "cross"), ("P1", "unstructured"), ("P2", "jittered")],
)
def test_plates(element, pattern):
    """Free (Leissa 1973: 13.468, 19.596, 24.271), supported 2π², 5π², 5π², clamped by Ritz."""
    exact = {
        "free": [13.4682, 19.5961, 24.2702],
        "supported": np.array([2, 5, 5]) * math.pi**2,
        "clamped": square_frequencies(np.array(D), "clamped", 3),
    }
    assert exact["clamped"][0] == pytest.approx(35.985, abs=2e-3)
    pins = {"free": [], "supported": [fc.Pin(on_sides)], "clamped": [fc.Pin(on_sides, clamp=True)]}
    for name, held in pins.items():
        errors = []
        for n in (6, 12) if element == "P2" else (8, 16) if pattern == "cross" else (16, 32):
            cloth = square(pattern, n)
            if element == "P2":
                cloth = fc.Cloth.from_arrays(cloth.X, cloth.triangles, element="P2")
            rigid = 0 if held else 6
            result = plate_rates(cloth, held, rigid + 3)
            assert (abs(result.frequencies[:rigid]) <= result.zero).all(), name
            rates = 2 * math.pi * result.frequencies[rigid:]
            errors.append(abs(rates / exact[name] - 1))
        assert errors[-1].max() < (0.03 if held else 2e-3)
        tiny = errors[-1] < 5e-4  # where errors change their sign, they have no order
        assert ((orders(errors) > 1.8) | tiny).all(), name


# --- any system -----------------------------------------------------------------------------------


def free_sheet(*terms, pins=(), mass="lumped", h=0.25):
    cloth = fc.Cloth.rectangle(1.0, 0.75, h, "right")
    fabric = fc.Fabric(0.2, 1e3, 0.3, bending_rigidity=1e-2)
    return fc.System(cloth, fabric, terms, pins, mass)


TERMS = {
    "membranes": [fc.StVK(), fc.NeoHookean(), fc.TensionField(), fc.TensorCondition(50.0)],
    "Baraff–Witkin": [fc.BaraffWitkin((1e3, 1e3), 1e2), fc.QuadraticBending()],
    "hinges": [fc.StVK(), fc.HingeBending(), fc.BendingDamping(0.1)],
    "plate": [fc.StVK(), fc.PlateBending(), fc.StrainRateDamping(0.01), fc.MassDamping(1.0)],
    "springs": [
        fc.Springs(),
        fc.Tether("left", (0.1, 0, 0.3), 1e3),
        fc.PointForce("right", (0.1, 0.0, 0.2)),
    ],
    "loads": [fc.StVK(), fc.Gravity(), fc.Pressure(20.0), fc.Gas(1.2e5, 0.2, origin=(0, 0, -1.0))],
    "air": [fc.StVK(), fc.Drag(1.0), fc.Wind(normal=1.0, velocity=(3.0, 0.0, 2.0))],
}
SLIDES = [fc.Slide("left", normal=(1, 2, 3)), fc.Slide("right", direction=(1, 1, 0))]


@pytest.mark.parametrize("mass", stories_except(["lumped", "consistent"], "lumped"))
@pytest.mark.parametrize("name", TERMS)
def test_every_term_agrees_with_a_dense_solution(name, mass, rng):
    """At a rough state, on oblique slides, with negative eigenvalues too."""
    system = free_sheet(*TERMS[name], pins=SLIDES, mass=mass)
    x = flat(system.cloth) * [1.1, 1.05, 1.0] + 0.02 * rng.standard_normal((len(system.cloth.X), 3))
    state = system.state(x, rng.standard_normal(x.shape))
    still = system.state(x)
    for unit in (False, True):
        exact, _ = dense(system, still, unit)
        result = least_eigenpairs(system, state, 7, unit)
        np.testing.assert_allclose(result.values, exact[:7], rtol=1e-7, atol=1e-10 * exact[-1])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # unstable
        U = fc.modes(system, still, count=7).shapes.reshape(7, -1)
    np.testing.assert_allclose(U @ system.mass @ U.T, np.eye(7), atol=1e-8)
    held = system.constraints.held_part
    assert max(abs(held(shape)).max() for shape in U.reshape(7, -1, 3)) < 1e-12 * abs(U).max()


def test_exact_tangents_that_are_not_symmetric_count_with_their_symmetric_part():
    system = free_sheet(fc.StVK(), fc.Pressure(50.0, "exact"), pins=["left"])
    X = system.cloth.X
    bent = system.state(np.column_stack([1.05 * X[:, 0], X[:, 1], 0.3 * X[:, 0] ** 2]))
    with pytest.warns(fc.FeclothWarning, match=r"the stiffness is not symmetric \(by 0\.0"):
        result = fc.modes(system, bent, count=4)
    np.testing.assert_allclose(result.eigenvalues, dense(system, bent)[0][:4], rtol=1e-8)
    held = free_sheet(fc.StVK(), fc.Pressure(50.0, "exact"), pins=["boundary"])
    with pytest.warns(fc.FeclothWarning, match="not in equilibrium"):
        at_edge = fc.modes(held, held.state(1.05 * flat(held.cloth)), count=2)
    assert len(at_edge.warnings) == 1  # with a held edge it is symmetric


@pytest.mark.parametrize(("copies", "count"), [(5, 5), (8, 12), (20, 15), (1, 39)])
def test_eigenvalues_with_many_vectors_are_all_found(copies, count):
    """Lanczos' iteration from one vector finds three of five equal ones and then the next."""
    values = np.repeat(np.arange(1.0, 41.0) ** 2, copies)
    inverse = LinearOperator((len(values),) * 2, lambda b: b.ravel() / (values + 1), dtype=float)
    result, vectors = find_all(inverse, sparse.identity(len(values), format="csr"), 1.0, count)
    np.testing.assert_allclose(result, values[:count], rtol=1e-10)
    np.testing.assert_allclose(vectors.T @ vectors, np.eye(count), atol=1e-10)


# --- what has no or negative stiffness ------------------------------------------------------------


def test_a_free_sheet_has_six_rigid_modes():
    system = free_sheet(fc.StVK(), fc.PlateBending())
    result = fc.modes(system, system.rest(), count=8)
    assert (abs(result.frequencies[:6]) < result.zero).all()
    assert result.zero < 0.01 < result.frequencies[6]
    assert result.verdict.startswith(
        "6 modes have no stiffness; of the others the lowest frequency"
    )
    flat_only = free_sheet(fc.StVK())
    assert "none of the 5" in fc.modes(flat_only, flat_only.rest(), count=5).verdict
    nothing = free_sheet(fc.Gravity(), pins=["left"])
    assert (abs(fc.modes(nothing, nothing.rest(), count=3).frequencies) < 1e-10).all()


def test_a_state_that_is_no_equilibrium_is_warned_of():
    system = free_sheet(fc.StVK(), fc.Gravity(), pins=["boundary"])
    tight = system.state(flat(system.cloth) * [1.001, 1.001, 1.0])
    words = r"not in equilibrium \([\d.]+ % of the forces are not balanced\)"
    with pytest.warns(fc.FeclothWarning, match=words):
        fc.modes(system, tight, count=2)
    with warnings.catch_warnings():
        warnings.filterwarnings("error", message="the state is not in equilibrium")
        fc.modes(system, fc.equilibrium(system, tight), count=2)


def test_a_buckled_plate_is_unstable():
    """ρ ω² = D k⁴ − N k², k² = π² (m² + n²), of a supported plate under the pressure N [N/m]."""
    squeeze, B, rho = 0.9999, 1e-3, 0.2
    fabric = fc.Fabric(rho, 1e3, bending_rigidity=B)
    cloth = fc.Cloth.rectangle(1.0, 1.0, 1 / 24, "cross")
    system = fc.System(cloth, fabric, [fc.StVK(), fc.PlateBending()], ["boundary"], "consistent")
    state = system.state(flat(cloth) * [squeeze, squeeze, 1.0])
    k2 = math.pi**2 * np.sort([m * m + n * n for m in range(1, 9) for n in range(1, 9)])
    exact = np.sort(B * k2**2 + 1e3 * (squeeze**2 - 1) / 2 * k2)[:4] / rho
    assert exact[0] < 0
    with pytest.warns(fc.FeclothWarning, match="the state is unstable: ω² = -"):
        result = fc.modes(system, state, count=4)
    np.testing.assert_allclose(result.eigenvalues, exact, atol=0.01 * B * k2[4] ** 2 / rho)
    assert result.unstable == (exact < 0).sum()
    np.testing.assert_allclose(
        result.frequencies[0], -math.sqrt(-exact[0]) / 2 / math.pi, rtol=0.02
    )
    assert re.match(r"unstable: \d of the 4 lowest modes grow, the first by", result.verdict)
    assert result.warnings[0].startswith("the state is unstable")


def test_a_part_of_low_rank_can_make_a_matrix_indefinite(rng):
    system = free_sheet(fc.StVK(), fc.PlateBending(), pins=["boundary"])
    K = system.project(system.assemble(BlockMatrix.zeros(system.pattern), system.rest(), wx=1.0))
    solver, u = direct(), system.constraints.project(rng.standard_normal((len(system.cloth.X), 3)))
    solver.prepare(K)
    z, _ = solver.solve(u)
    limit = -1 / np.vdot(u, z)  # K + c u uᵀ is singular
    for c, definite in ((0.99 * limit, True), (1.01 * limit, False), (-limit, True)):
        update = LowRankUpdate.prepare(solver, [(c, u)], 1e-10)
        if definite:
            update.require_definite([(c, u)])
        else:
            with pytest.raises(IndefiniteMatrix):
                update.require_definite([(c, u)])


# --- what is returned and written -----------------------------------------------------------------


@pytest.mark.parametrize("element", ["P1", "P2"])
def test_files_show_the_shapes(tmp_path, element):
    cloth = fc.Cloth.rectangle(1.0, 1.0, 0.25, "cross", element)
    system, tight = drum(cloth)
    result = fc.modes(system, tight, count=3)
    pvd = result.write(tmp_path / "modes")
    assert pvd.name == "modes.pvd"
    assert pvd.read_text().count("<DataSet") == 3
    for i, shape in enumerate(result.shapes):
        frame = meshio.read(pvd.parent / f"frames/mode_{i:06d}.vtu")
        shown = frame.point_data["shape"]
        assert np.linalg.norm(shown, axis=1).max() == pytest.approx(1.0)
        np.testing.assert_allclose(np.cross(shown, shape), 0, atol=1e-12 * abs(shape).max())
        np.testing.assert_allclose(frame.points - tight.x, 0.1 * cloth.extent * shown, atol=1e-12)
    result.report(pvd.parent)
    head, *rows = (pvd.parent / "results.csv").read_text().splitlines()
    assert head == "mode,frequency [Hz],eigenvalue [1/s²]"
    assert [float(row.split(",")[1]) for row in rows] == result.frequencies.tolist()


def test_the_modes_say_what_they_are():
    system, tight = drum(fc.Cloth.rectangle(1.0, 1.0, 0.25, "cross"))
    result = fc.modes(system, tight, count=7)
    assert re.match(r"<7 modes: ([\d.]+, ){6}… Hz; stable: the lowest frequency is", repr(result))
    assert result._repr_html_().count("<tr>") == 8
    assert result.table["frequency [Hz]"] == result.frequencies.tolist()
    again = fc.modes(system, tight, count=7)
    np.testing.assert_array_equal(result.shapes, again.shapes)
    other = fc.modes(system, system.state(tight.x, tight.x), count=7)  # the velocity does not count
    np.testing.assert_array_equal(result.shapes, other.shapes)
