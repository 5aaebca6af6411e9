"""[start] disturb, mode and amplitude: the way out of an unstable flat equilibrium."""

import warnings

import numpy as np
import pytest

import fecloth as fc
from fecloth.simulation.doubts.pins import rotation_about_pins

COMPRESSED = """
[cloth]
shape = "rectangle"
width = 0.4
height = 0.1
h = 0.1
pattern = "right"

[fabric]
areal_density = 0.2
tensile_stiffness = 1000.0
bending_rigidity = 1e-4

[[terms]]
type = "StVK"

[[terms]]
type = "PlateBending"

[[pins]]
where = "left"

[[pins]]
where = "right"
motion = ["-0.008*t", "0", "0"]

[equilibrium]

[expect]
"least_eigenvalue" = { value = 1.0, relative = 1 }
"""
BY_MODE = ["start.mode=1", "start.amplitude=1 mm"]


@pytest.fixture
def scene(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "compressed.toml"
    path.write_text(
        COMPRESSED.replace('"least_eigenvalue"', "area").replace("1.0, rel", "0.04, rel")
    )
    return path


@pytest.mark.parametrize("remedy", [["start.disturb=1 mm"], BY_MODE])
def test_a_compressed_sheet_ends_buckled_where_the_remedy_is_followed(remedy, scene, tmp_path):
    flat = fc.run_scene(fc.load_scene(scene), tmp_path / "flat")
    bent = fc.run_scene(fc.load_scene(scene, remedy), tmp_path / "bent")
    kinds = [{doubt.kind for doubt in each.doubts} for each in (flat, bent)]
    assert fc.DoubtKind.INSTABILITY in kinds[0]
    assert fc.DoubtKind.INSTABILITY not in kinds[1]
    # an inextensible arc w = a sin(pi x / L), shorter by a^2 pi^2 / (4 L) = 8 mm
    ends = [fc.equilibrium(p.system, p.start, load_steps=1) for p in problems(scene, remedy)]
    assert np.ptp(ends[-1].x[:, 2]) == pytest.approx(np.sqrt(4 * 0.4 * 0.008) / np.pi, rel=0.1)


def problems(scene, *remedies):
    with warnings.catch_warnings(action="ignore"):
        return [fc.load_scene(scene, remedy).build() for remedy in remedies]


@pytest.mark.parametrize(("keys", "most"), [(["start.disturb=2 mm"], 2e-3), (BY_MODE, 1e-3)])
def test_a_disturbance_is_as_high_as_it_says_and_the_same_each_time(keys, most, scene):
    first, again, flat = problems(scene, keys, keys, [])
    way = first.start.x - flat.start.x
    assert 0.3 * most < np.linalg.norm(way, axis=1).max() <= most * (1 + 1e-9)
    assert not way[first.cloth.nodes("left")].any()
    np.testing.assert_allclose(way[:, :2], 0.0, atol=1e-9)
    np.testing.assert_array_equal(first.start.x, again.start.x)


def test_the_mode_is_that_of_fecloth_modes(scene):
    bent, flat = problems(scene, BY_MODE, [])
    with warnings.catch_warnings(action="ignore"):
        rest = fc.equilibrium(flat.system, flat.start, load_steps=1)
        shape = fc.modes(flat.system, rest, count=1).shapes[0]
    way = bent.start.x - flat.start.x
    np.testing.assert_allclose(way, 1e-3 * shape / abs(shape).max(), atol=1e-9)


def test_a_start_at_one_point_turns_about_no_axis():
    cloth = fc.Cloth.rectangle(0.4, 0.1, h=0.1)
    system = fc.System(cloth, fc.Fabric(0.2, 1000.0), [fc.StVK()], ["left"])
    assert rotation_about_pins(system, np.zeros((len(cloth.X), 3))) is None
