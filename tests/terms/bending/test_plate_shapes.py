"""`PlateBending` with clamps at rest, with clamps that turn, and with rest shapes."""

import numpy as np
import pytest
from support.plates import check_slopes

import fecloth as fc


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
