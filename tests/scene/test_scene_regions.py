"""Scenes whose fabric lies at a grain angle or differs by region."""

import math

import numpy as np
import pytest

import fecloth as fc
from fecloth.scene.scene import load_scene

GEO = """
Point(1) = {0, 0, 0, 0.2}; Point(2) = {0.6, 0, 0, 0.2}; Point(3) = {1, 0, 0, 0.2};
Point(4) = {1, 0.5, 0, 0.2}; Point(5) = {0.6, 0.5, 0, 0.2}; Point(6) = {0, 0.5, 0, 0.2};
Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 4}; Line(4) = {4, 5}; Line(5) = {5, 6};
Line(6) = {6, 1}; Line(7) = {2, 5};
Curve Loop(1) = {1, 7, 5, 6}; Plane Surface(1) = {1};
Curve Loop(2) = {2, 3, 4, -7}; Plane Surface(2) = {2};
Physical Surface("body") = {1};
Physical Surface("hem") = {2};
Physical Curve("left") = {6};
"""
BODY = fc.Fabric(0.15, (2000.0, 900.0), 0.2, shear_stiffness=60.0)
HEM = fc.Fabric(0.4, 500.0, 0.3)
REGIONS = """
[fabrics.body]
areal_density = 0.15
tensile_stiffness = [2000, 900.0]
poisson_ratio = 0.2
shear_stiffness = 60
[fabrics.hem]
areal_density = 0.4
tensile_stiffness = 500
poisson_ratio = 0.3
"""
ONE = "\n[fabric]\nareal_density = 0.4\ntensile_stiffness = 500\n"


def text(fabric=REGIONS, grain=""):
    return f"""{grain}
[cloth]
shape = "file"
path = "two.geo"
{fabric}
[[terms]]
type = "StVK"
[[terms]]
type = "StrainRateDamping"
time = 0.01
[[terms]]
type = "Gravity"
[[pins]]
where = "left"
[time]
method = "backward_euler"
dt = 0.01
t_end = 0.02
"""


@pytest.fixture
def file(tmp_path):
    (tmp_path / "two.geo").write_text(GEO)

    def write(**parts):
        path = tmp_path / "scene.toml"
        path.write_text(text(**parts))
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


@pytest.mark.parametrize(
    ("parts", "override", "said"),
    [
        ({"fabric": REGIONS + ONE}, None, "fabric and fabrics are given: give exactly one of"),
        ({"fabric": ""}, None, "fabric is missing: give exactly one of fabric, fabrics"),
        ({"fabric": "[fabrics]"}, None, "fabrics = {}: must name a region"),
        ({}, "fabrics.body.density=1", "fabrics.body.density = 1: unknown key"),
        ({}, "fabrics.body.areal_density=-1", "fabrics.body.areal_density = -1.0: must be"),
        ({}, "fabrics.hem=3", "fabrics.hem = 3: must be a table"),
        ({}, "fabrics=3", "fabrics = 3: must be a table"),
        ({}, "fabrics.cuff={areal_density=1,tensile_stiffness=1}", "fabrics: region 'cuff': must"),
        ({"fabric": REGIONS.split("[fabrics.hem]")[0]}, None, "is in 0 of the regions body"),
        ({}, "grain_degrees='45'", "grain_degrees = '45': must be a finite number or a table of"),
        ({}, "grain_degrees=inf", "grain_degrees = inf: must be a finite number"),
        ({}, "grain_degrees.hem='x'", "grain_degrees"),
        ({}, "grain_degrees={hem=3}", "grain_degrees: triangle"),
        ({}, "grain_degrees={hem=3,bdy=1}", "grain_degrees: region 'bdy': must be one of body"),
    ],
)
def test_mistakes(parts, override, said, file):
    path = file(**parts)
    overrides = [override] if override else []
    with pytest.raises(fc.SceneError) as caught:
        load_scene(path, overrides).build()
    message = str(caught.value)
    assert message.startswith(str(path))
    assert said in message
    assert "pydantic" not in message
    assert "Input should" not in message
