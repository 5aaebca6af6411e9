"""`PlateBending` with clamps at rest, with clamps that turn, and with rest shapes."""

import numpy as np
import pytest

import fecloth as fc
from studies.references.elastica import heavy_elastica


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
