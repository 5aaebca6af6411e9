"""`compare`: known differences, other meshes, time steps, rows of failures, overlays, command."""

import meshio
import numpy as np
import pytest
from support.rundirs import rows_of
from support.scene_texts import STRIP
from support.strips import TIP, scene_file
from support.strips import strip as hung

import fecloth as fc
from fecloth.study.overlay import Overlay
from studies.references.closed_forms import hanging_strip_tip

pytestmark = pytest.mark.stories

Y = 20.0
SCENE = '\ntitle = "a strip"' + STRIP
SWING = """
cloth = { shape = "rectangle", width = 1.0, height = 0.125, h = 0.0625, pattern = "right" }
fabric = { areal_density = 0.2, tensile_stiffness = 100.0 }
terms = [{ type = "StVK" }]
pins = [{ where = "left" }, { where = "right" }]
start = { position = ["1.1 * X", "Y", "0"], velocity = ["0", "0", "sin(pi * X)"] }
time = { method = "backward_euler", dt = 0.01, t_end = 0.1 }
probes = [{ name = "middle", point = [0.5, 0.0625] }]
"""


def strip(h, k=Y / 4, stiffness=Y):
    """StVK for k = 0; its fabric has ν = 0, so that TensorCondition(Y/4) is the same law."""
    cloth = fc.Cloth.rectangle(1.0, 0.25, h, pattern="right")
    term = fc.TensorCondition(k) if k else fc.StVK()
    terms = [term, fc.Gravity((9.81, 0, 0))]
    system = fc.System(cloth, fc.Fabric(0.2, stiffness), terms, pins=["left"])
    return cloth, system, None, system.rest()


def stretched(h, model):
    """A strip stretched by ε = 1e-5 in its plane: ½ C₁₁ ε² A."""
    cloth = fc.Cloth.rectangle(1.0, 0.5, h, pattern="right")
    system = fc.System(cloth, fc.Fabric(0.2, Y, 0.3), [getattr(fc, model)()], pins=["boundary"])
    return cloth, system, None, system.state(system.rest().x * [1 + 1e-5, 1, 1])


scene = scene_file(SCENE, "strip")


def change(scene, *pairs, name="other.toml"):
    text = scene.read_text()
    for old, new in pairs:
        assert old in text
        text = text.replace(old, new)
    other = scene.with_name(name)
    other.write_text(text)
    return other


def test_equal_laws_cannot_be_told_apart_and_softer_ones_differ_as_they_should():
    variants = {"k": [0, Y / 4, Y / 5]}
    result = fc.study.compare(strip, variants, "tip.x", h=0.25, probes=TIP)
    same, softer = (result.differences[name] for name in ("k = 5.0", "k = 4.0"))
    assert abs(same.limit) < 1e-6
    tips = [1 + hanging_strip_tip(1.0, stiffness, 0.2) for stiffness in (0.8 * Y, Y)]
    exact = 100 * (tips[0] / tips[1] - 1)
    assert abs(softer.limit - exact) <= softer.uncertainty < 0.02 * exact
    first, second = result.verdict.splitlines()
    assert first.startswith("tip.x: k = 5.0 and k = 0 cannot be told apart: the difference is 0 ")
    assert second.startswith("tip.x: k = 4.0 is 0.976")
    assert "% larger than k = 0, 0.98 % on the given mesh" in second
    given = [row["value"] for row in result.table]
    whole = result.studies["k = 0"].limit
    assert softer.as_given == pytest.approx(100 * (given[2] - given[0]) / whole, rel=1e-12)


def test_a_difference_is_refined_by_itself():
    """Most of the error of both variants is the same; a fine mesh gives -0.0149 %."""
    run = {"h": 0.125, "levels": 4, "probes": TIP}
    result = fc.study.compare(hung, {"nu": [0.2, 0.3]}, "tip.x", **run)
    (difference,) = result.differences.values()
    added = 100 * sum(each.uncertainty / each.value for each in result.studies.values())
    assert abs(difference.limit + 0.01492) <= difference.uncertainty < 0.6 * added


def test_springs_have_the_stiffness_of_their_homogenised_moduli():
    """The border springs are not halved: their share falls as h, and the limit has none."""
    result = fc.study.compare(stretched, "model=StVK,Springs", "total", h=0.125)
    C = fc.plane_moduli(fc.Springs(), fc.Fabric(0.2, Y, 0.3), "right")
    exact = 100 * (C[0, 0] * (1 - 0.3**2) / Y - 1)
    difference = result.differences["Springs"]
    assert abs(difference.limit - exact) <= difference.uncertainty + 1e-2  # of ε
    assert abs(difference.as_given - exact) > difference.uncertainty
    assert difference.uncertainty < 5


def test_methods_differ_by_their_time_step_only(tmp_path):
    file = tmp_path / "swing.toml"
    file.write_text(SWING)
    result = fc.study.compare(
        file, "time.method=backward_euler,implicit_midpoint", "middle.z at 0.1 s", "dt"
    )
    difference = result.differences["implicit_midpoint"]
    assert abs(difference.limit) < difference.uncertainty < abs(difference.as_given)
    assert "20 % with the given step" in result.verdict
    assert result.figure().axes[0].get_xlabel() == "dt [s]"


def test_a_value_of_zero_is_compared_in_its_unit(scene):
    result = fc.study.compare(scene, "fabric.tensile_stiffness=20,40", "tip.z")
    assert np.isnan(result.scale)
    assert "cannot be told apart: the difference is 0 ± 0 m" in result.verdict
    assert "difference of limits [m]" in result.table.columns


def test_the_warnings_of_a_variant_are_repeated():
    def pressed(h, stiffness):
        cloth = fc.Cloth.rectangle(1.0, 0.5, h, pattern="right")
        system = fc.System(cloth, fc.Fabric(0.2, stiffness), [fc.StVK()], pins=["boundary"])
        return cloth, system, None, system.state(system.rest().x * [0.99, 1, 1])

    compared = fc.study.compare(pressed, {"stiffness": [Y, 2 * Y]}, "energy.StVK", h=0.25)
    for name in compared.studies:
        assert any(f"{name}: the equilibrium is unstable" in note for note in compared.notes())


@pytest.mark.parametrize(
    ("variants", "cause"),
    [
        ("terms.0.type=StVK,TensorCondition,Springs", "terms.0.k is missing"),
        ("pins.0.where=nowhere,left,right", "nowhere"),  # which only the mesh knows
    ],
)
def test_a_refused_variant_has_a_row_with_its_reason_and_the_others_run(scene, variants, cause):
    result = fc.study.compare(scene, variants, "area", cache=None)
    statuses = list(result.table["status"])
    assert sorted(statuses) == ["ok", "ok", "refused"]
    assert cause in result.table["cause"][statuses.index("refused")]
    assert len(result.differences) == 1
    assert result.exit_status == 3


def stretched_by(factor, **mesh):
    cloth = fc.Cloth.rectangle(1.0, 0.5, **mesh)
    system = fc.System(cloth, fc.Fabric(0.2, Y), [fc.StVK()], mass="consistent")
    return system, system.state(system.rest().x * [factor, 1, 1])


@pytest.mark.parametrize("element", ["P1", "P2"])
def test_an_overlay_is_exact_for_linear_maps(element, tmp_path):
    a = stretched_by(1.1, h=0.25, pattern="cross", element=element)
    b = stretched_by(1.3, h=0.2, pattern="unstructured")
    file = Overlay.of(a, b).write(tmp_path)
    assert file.name == "first.pvd"
    frame = meshio.read(tmp_path / "first_000000.vtu")
    X = a[0].cloth.X
    expected = np.column_stack([0.2 * X[:, 0], 0 * X])
    np.testing.assert_allclose(frame.point_data["difference"], expected, atol=1e-12)
    np.testing.assert_allclose(frame.point_data["other"], frame.points + expected, atol=1e-12)
    assert len(meshio.read(tmp_path / "second_000000.vtu").points) == len(b[0].cloth.X)


@pytest.fixture
def two_runs(tmp_path):
    """Folders of two runs on different meshes, the second with P2."""
    scene = tmp_path / "a.toml"
    scene.write_text(SWING + "[output]\nframes = 5\n")
    other = change(scene, ('pattern = "right"', 'pattern = "cross", element = "P2"'))
    folders = [tmp_path / "a", tmp_path / "b"]
    for file, folder in zip((scene, other), folders, strict=True):
        fc.run_scene(fc.load_scene(file), folder)
    return folders


def test_the_command_overlays_two_runs(two_runs, tmp_path, run_command):
    a, b = two_runs
    assert "overlay.pvd" in run_command("compare", a, b, "-o", tmp_path / "out").out
    frames = sorted((tmp_path / "out").glob("overlay_*.vtu"))
    first, last = meshio.read(frames[0]), meshio.read(frames[-1])
    assert len(frames) == len(sorted((a / "frames").glob("*.vtu")))
    assert abs(first.point_data["difference"]).max() < 1e-12  # one start
    middle = np.flatnonzero(np.all(last.point_data["reference"][:, :2] == [0.5, 0.0625], axis=1))
    rows = [rows_of(folder / "observed.csv")[-1] for folder in (a, b)]
    moved = float(rows[1]["middle.z"]) - float(rows[0]["middle.z"])
    assert last.point_data["difference"][middle, 2] == pytest.approx(moved, rel=0.1)
