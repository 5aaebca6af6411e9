"""Scenes whose fabric lies at a grain angle or differs by region."""

import math
import re

import numpy as np
import pytest
from support.wrong_calls import TWO

import fecloth as fc
from fecloth.scene.scene import load_scene

BODY = fc.Fabric(0.15, (2000.0, 900.0), 0.2, shear_stiffness=60.0)
HEM = fc.Fabric(0.4, 500.0, 0.3)
SCENE = TWO["scene.toml"]
HEAD, REGIONS, REST = re.split(r"(?s)(\[fabrics\.body\].*?)(?=\[\[terms)", SCENE, maxsplit=1)
ONE = "[fabric]\nareal_density = 0.4\ntensile_stiffness = 500\n"


@pytest.fixture
def file(tmp_path):
    (tmp_path / "two.geo").write_text(TWO["two.geo"])

    def write(fabric=REGIONS, grain=""):
        path = tmp_path / "scene.toml"
        path.write_text(f"{grain}\n{HEAD}{fabric}{REST}")
        return path

    return write


@pytest.mark.parametrize(
    ("line", "grain"),
    [
        ("", 0.0),
        ("grain_degrees = 45", math.pi / 4),
        ("grain_degrees = {body = 30.0, hem = -90}", {"body": math.pi / 6, "hem": -math.pi / 2}),
    ],
)
def test_scene_with_regions_equals_the_python_calls(line, grain, file, rng):
    built = load_scene(file(grain=line)).build()
    assert built.system.fabric == {"body": BODY, "hem": HEM}
    assert built.system.grain == pytest.approx(grain, rel=1e-15)
    terms = [fc.StVK(), fc.StrainRateDamping(0.01), fc.Gravity()]
    fabric = {"body": BODY, "hem": HEM}
    twin = fc.System(built.cloth, fabric, terms, ["left"], grain=grain)
    state = twin.state(built.start.x + 0.01 * rng.standard_normal(built.start.x.shape))
    np.testing.assert_array_equal(built.system.force(state), twin.force(state))
    assert built.system.nodal_mass.sum() == pytest.approx(0.15 * 0.3 + 0.4 * 0.2, rel=1e-12)


def test_one_fabric_at_an_angle(file):
    built = load_scene(file(fabric=ONE, grain="grain_degrees = 45")).build()
    np.testing.assert_array_equal(built.system.panel.grain, math.pi / 4)
    assert built.system.fabric == fc.Fabric(0.4, 500.0)


@pytest.mark.parametrize("line", ["", "grain_degrees = 45", "grain_degrees = {body=30, hem=0}"])
@pytest.mark.parametrize("fabric", [REGIONS, ONE])
def test_round_trip(line, fabric, file, tmp_path):
    scene = load_scene(file(fabric=fabric, grain=line))
    path = tmp_path / "again.toml"
    path.write_text(scene.to_toml())
    assert load_scene(path) == scene
    assert load_scene(path).to_toml() == scene.to_toml()
