"""`PlateBending` at large rotations, with rest shapes, clamps that turn, and seams."""

import numpy as np
import pytest
from support.plates import BENDING, PATTERNS, deflection, plate, rolled, square, uniform_load
from support.tiers import stories_except

import fecloth as fc
from fecloth.stability.critical_step import rate_bounds
from studies.references.elastica import heavy_elastica

ISOTROPIC = fc.Fabric(**BENDING, bending_poisson_ratio=0.3)


def crumpled(system, size, seed=0):
    x = system.rest().x
    return x + np.random.default_rng(seed).normal(0, size, x.shape)


@pytest.mark.parametrize("pattern", PATTERNS[:5])
@pytest.mark.parametrize("folded", [False, True], ids=["creased", "folded beyond right angles"])
def test_force_and_tangent_are_derivatives_of_the_energy(pattern, folded):
    fabric = fc.Fabric(1.0, 1e3, bending_rigidity=(2.0, 1.0), bending_poisson_ratio=0.2)
    cloth = square(pattern, 4)
    pins = [fc.Pin(lambda X: X[:, 0] < 1e-9, clamp=True)]
    system = fc.System(cloth, fabric, [fc.PlateBending(rest=0.3)], pins, grain=0.4)
    noise = np.random.default_rng(1).normal(0, 0.01, (len(cloth.X), 3))
    radius = (0.13 if pattern in ("right", "jittered") else 0.085) if folded else 10.0
    state = system.state(rolled(cloth.X, radius) + noise)
    largest = np.abs(fc.hinge_angles(cloth, state.x)).max()
    assert (largest > 1.6) == folded
    check_slopes(system, state)


def check_slopes(system, state):
    """The errors of central differences fall with the square of the step."""
    d, term = np.random.default_rng(5).normal(size=state.x.shape), system.bound[0]
    f, J = system.force(state), system.stiffness(state)
    errors = []
    for step in (4e-4, 1e-4):
        plus, minus = (system.state(state.x + s * step * d) for s in (1, -1))
        work = (term.energy(plus.x, 0.0) - term.energy(minus.x, 0.0)) / (2 * step)
        change = (system.force(plus) - system.force(minus)) / (2 * step)
        product = (J @ d.ravel()).reshape(-1, 3)
        errors.append([work + np.sum(f * d), np.abs(change + product).max()])
    assert np.abs(np.divide(*errors)) == pytest.approx([16, 16], rel=0.25)


@pytest.mark.parametrize("pattern", PATTERNS[:5])
def test_definite_tangent_has_no_negative_eigenvalue(pattern):
    from fecloth.linalg.block_matrix import BlockMatrix

    system = plate(square(pattern, 4), ISOTROPIC)
    state = system.state(crumpled(system, 0.1))
    J = system.assemble(BlockMatrix.zeros(system.pattern), state, wx=1.0, definite=True)
    values = np.linalg.eigvalsh(J.to_scipy().toarray())
    assert values[0] > -1e-12 * values[-1]


@pytest.mark.parametrize("pattern", PATTERNS)
def test_force_has_no_resultant_and_no_moment(pattern):
    system = plate(square(pattern, 5), ISOTROPIC)
    state = system.state(crumpled(system, 0.1))
    f = system.force(state)
    size = np.abs(f).sum()
    assert np.abs(f.sum(axis=0)).max() < 1e-13 * size
    assert np.abs(np.cross(state.x, f).sum(axis=0)).max() < 1e-13 * size


def test_bound_of_the_frequency_is_above_the_largest_eigenvalue():
    for pattern in PATTERNS:
        system = plate(square(pattern, 6), ISOTROPIC)
        M = np.repeat(system.nodal_mass, 3)
        K = system.stiffness(system.rest()).toarray() / np.sqrt(np.outer(M, M))
        largest = np.linalg.eigvalsh(K)[-1]
        assert largest <= rate_bounds(system)[0] * (1 + 1e-9) < 3 * largest


def test_rest_angles_of_the_start_need_a_start():
    with pytest.raises(fc.InputError, match=r"needs the start of the run.*start=state"):
        plate(square("right", 4), ISOTROPIC, rest="start")


@pytest.mark.parametrize("pattern", stories_except(["right", "cross", "unstructured"], "right"))
def test_seam_of_two_fabrics_converges_with_order_2(pattern):
    """A strip of two rigidities 1 and 10 in series, bent by its weight: w by two integrations."""
    errors = []
    for n in (16, 32):
        cloth = halves(pattern, n)
        soft, stiff = (fc.Fabric(1.0, 1e3, bending_rigidity=B) for B in (1.0, 10.0))
        fabric = {"soft": soft, "stiff": stiff}
        pins = ["left", "right"]
        system = fc.System(cloth, fabric, [fc.PlateBending()], pins)
        w = deflection(system, uniform_load(cloth))
        s, exact = two_part_beam(1.0, 10.0)
        errors.append(abs(w - np.interp(cloth.X[:, 0], s, exact)).max() / exact.max())
    assert errors[1] < 2e-3
    assert 1.8 < np.log2(errors[0] / errors[1]) < 2.3


def halves(pattern, n):
    cloth = fc.Cloth.rectangle(1.0, 0.5, 1 / n, pattern)
    if pattern == "unstructured":  # two meshes that share the nodes of the seam
        half = fc.Cloth.rectangle(0.5, 0.5, 1 / n, pattern)
        return mirrored(half)
    centre = cloth.X[cloth.triangles].mean(axis=1)
    soft = np.flatnonzero(centre[:, 0] < 0.5)
    stiff = np.flatnonzero(centre[:, 0] > 0.5)
    return named(cloth.X, cloth.triangles, soft, stiff)


def mirrored(half):
    X, T, n = half.X, half.triangles, len(half.X)
    seam = np.abs(X[:, 0] - 0.5) < 1e-9
    other = np.arange(n)
    other[~seam] = n + np.arange((~seam).sum())
    points = np.vstack([X, np.column_stack([1 - X[:, 0], X[:, 1]])[~seam]])
    flipped = other[T][:, ::-1]
    m = len(T)
    return named(points, np.vstack([T, flipped]), np.arange(m), m + np.arange(m))


def named(X, T, soft, stiff):
    ends = {"left": np.flatnonzero(X[:, 0] < 1e-9), "right": np.flatnonzero(X[:, 0] > 1 - 1e-9)}
    return fc.Cloth.from_arrays(X, T, sets=ends, regions={"soft": soft, "stiff": stiff})


def two_part_beam(first, second):
    """(s, w) of a beam of two rigidities, simply supported, under the load 1 (ν = 0)."""
    s = np.linspace(0, 1, 4001)
    moment = 0.5 * s * (1 - s)
    curvature = moment / np.where(s < 0.5, first, second)
    curvature[2000] = 0.5 * moment[2000] * (1 / first + 1 / second)
    step = s[1]
    slope = np.concatenate([[0], np.cumsum(0.5 * step * (curvature[1:] + curvature[:-1]))])
    w = np.concatenate([[0], np.cumsum(0.5 * step * (slope[1:] + slope[:-1]))])
    return s, s * w[-1] - w


@pytest.mark.parametrize(
    ("pattern", "ratio", "limit"), [("right", 1e6, 5e-3), ("unstructured", 1e5, 4e-3)]
)
def test_clamped_strip_hangs_as_the_heavy_elastica(pattern, ratio, limit):
    L, width, B = 1.0, 0.25, 1.0
    _, reach, drop = heavy_elastica(10.0)
    cloth = fc.Cloth.rectangle(L, width, L / 16, pattern)
    fabric = fc.Fabric(1.0, ratio * B / L**2, bending_rigidity=B)
    terms = [fc.StVK(), fc.PlateBending(), fc.Gravity((0, 0, -10.0))]
    system = fc.System(cloth, fabric, terms, pins=[fc.Pin("left", clamp=True)])
    tip = fc.equilibrium(system, system.rest()).x[cloth.nodes("right")].mean(axis=0)
    assert abs(-tip[2] / tip[0] / (drop[-1] / reach[-1]) - 1) < limit


def test_clamp_that_turns_carries_the_strip_along():
    """A weightless clamped strip at rest follows its clamp like a rigid body."""
    cloth = fc.Cloth.rectangle(1.0, 0.2, 0.1, "right")
    fabric = fc.Fabric(1.0, 1e4, bending_rigidity=1.0)
    turn = fc.Rotation((0, 0, 0), (0, 1, 0), "0.5*t")
    pins = [fc.Pin("left", clamp=True, rotate=turn)]
    system = fc.System(cloth, fabric, [fc.StVK(), fc.PlateBending()], pins)
    rest = system.rest()
    for angle in (0.3, 1.2):
        turned = rest.x @ turn.matrix(2 * angle).T
        state = fc.State(2 * angle, turned, rest.v)
        assert system.energies(state)["PlateBending"] < 1e-20
        assert np.abs(system.force(state)).max() < 1e-9
        target, speed = system.constraints.target(0.0, 2 * angle, rest.x)
        left = cloth.nodes("left")
        assert target[left] == pytest.approx(turned[left], abs=1e-14)
        assert speed[left] == pytest.approx(np.cross([0, 0.5, 0], turned[left]), abs=1e-14)


def test_a_clamp_needs_a_term_that_holds_it():
    cloth = square("right", 4)
    pins = [fc.Pin("left", clamp=True)]
    with pytest.raises(fc.InputError, match=r"needs a bending term.*Add PlateBending"):
        fc.System(cloth, ISOTROPIC, [fc.StVK(), fc.HingeBending()], pins)
    with pytest.raises(fc.InputError, match=r"must cover an edge of the boundary"):
        plate(cloth, ISOTROPIC, [fc.Pin([0], clamp=True)])


def test_a_triangle_alone_bends_about_its_clamp():
    """Morley's κ = Σ l_i/A α_i n_i n_iᵀ with α₁ given, and without moments at the other edges.

    For ν = 0 the energy is B A/2 |κ|², least over α₂ and α₃.
    """
    X = np.array([[0.0, 0.0], [0.2, 0.0], [0.05, 0.1]])
    cloth = fc.Cloth.from_arrays(X, [[0, 1, 2]])
    pins = [fc.Pin(lambda X: X[:, 1] < 1e-9, clamp=True)]
    system = fc.System(cloth, fc.Fabric(1.0, 1e3, bending_rigidity=2.0), [fc.PlateBending()], pins)
    x = system.rest().x
    x[:, 2] = 1e-4 * cloth.X[:, 1]  # α₁ = 1e-4
    edges = np.roll(X, -1, axis=0) - X
    n = edges[:, ::-1] * [1, -1] / np.linalg.norm(edges, axis=1)[:, None]
    G = (n @ n.T) ** 2  # n_i n_iᵀ : n_j n_jᵀ
    least = G[0, 0] - G[0, 1:] @ np.linalg.solve(G[1:, 1:], G[1:, 0])
    expected = 0.5 * 2.0 * 0.01 * (0.2 / 0.01 * 1e-4) ** 2 * least
    assert system.energies(system.state(x))["PlateBending"] == pytest.approx(expected, rel=1e-6)
    check_slopes(system, system.state(x + [[0, 0, 0.02 * i] for i in range(3)]))


@pytest.mark.stories
def test_work_of_a_clamp_that_turns_closes_the_energy_balance():
    cloth = fc.Cloth.rectangle(0.4, 0.1, 0.05, "right")
    fabric = fc.Fabric(0.2, 500.0, bending_rigidity=1e-3)
    turn = fc.Rotation((0, 0, 0), (0, 1, 0), "1 - cos(3*t)")
    pins = [fc.Pin("left", clamp=True, rotate=turn)]
    system = fc.System(cloth, fabric, [fc.StVK(), fc.PlateBending()], pins)
    ledgers = []
    for dt in (4e-3, 2e-3):
        run = fc.run(system, fc.ImplicitMidpoint(), system.rest(), dt, 0.4)
        ledgers.append({name: column[-1] for name, column in run.energies.items()})
    assert ledgers[1]["pins"] > 0.5 * ledgers[1]["total"] > 0
    assert abs(ledgers[1]["remainder"]) < 0.01 * ledgers[1]["pins"]
    assert abs(ledgers[1]["remainder"]) < 0.5 * abs(ledgers[0]["remainder"])


def test_scene_clamps_and_turns_its_pins(tmp_path):
    path = tmp_path / "clamp.toml"
    path.write_text(
        """
cloth = { shape = "rectangle", width = 0.4, height = 0.1, h = 0.05, pattern = "right" }
fabric = { areal_density = 0.2, tensile_stiffness = 500.0, bending_rigidity = 1e-3 }
terms = [
  { type = "StVK" }, { type = "PlateBending", rest = "start" },
  { type = "BendingDamping", time = 0.02, law = { type = "PlateBending" } },
]
start = { position = ["X", "Y", "0.5*X**2"] }
time = { method = "bdf2", dt = 0.01, t_end = 0.1 }
[[pins]]
where = "left"
clamp = true
rotate = { point = [0, 0, "10 cm"], axis = [0, 1, 0], angle = "-1.0*t" }
"""
    )
    system = fc.load_scene(path).build().system
    (pin, _), *_ = system.constraints.groups.values()
    assert (pin.clamp, pin.rotate.point) == (True, (0.0, 0.0, 0.1))
    assert len(system.panel.clamps.half_edges) == 2
    assert system.energies(system.start)["PlateBending"] < 1e-25


def test_start_of_another_cloth_is_refused():
    cloth, other = square("right", 4), square("right", 5)
    start = plate(other, ISOTROPIC).rest()
    with pytest.raises(fc.InputError, match=r"start = .*must be a State of 25 nodes.*system.state"):
        fc.System(cloth, ISOTROPIC, [fc.PlateBending()], start=start)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"bending_poisson_ratio": 1.0}, "bending_poisson_ratio = 1.0: must lie between -1 and 1"),
        ({"bias_rigidity": 0.5}, r"bias_rigidity = 0.5: must exceed .* = 0.5 N m.*twist"),
        ({"bias_rigidity": 0.0}, "bias_rigidity = 0.0: must be a finite number > 0"),
    ],
)
def test_fabric_that_would_bend_without_work_is_refused(values, message):
    with pytest.raises(fc.InputError, match=message):
        fc.Fabric(**BENDING, **values)
