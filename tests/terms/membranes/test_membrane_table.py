"""Measured curves as a membrane: an independent W, the points, refusals, and beyond the points."""

import numpy as np
import pytest
import scipy
import scipy.optimize
from conftest import rough
from scipy.integrate import quad
from support.planned import warnings_before
from support.tiers import stories_except

import fecloth as fc
from fecloth.errors import FeclothWarning, InputError
from fecloth.terms.membranes.curves import LEAST_END_SLOPE, Curve
from fecloth.terms.membranes.table import law

KNOTS = 'terms.0.warp={ stretch = [1.05, 1.1, 1.15], "stiffness" = [20.0, 60.0, 300.0] }'


FABRIC = fc.Fabric(0.2, (1000.0, 400.0), 0.3, 60.0)
J = np.array([(1.05, 2.0), (1.1, 5.0), (1.2, 20.0), (1.25, 45.0), (1.3, 120.0)])
SOFTER = np.array([(1.05, 8.0), (1.12, 16.0), (1.3, 33.0)])
LOCKING = np.array([(0.1, 0.5), (0.3, 2.0), (0.5, 6.0), (0.7, 40.0)])
TABLE = fc.MembraneTable(J, SOFTER, LOCKING, 0.1)
SQUARE = fc.Cloth.rectangle(1.0, 1.0, h=0.5, pattern="right")


def stress(rows, E, shear=False):
    """S and w of a curve at E, by scipy alone."""
    rows = np.vstack([[0.0 if shear else 1.0, 0.0], rows])
    at, S = rows[:, 0], rows[:, 1] / (np.cos(rows[:, 0]) if shear else rows[:, 0])
    e = np.sin(at) if shear else (at**2 - 1) / 2
    curve = scipy.interpolate.PchipInterpolator(e, S)
    size, sign = (abs(E), np.sign(E)) if shear else (E, 1.0)
    inside = np.clip(size, 0.0, e[-1])
    more, slope = size - inside, curve(inside, 1)
    w = curve.antiderivative()(inside) + more * curve(inside) + slope * more**2 / 2
    return sign * (curve(inside) + slope * more), w, slope


def test_stress_energy_and_moduli_are_those_of_the_curves(rng):
    """In compression, between the points and beyond them; c couples warp and weft."""
    c = TABLE.constants(FABRIC)
    coupling = 0.1 * np.sqrt(stress(J, 0.0)[2] * stress(SOFTER, 0.0)[2])
    assert TABLE.moduli(FABRIC)[3] == pytest.approx(coupling)
    for E in rng.uniform([-0.2, -0.2, -0.45], [0.5, 0.5, 0.45], (60, 3)):
        parts = stress(J, E[0]), stress(SOFTER, E[1]), stress(LOCKING, 2 * E[2], shear=True)
        W, S, C = law(tuple(E), c)
        S1, S2, S12 = (part[0] for part in parts)
        expected = S1 + coupling * E[1], S2 + coupling * E[0], S12
        np.testing.assert_allclose(S, expected, rtol=1e-12, atol=1e-12)
        assert pytest.approx(sum(part[1] for part in parts) + coupling * E[0] * E[1]) == W
        np.testing.assert_allclose(C, [*(part[2] for part in parts), coupling, 0, 0], rtol=1e-11)


def test_a_strip_with_free_sides_bears_the_force_that_it_was_measured_with():
    """S22 = 0 leaves E22 < 0 free; both directions, at the points and between them."""
    c = fc.MembraneTable(J, SOFTER, LOCKING, 0.4, sides="free").constants(FABRIC)
    for rows, along in ((J, 0), (SOFTER, 1)):
        for E in (0.01, (1.1**2 - 1) / 2, 0.2, 0.3):
            order = [0, 1] if along == 0 else [1, 0]

            def stresses(across, E=E, order=order):
                strain = np.array([E, across])[order]
                return np.array(law((*strain, 0.0), c)[1])[order]

            free = scipy.optimize.brentq(lambda e, of=stresses: of(e)[1], -2.0, 0.0)
            assert stresses(free)[0] == pytest.approx(stress(rows, E)[0], rel=1e-9)


@pytest.mark.parametrize("crowd", [1e-5, 1e-3, 0.03])
def test_points_that_crowd_have_their_pieces(crowd, rng):
    """Many points in one of the equal cells, one in most, and none; strains near the points."""
    at = np.cumsum(np.concatenate([crowd * rng.uniform(0.5, 2, 7), [0.2], crowd * np.ones(5)]))
    E = ((1 + at) ** 2 - 1) / 2
    rows = np.column_stack([1 + at, (1 + at) * (10 * E + 40 * E**2)])
    c = fc.MembraneTable(rows, rows).constants(FABRIC)
    near = np.concatenate([E + each * crowd for each in (-0.3, -1e-12, 0, 1e-12, 0.3)])
    for e in np.concatenate([near, rng.uniform(0, 1.2 * E[-1], 50)]):
        S, w, slope = stress(rows, e)
        W, (_, S2, _), (_, C22, *_) = law((0.0, e, 0.0), c)
        assert pytest.approx(S, rel=1e-9) == S2
        assert pytest.approx(float(w), rel=1e-9) == W
        assert pytest.approx(float(slope), rel=1e-6) == C22


def test_shear_has_the_work_of_its_force_over_the_angle():
    """Warp and weft keep their length; ∫ τ dγ by quadrature, and τ at every point."""
    system = fc.System(SQUARE, FABRIC, [TABLE])

    def energy(angle):
        x = system.rest().x
        x[:, 0] += np.sin(angle) * x[:, 1]
        x[:, 1] *= np.cos(angle)
        return sum(system.energies(system.state(x)).values())

    def tau(angle):
        return stress(LOCKING, np.sin(angle), shear=True)[0] * np.cos(angle)

    for angle, force in LOCKING:
        assert tau(angle) == pytest.approx(force)
        assert energy(angle) == pytest.approx(quad(tau, 0.0, angle, epsrel=1e-10)[0], rel=1e-8)
        assert energy(-angle) == pytest.approx(energy(angle), rel=1e-13)


@pytest.mark.parametrize("element", ["P1", "P2"])
def test_straight_curves_are_stvk(element, rng):
    """From the fabric, and with points on S = C E."""
    cloth = fc.Cloth.rectangle(1.0, 1.0, h=0.5, element=element)
    C, s, g = FABRIC.moduli(), np.linspace(1.01, 1.4, 7), np.linspace(0.02, 1.2, 5)
    points = [np.column_stack([s, C[i] * s * (s**2 - 1) / 2]) for i in (0, 1)]
    points += [np.column_stack([g, C[2] * np.sin(g) * np.cos(g)])]
    x = rough(cloth, rng, 0.02)
    systems = [
        fc.System(cloth, FABRIC, [term])
        for term in (fc.StVK(), fc.MembraneTable(), fc.MembraneTable(*points))
    ]
    forces = [system.force(system.state(x)) for system in systems]
    matrices = [system.stiffness(system.state(x)).toarray() for system in systems]
    for f, K in zip(forces[1:], matrices[1:], strict=True):
        np.testing.assert_allclose(f, forces[0], atol=1e-12 * abs(forces[0]).max())
        np.testing.assert_allclose(K, matrices[0], atol=1e-11 * abs(matrices[0]).max())


# --- what a user may give -------------------------------------------------------------------------


@pytest.mark.parametrize("linearity", [0.5, 0.8, 1.0, 1.1])
def test_a_kes_sheet_has_its_force_extension_and_work(linearity):
    """LT = WT/(Fm EMT/2) and Fm = 500 gf/cm at EMT; 1 is a straight line."""
    sheet = {"EMT": (4.0, 6.0), "LT": (linearity, 0.7), "G": (0.8, 0.6), "W": 20.0}
    table = fc.MembraneTable(sheet, sheet, sheet)
    s, P = np.array(table.warp).T
    assert (s[-1], P[-1]) == pytest.approx((1.04, 490.3325))
    assert scipy.interpolate.PchipInterpolator(s, P).integrate(1.0, 1.04) == pytest.approx(
        linearity * 490.3325 * 0.04 / 2, rel=1e-3
    )
    assert table.weft[-1] == pytest.approx((1.06, 490.3325))
    if linearity == 1.0:
        np.testing.assert_allclose(P, 490.3325 * (s - 1) / 0.04, rtol=1e-6)
    G = 0.7 * 0.980665 * 180 / np.pi
    assert table.shear[-1] == pytest.approx((np.radians(8), G * np.radians(8)))


@pytest.mark.parametrize(("name", "most"), [("warp", 4.0), ("weft", 4.0), ("shear", np.pi / 2)])
def test_percent_and_degrees_are_refused(name, most):
    """Stretches from 4 on, and angles from π/2 on."""
    fc.MembraneTable(**{name: [(0.6 * most, 1.0), (0.8 * most, 90.0)]})
    with pytest.raises(InputError, match="row 2.*(with 5 % strain 1.05|degrees have the column)"):
        fc.MembraneTable(**{name: [(0.6 * most, 1.0), (1.25 * most, 90.0)]})


# --- slopes at the ends, and the coupling ---------------------------------------------------------


@pytest.mark.parametrize(("share", "slope"), [(0.8, 1.0), (1.25, 1.25), (-20.0, 1.0)])
def test_a_steep_j_keeps_a_stiffness_at_rest(share, slope):
    """PCHIP has (3 δ₀ − δ₁)/2 at rest, or 0 where that is negative; the least is a share of δ₀."""
    first, second = 10.0, 10.0 * (3 - 2 * share * LEAST_END_SLOPE)
    data = {"stretch": np.sqrt([1.2, 1.4]), "stiffness": [first, second]}
    curve = Curve.through("warp", fc.MembraneTable(data).warp)
    assert curve.rest == pytest.approx(slope * LEAST_END_SLOPE * first)


SLOPES = {
    "least inside the first piece": (2.0, 1.5, 3.0),
    "least inside the second piece": (3.0, 3.0, 1.0),
    "least at the first point": (0.8, 1.2, 1.6),
    "least at the end": (1.2, 1.0, 0.3),
}


@pytest.mark.parametrize("slopes", SLOPES.values(), ids=SLOPES.keys())
def test_the_least_slope_is_found_inside_a_piece_too(slopes):
    """Against the least one of many samples, for cubics whose slopes have a vertex, or none."""
    E, S = np.array([0.0, 1.0, 1.5]), np.array([0.0, 1.0, 1.7])
    curve = Curve(E, S, np.array(slopes), end=1.5)
    sampled = scipy.interpolate.CubicHermiteSpline(E, S, slopes)(np.linspace(0.0, 1.5, 30001), 1)
    assert curve.least_slope() == pytest.approx(sampled.min(), abs=1e-8)


def test_curves_are_convex_in_strain_and_coupling_is_lowered_to_keep_w_so(rng):
    """Softening curves: c is √(min S₁′ min S₂′), found by a search, and ℂ stays semi-definite."""
    curve = Curve.through("warp", fc.MembraneTable(SOFTER).warp)
    E = np.linspace(0.0, curve.E[-1], 20001)
    assert curve.least_slope() == pytest.approx(stress(SOFTER, E)[2].min(), rel=1e-6)
    table = fc.MembraneTable(SOFTER, SOFTER, poisson=0.9)
    c, C = table.constants(FABRIC), table.moduli(FABRIC)
    assert C[3] == pytest.approx(curve.least_slope()) != pytest.approx(0.9 * curve.rest)
    for strain in rng.uniform(-0.2, 0.6, (200, 3)):
        C11, C22, C66, C12, *_ = law(tuple(strain), c)[2]
        assert C66 > 0
        assert min(C11, C22) > 0
        assert C11 * C22 >= (1 - 1e-12) * C12**2


@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize("factor", [0.8, 1.25])
def test_a_lowered_poisson_ratio_is_said(factor, sign):
    curve = Curve.through("warp", fc.MembraneTable(SOFTER).warp)
    limit = factor * curve.least_slope() / curve.rest
    table = fc.MembraneTable(SOFTER, SOFTER, poisson=sign * limit)
    answer = warnings_before(fc.System(SQUARE, FABRIC, [table], ["left"]), 0.01)
    assert ["poisson is lowered by a factor of 0.8" in words for words in answer] == [True] * (
        factor > 1
    )
    assert np.sign(table.moduli(FABRIC)[3]) == sign


# --- beyond the last point ------------------------------------------------------------------------


@pytest.mark.parametrize("rows", ["warp", "weft", "shear"])
@pytest.mark.parametrize("factor", [0.8, 1.25])
def test_an_equilibrium_beyond_a_curve_warns(rows, factor):
    table = fc.MembraneTable(**{rows: LOCKING if rows == "shear" else J})
    x = np.column_stack([SQUARE.X, np.zeros(len(SQUARE.X))])
    end = np.sin(LOCKING[-1, 0]) if rows == "shear" else (J[-1, 0] ** 2 - 1) / 2
    if rows == "shear":
        x[:, 0] -= factor * end * SQUARE.X[:, 1]
    else:
        x[:, ("warp", "weft").index(rows)] *= np.sqrt(1 + 2 * factor * end)
    system = fc.System(SQUARE, FABRIC, [table], ["boundary"])
    start = system.state(x)
    if factor < 1:
        assert not fc.equilibrium(system, start).warnings
        return
    with pytest.warns(FeclothWarning, match="beyond the measured curve on 100 % of the area:"):
        fc.equilibrium(system, start)


@pytest.mark.parametrize("element", stories_except(["P1", "P2"], "P1"))
def test_a_run_counts_area_and_time_beyond_a_curve(element):
    """u = a X² t: E11 is beyond where X > X₀/t; at the end on a quarter, since t = 0.75."""
    last = J[-1, 0]
    cloth = fc.Cloth.rectangle(1.0, 0.25, h=0.025, pattern="right", element=element)
    motion = (f"{(last - 1) / 1.5} * X**2 * t", 0, 0)
    hold = fc.Pin(lambda X: X[:, 0] >= 0, motion=motion)
    system = fc.System(cloth, FABRIC, [fc.MembraneTable(J)], [hold], mass="lumped")
    with pytest.warns(FeclothWarning, match=r"on 2\d % of the area, 0.25 s: there it goes on"):
        result = fc.run(system, fc.BackwardEuler(), system.rest(), dt=0.05, t_end=1.0)
    answer = result.figures["beyond_curve"]
    assert answer["area"] == pytest.approx(0.25, abs=0.03)


# --- in scenes, studies and runs ------------------------------------------------------------------

SCENE = """
[cloth]
shape = "rectangle"
width = 0.2
height = 0.05
h = 0.05
pattern = "right"
[fabric]
areal_density = 0.2
tensile_stiffness = 100.0
[[terms]]
type = "MembraneTable"
warp = "warp.csv"
poisson = 0.0
[[pins]]
where = "left"
[[pins]]
where = "right"
name = "grip"
motion = ["0.03 * t", 0, 0]
[[probes]]
name = "grip"
where = "right"
[equilibrium]
load_steps = 3
"""
CSV = "stretch,force\n1.05,2.0\n1.1,5.0\n1.15,12.0\n"


@pytest.fixture
def scene_file(tmp_path):
    (tmp_path / "warp.csv").write_text(CSV)
    (tmp_path / "strip.toml").write_text(SCENE)
    return tmp_path / "strip.toml"


def test_a_scene_keeps_the_rows_of_its_file(scene_file):
    scene = fc.load_scene(scene_file)
    rows = [[1.0, 0.0], [1.05, 2.0], [1.1, 5.0], [1.15, 12.0]]
    assert scene.to_tables()["terms"][0]["warp"] == rows
    (scene_file.parent / "warp.csv").write_text(CSV.replace("5.0", "2.05"))
    with pytest.raises(fc.SceneError, match=r"line 3: S = force/stretch = 1.86364 after 1.90476"):
        fc.load_scene(scene_file)
    with pytest.raises(fc.SceneError, match=r"terms.0.warp = 'wrap.csv'.*Did you mean 'warp.csv'"):
        fc.load_scene(scene_file, ["terms.0.warp=wrap.csv"])


def test_the_force_at_a_point_follows_its_row_alone(scene_file):
    """A strip drawn to the last point: dF/dP is its width there, and 0 for other rows."""
    names = [f"terms.0.warp.{row}.1" for row in (2, 3)]
    answer = fc.sensitivity(scene_file, names, "reaction.grip.x")
    assert answer.value == pytest.approx(12.0 * 0.05)
    np.testing.assert_allclose(answer.derivative, [0.0, 0.05], atol=1e-6)


@pytest.mark.parametrize("element", ["P1", "P2"])
def test_a_strip_bears_the_measured_force_at_every_point(element):
    """Drawn along warp or weft with ν = 0, to 1e-8 of the largest force."""
    cloth = fc.Cloth.rectangle(1.0, 1.0, h=0.5, element=element)
    table = fc.MembraneTable(J, SOFTER, poisson=0.0)
    for rows, axis, side in ((J, 0, "right"), (SOFTER, 1, "top")):
        system = fc.System(cloth, FABRIC, [table])
        for stretch, force in rows:
            x = system.rest().x
            x[:, axis] *= stretch
            pull = -system.force(system.state(x))[cloth.nodes(side), axis].sum()
            assert pull == pytest.approx(force, abs=1e-8 * rows[-1, 1])


@pytest.mark.stories
def test_fit_chooses_a_rising_curve(scene_file):
    """Stiffnesses of a twin, from other ones, through the forces at nine stretches."""
    twin = fc.MembraneTable({"stretch": [1.05, 1.1, 1.15], "stiffness": [20.0, 60.0, 300.0]})
    s = np.linspace(1.015, 1.149, 9)
    E = (s**2 - 1) / 2
    data = {
        "drawn [m]": 0.2 * (s - 1),
        "force [N]": 0.05 * s * stress(np.array(twin.warp)[1:], E)[0],
    }
    scene = fc.load_scene(scene_file, [KNOTS, "equilibrium.load_steps=8"])
    how = {"along": {"drawn": "grip.x"}, "quantity": {"force": "reaction.grip.x"}, "sigma": "1 %"}
    start = {f"terms.0.warp.stiffness.{i}": k for i, k in enumerate((40.0, 40.0, 150.0))}
    answer = fc.fit([fc.Experiment(scene, data, **how)], start, refined=False)
    assert list(answer.values.values()) == pytest.approx([20.0, 60.0, 300.0], rel=2e-2)
    assert len(answer.identified) == 3
