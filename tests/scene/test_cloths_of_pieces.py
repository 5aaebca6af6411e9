"""[cloths.NAME]: several pieces, each with its shape, fabric, sets and start."""

import numpy as np
import pytest

import fecloth as fc
from fecloth.scene.scene import load_scene

TEXT = """
terms = [{ type = "StVK" }]
pins = [{ where = "lower/left" }]
[cloths.lower]
shape = "rectangle"
width = 0.4
height = 0.3
h = 0.1
element = "ELEMENT"
[cloths.upper]
shape = "disk"
radius = 0.1
h = 0.05
element = "ELEMENT"
start = { shift = [0.2, 0.15, 0.02], velocity = ["0", "0", "-X"] }
[fabrics.lower]
areal_density = 0.2
tensile_stiffness = 500.0
[fabrics.upper]
areal_density = 0.1
tensile_stiffness = 300.0
[time]
method = "bdf2"
dt = 0.01
t_end = 0.02
"""


def written(tmp_path, text=TEXT, element="P1"):
    path = tmp_path / "two.toml"
    path.write_text(text.replace("ELEMENT", element))
    return path


@pytest.mark.parametrize("element", ["P1", "P2"])
def test_pieces_have_their_fabric_sets_and_start(element, tmp_path):
    scene = load_scene(written(tmp_path, element=element))
    built = scene.build()
    cloth, state = built.cloth, built.start
    lower = fc.Cloth.rectangle(0.4, 0.3, 0.1, element=element)
    upper = fc.Cloth.disk(0.1, 0.05, element=element)
    over = cloth.nodes("upper")
    assert np.array_equal(cloth.X[over], upper.X)
    assert np.allclose(state.x[over, :2], upper.X + [0.2, 0.15])
    assert np.allclose(state.x[over, 2], 0.02)
    assert np.allclose(state.v[over, 2], -upper.X[:, 0])
    assert not state.x[cloth.nodes("lower"), 2].any()
    assert len(cloth.nodes("upper/boundary")) == len(upper.nodes("boundary"))
    assert built.system.mass_kind == lower.usual_mass
    weight = 0.2 * lower.area + 0.1 * upper.area
    assert built.system.total_mass == pytest.approx(weight, rel=1e-12)


@pytest.mark.parametrize("element", ["P1", "P2"])
def test_forces_of_pieces_are_those_of_each_alone(element, rng):
    pieces = [
        fc.Cloth.rectangle(0.4, 0.3, 0.1, element=element),
        fc.Cloth.disk(0.1, 0.05, element=element),
    ]
    cloth = fc.Cloth.join(pieces, ["lower", "upper"])
    fabric = fc.Fabric(0.2, 500.0, bending_rigidity=1e-3)
    terms = [fc.StVK(), fc.PlateBending(), fc.Pressure(3.0)]
    x = np.column_stack([cloth.X, 0 * cloth.X[:, 0]]) + 1e-3 * rng.standard_normal(
        (len(cloth.X), 3)
    )
    whole = fc.System(cloth, fabric, terms)
    result = whole.force(whole.state(x))
    for name, piece in zip(("lower", "upper"), pieces, strict=True):
        own, alone = cloth.nodes(name), fc.System(piece, fabric, terms)
        expected = alone.force(alone.state(x[own]))
        assert abs(result[own] - expected).max() < 1e-12 * abs(expected).max()


def test_the_text_of_a_scene_gives_the_same_scene(tmp_path):
    scene = load_scene(written(tmp_path))
    again = tmp_path / "again.toml"
    again.write_text(scene.to_toml())
    assert load_scene(again) == scene
    assert (
        load_scene(again, ["cloth.pieces.upper.radius=0.12"]).cloth.pieces["upper"].radius == 0.12
    )
