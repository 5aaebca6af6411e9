"""Scene files: what they mean, that messages of mistakes, and the round trip."""

from __future__ import annotations

import dataclasses
import pickle
import tempfile
import tomllib
from pathlib import Path

import numpy as np
import pytest
from support.drawn import drawn

import fecloth as fc
from fecloth import terms
from fecloth.integrators import METHODS
from fecloth.output import frames
from fecloth.scene.scene import Scene, load_scene
from fecloth.scene.toml_text import read, to_toml
from fecloth.simulation.stability_limited import StabilityLimited
from studies.references import sagging_square
from studies.references.closed_forms import hanging_strip_mean, hanging_strip_tip
from studies.references.falling_disk import trampoline

ROOT = Path(__file__).parents[2]
SCENES = sorted((ROOT / "studies" / "scenes").glob("*.toml"))

TEXT = (ROOT / "tests" / "messages" / "scene.toml").read_text(encoding="utf-8")


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "test.toml"
    path.write_text(TEXT)
    return path


def refusal(path, *overrides) -> str:
    """The message with which a scene is refused, when read or when built."""
    with pytest.raises(fc.SceneError) as caught:
        load_scene(path, overrides).build()
    message = str(caught.value)
    assert "pydantic" not in message
    assert "Input should" not in message
    return message


# --- what a scene means ---------------------------------------------------------------------------


def test_build_equals_the_python_calls(file):
    built = load_scene(file).build()
    fabric = fc.Fabric(0.2, (1000.0, 900.0), shear_stiffness=300.0)
    damping = fc.StrainRateDamping(time=0.01, law=fc.TensorCondition(250.0))
    assert built.system.fabric == fabric
    assert built.system.terms == (fc.StVK(), damping, fc.Gravity((0.0, 0.0, -9.81)))
    assert built.cloth.X.shape == fc.Cloth.rectangle(1.0, 0.5, 0.25, "right").X.shape
    assert built.method == fc.ImplicitMidpoint()
    assert (built.dt, built.t_end, built.linear, built.newton) == (0.01, 0.1, "auto", fc.Newton())
    assert built.system.mass_kind == "lumped"
    assert built.probes == (fc.Probe("middle", point=(0.5, 0.2)), fc.Probe("tip", "right"))
    np.testing.assert_array_equal(built.start.x, built.system.rest().x)
    assert not built.start.v.any()
    left, corner = built.system.constraints.groups.values()
    assert list(built.system.constraints.groups) == ["left", "corner"]
    np.testing.assert_array_equal(left[1], built.cloth.nodes("left"))
    assert built.cloth.X[corner[1]].tolist() == [[1.0, 0.5]]
    assert left[0].motion(0.25) == pytest.approx([0, 0.1, 0])
    assert pickle.loads(pickle.dumps(left[0])).motion(0.25) == pytest.approx([0, 0.1, 0])


def test_every_term_and_every_method_can_be_named(file):
    needed = {"StrainRateDamping": "time = 0.1", "TensorCondition": "k = 2.0"}
    for name in terms.__all__:
        given = f"type = '{name}', {needed.get(name, '')}".rstrip(", ")
        required = [f.default for f in dataclasses.fields(getattr(terms, name))]
        if name not in needed and dataclasses.MISSING in required:
            continue  # a term to come, whose parameters are its own tests' matter
        made = load_scene(file, [f"terms.0={{{given}}}"]).terms[0].make()
        assert type(made) is getattr(terms, name)
    for name, cls in METHODS.items():
        assert load_scene(file, [f"time.method={name}"]).time.method.make() == cls()


WRITTEN = {  # a term in a scene, and in Python
    "type='BaraffWitkin', stretch=[3e5, 2e5], shear=4e4, area_exponent=1.0, damping=0.01": (
        fc.BaraffWitkin((3e5, 2e5), 4e4, area_exponent=1.0, damping=0.01)
    ),
    "type='Springs', kind='structural', shear=30.0, damping=0.01": (
        fc.Springs(shear=30.0, damping=0.01)
    ),
    "type='Tether', where='left', point=[0.0, '0.1 * t', 0.0], stiffness=20.0": (
        fc.Tether("left", (0.0, "0.1 * t", 0.0), 20.0)
    ),
    "type='Pressure', pressure='100 * t', tangent='exact'": fc.Pressure("100 * t", "exact"),
    "type='Drag', normal=0.7": fc.Drag(0.7),
    "type='Wind', velocity=['2 * z', 0, 't'], normal=0.7, law='linear'": (
        fc.Wind(("2 * z", 0.0, "t"), 0.7, law="linear")
    ),
    "type='Wind', velocity=[5, 0, 0], normal=0.7, gusts=0.2, seed=4": (
        fc.Wind((5.0, 0.0, 0.0), 0.7, gusts=0.2, seed=4)
    ),
    "type='MassDamping', rate=2": fc.MassDamping(2.0),
    "type='PointForce', where='right', force=[0, 't', 1]": fc.PointForce("right", (0.0, "t", 1.0)),
    "type='PointForce', where=[0.5, 0.25], force=[0, 0, 1]": (
        fc.PointForce((0.5, 0.25), (0.0, 0.0, 1.0))
    ),
    "type='EdgeForce', where='right', force=['5 N/m', 't', 0], follow=true": (
        fc.EdgeForce("right", (5.0, "t", 0.0), follow=True)
    ),
    "type='EdgeForce', where='top', normal='30 * t', tangent='2 N/m'": (
        fc.EdgeForce("top", normal="30 * t", tangent=2.0)
    ),
    "type='UserForce', force=['-x', 0, '-3 * vz'], per='mass'": (
        fc.UserForce(("-x", 0.0, "-3 * vz"), per="mass")
    ),
}


@pytest.mark.parametrize("text", WRITTEN)
def test_a_term_of_a_scene_is_that_of_python_and_survives_the_round_trip(file, text):
    scene = load_scene(file, [f"terms.0={{ {text} }}"])
    assert scene.build().system.terms[0] == WRITTEN[text]
    (again := file.with_name("again.toml")).write_text(scene.to_toml())
    assert load_scene(again) == scene


ALONG = {"xy": [0, 1], "xz": [0, 2], "yz": [1, 2]}


@pytest.mark.parametrize("plane", ALONG)
def test_start_in_a_plane(file, plane):
    built = load_scene(file, [f"start.plane={plane}"]).build()
    np.testing.assert_array_equal(built.start.x[:, ALONG[plane]], built.cloth.X)
    assert np.count_nonzero(built.start.x.any(axis=0)) == 2


def test_start_is_turned_and_then_shifted(file):
    turn = "start.rotate={axis=[0, 0, 2], degrees=90}"
    built = load_scene(file, [turn, "start.shift=[1, 2, 3]"]).build()
    X, Y = built.cloth.X.T
    np.testing.assert_allclose(built.start.x, np.stack([1 - Y, 2 + X, 3 + 0 * X], 1), atol=1e-15)


def test_start_from_formulas(file):
    position = 'start.position=["X", "0.01*sin(pi*X)", "Y"]'
    built = load_scene(file, [position, 'start.velocity=["0", "X*Y", "1"]']).build()
    X, Y = built.cloth.X.T
    np.testing.assert_allclose(built.start.x, np.stack([X, 0.01 * np.sin(np.pi * X), Y], 1))
    np.testing.assert_allclose(built.start.v, np.stack([0 * X, X * Y, 1 + 0 * X], 1))


def test_start_from_the_frame_of_a_run(file):
    built = load_scene(file).build()
    state = built.system.state(built.start.x + 0.1, built.start.v - 0.2, t=7.0)
    frames.write_vtk(file.parent / "out", built.cloth, [state])
    (frame,) = (file.parent).rglob("*.vtu")
    start = load_scene(file, [f"start.frame='{frame.relative_to(file.parent)}'"]).build().start
    np.testing.assert_array_equal(start.x, state.x)
    np.testing.assert_array_equal(start.v, state.v)
    assert start.t == 0.0
    relative = frame.relative_to(file.parent)
    assert "start.frame: 15 nodes: the cloth has 45" in refusal(
        file, f"start.frame='{relative}'", "cloth.h=0.125"
    )
    frame.write_bytes(b"\x00no frame")
    assert "start.frame: cannot be read" in refusal(file, f"start.frame='{relative}'")


@pytest.mark.parametrize(
    ("table", "steps"),
    [
        ("{}", 2),  # 50 frames in 100 steps
        ("{frames = 10}", 10),
        ("{frames = 1000}", 1),
        ("{every = 0.25}", 25),
        ("{every_steps = 7}", 7),
    ],
)
def test_steps_between_frames(file, table, steps):
    assert load_scene(file, [f"output={table}", "time.t_end=1.0"]).build().frame_steps == steps


def test_a_motion_of_x_and_y_gathers_an_edge(file):
    drawn = "-0.02 * X * smoothstep(0, 0.1, t)"
    moved = f"pins=[{{inside='X > 0.6', motion=['{drawn}', '0', '0.1 * X * Y * t']}}]"
    built = load_scene(file, [moved]).build()
    ((pin, nodes),) = built.system.constraints.groups.values()
    X, Y = built.cloth.X[nodes].T
    assert len(set(X)) > 1
    assert len(set(Y)) > 1
    expected = np.stack([-0.02 * X, 0 * X, 0.01 * X * Y], axis=1)
    np.testing.assert_allclose(pin.motion(0.1), expected, rtol=0, atol=1e-15)
    assert pickle.loads(pickle.dumps(pin)).motion(0.1).tolist() == pin.motion(0.1).tolist()
    end = fc.run(built.system, built.method, built.start, built.dt, built.t_end).state
    np.testing.assert_allclose(end.x[nodes], built.start.x[nodes] + expected, rtol=0, atol=1e-12)


# --- mistakes -------------------------------------------------------------------------------------


def test_method_and_step_are_chosen_where_both_are_left_out(file):
    text = file.read_text().replace('method = "implicit_midpoint"\n', "")
    file.write_text(text.replace("dt = 0.01\n", "", 1))
    scene = load_scene(file)
    assert scene == load_scene(file, ["time.method=auto", "time.dt=auto"])
    assert isinstance(scene.time.steps(), fc.Auto)


def test_several_mistakes_are_reported_one_a_line(file):
    given = "time.dt=0", "mass=3", "title=3", "fabric.areal_density=-1"
    with pytest.raises(fc.SceneError) as caught:
        load_scene(file, given)
    for error in (caught.value, pickle.loads(pickle.dumps(caught.value))):
        lines = str(error).splitlines()
        assert [line.startswith(f"{file} with {', '.join(given)}: ") for line in lines] == [
            True
        ] * 4
        for key in ("time.dt = 0", "mass = 3", "title = 3", "fabric.areal_density = -1"):
            assert sum(f": {key}" in line for line in lines) == 1


def test_a_key_of_ten_parts_and_dots_in_texts_are_read(tmp_path):
    path = tmp_path / "dots.toml"
    dots = "a.b.c.d.e.f.g.h.i.j"
    path.write_text(f'{dots} = 1\nx = "{dots}.k" # {dots}.k\n')
    assert read(path)["x"] == f"{dots}.k"


def test_a_scene_may_begin_with_a_byte_order_mark(file):
    plain = load_scene(file)
    file.write_bytes(b"\xef\xbb\xbf" + TEXT.encode())
    assert load_scene(file) == plain


# --- overrides ------------------------------------------------------------------------------------


def test_overrides_replace_values_and_leave_the_rest(file):
    plain = load_scene(file)
    scene = load_scene(
        file, ["time.dt=0.005", "terms.1.law.k=300", "solver.linear='pcg'", "mass=lumped"]
    )
    assert scene.time.dt == 0.005
    assert scene.terms[1].law.k == 300.0
    assert scene.solver.linear == "pcg"
    assert (scene.cloth, scene.pins) == (plain.cloth, plain.pins)
    assert load_scene(file, ["time.dt=0.005", "time.dt=0.02"]).time.dt == 0.02
    assert load_scene(file, ["'expect'.\"tip.z\".0.value=3"]).expect["tip.z"][0].value == 3.0
    assert load_scene(file, ["time.method=backward_euler"]).time.method.make() == fc.BackwardEuler()


# --- back to text ---------------------------------------------------------------------------------


def test_resolved_scene_is_equal_and_has_the_defaults_written_out(file, tmp_path):
    scene = load_scene(file)
    text = scene.to_toml()
    resolved = tmp_path / "elsewhere" / "scene.resolved.toml"
    resolved.parent.mkdir()
    resolved.write_text(text)
    again = load_scene(resolved)
    assert again == scene
    assert again.to_toml() == text
    assert scene != load_scene(file, ["time.dt=0.02"])
    data = read(resolved)
    assert data["solver"]["tolerance"] == fc.Newton().tolerance
    assert data["solver"]["linear"] == "auto"
    assert "start" not in data  # in the plane xy, or as a mesh file says
    switches = {"intersections": True, "error_density": False}
    assert data["output"] == {"frames": 50, "format": "vtu", "rows": 1000} | switches
    assert data["mass"] == "lumped"
    assert data["fabric"]["poisson_ratio"] == 0.0
    assert data["terms"][1]["tangent"] == "symmetric"
    assert data["time"]["method"] == "implicit_midpoint"


def test_resolved_scene_finds_its_mesh_from_any_folder(tmp_path, monkeypatch):
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes" / "sheet.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    (tmp_path / "scenes").mkdir()
    path = tmp_path / "scenes" / "a.toml"
    cloth = "[cloth]\nshape = 'file'\npath = '../meshes/sheet.obj'\n"
    fabric = "[fabric]\nareal_density = 1\ntensile_stiffness = 1\n"
    path.write_text(cloth + fabric + "[time]\nmethod = 'backward_euler'\ndt = 1\nt_end = 1\n")
    scene = load_scene(path)
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "scene.resolved.toml").write_text(scene.to_toml())
    monkeypatch.chdir("/")
    assert load_scene(tmp_path / "out" / "scene.resolved.toml") == scene
    assert len(load_scene(tmp_path / "out" / "scene.resolved.toml").build().cloth.X) == 3


def numbers(st):
    return st.floats(allow_nan=False, allow_infinity=False)


def texts(st):
    return st.text(st.characters(exclude_categories=["Cs"]), max_size=8)


def any_tables(st):
    leaves = st.one_of(numbers(st), st.integers(-(2**63), 2**63 - 1), st.booleans(), texts(st))

    def grow(inner):
        return st.one_of(
            st.lists(inner, min_size=1, max_size=3),
            st.dictionaries(texts(st), inner, min_size=1, max_size=3),
        )

    return st.dictionaries(texts(st), st.recursive(leaves, grow, max_leaves=6), max_size=4)


@drawn(lambda st: [any_tables(st)], max_examples=150)
def test_any_tables_survive_the_writer(data):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "writer.toml"
        path.write_text(to_toml(data), encoding="utf-8", newline="")
        assert read(path) == data


# --- after the run --------------------------------------------------------------------------------


def test_a_grading_survives_the_round_trip_and_follows_the_h_of_the_scene(file, tmp_path):
    table = '[[cloth.grading]]\nwhere = "corners"\ndistance = "10 cm"\npower = 0.6\n'
    table += "[[cloth.grading]]\npoint = [0.5, 0.25]\ndistance = 0.2\n[fabric]"
    unstructured = TEXT.replace('pattern = "right"', "").replace("0.25", "0.05", 1)
    file.write_text(unstructured.replace("[fabric]", table))
    scene = load_scene(file)
    places = (
        fc.Grading("corners", distance=0.1, power=0.6),
        fc.Grading(None, (0.5, 0.25), distance=0.2),
    )
    assert np.array_equal(scene.mesh().X, fc.Cloth.rectangle(1, 0.5, 0.05, grading=places).X)
    copy = tmp_path / "copy.toml"
    copy.write_text(scene.to_toml())
    assert load_scene(copy) == scene
    finer = load_scene(file, ["cloth.h=0.025"]).mesh()
    assert len(finer.triangles) == pytest.approx(4 * len(scene.mesh().triangles), rel=0.1)


def test_interest_names_columns_probes_and_the_field(file):
    scene = load_scene(
        file,
        [
            "interest={end=['displacement', 'sag'], path=['tip'], period=['tip.z'],"
            " quantities=['volume', 'energy.StVK at 1 ms', 'frequency(2)']}"
        ],
    )
    assert scene.build().probes
    assert scene.interest.path == ("tip",)


def test_every_column_of_a_run_may_be_expected(file):
    scene = load_scene(file, ["expect={}"])
    built = scene.build()
    names = [*built.observer.row(None, None), *built.ledger.row()]
    table = ", ".join(f"'{n}' = {{value = 1, relative = 1}}" for n in set(names) - {"t"})
    assert len(load_scene(file, [f"expect={{{table}}}"]).build().probes) == 2
    assert {"tip.x", "reaction:corner.z", "dissipated:StrainRateDamping", "remainder"} < set(names)


# --- the scenes of the studies --------------------------------------------------------------------


@pytest.mark.parametrize("path", SCENES, ids=[path.stem for path in SCENES])
def test_scene_of_the_studies_builds(path):
    scene = load_scene(path)
    h = 0.05 if path.stem == "sleeve" else 0.1  # each of its pins holds a part of 3.4 cm
    pieces = tomllib.loads(path.read_text(encoding="utf-8")).get("cloths", ())
    keys = [f"cloths.{name}.h" for name in pieces] or ["cloth.h"]
    built = load_scene(path, [f"{key}={h}" for key in keys]).build()
    assert built.t_end / built.dt <= 1200
    assert scene.expect


def _expected(stem) -> Scene:
    return load_scene(ROOT / "studies" / "scenes" / f"{stem}.toml")


def test_hanging_strip_expects_the_exact_solution():
    scene = _expected("hanging_strip")
    strip = (scene.cloth.height, scene.fabric.tensile_stiffness, scene.fabric.areal_density)
    weight = scene.fabric.areal_density * scene.cloth.width * scene.cloth.height * 9.81
    for name, value in (
        ("mean_displacement.z", -hanging_strip_mean(*strip)),
        ("sag", hanging_strip_tip(*strip)),
        ("tip.z", -hanging_strip_tip(*strip)),
        ("reaction:top.z", weight),
    ):
        assert scene.expect[name][0].value == pytest.approx(value, rel=1e-7), name


def test_sag_expects_the_solution_by_polynomials():
    scene = _expected("sag")
    fabric = scene.fabric
    square = scene.cloth.width, fabric.tensile_stiffness, fabric.poisson_ratio, fabric.areal_density
    expected = scene.expect["sag"][0].value
    assert expected == pytest.approx(sagging_square.sag(*square, count=5), rel=1e-4)
    weight = fabric.areal_density * scene.cloth.width**2 * 9.81
    assert scene.expect["reaction:boundary.z"][0].value == pytest.approx(weight, rel=1e-9)


@pytest.mark.stories
def test_trampoline_expects_the_axisymmetric_solution():
    scene = _expected("trampoline")
    expected = scene.expect["mean_displacement.z"]
    reference = trampoline([e.at for e in expected], elements=800).mean_deflection
    assert [-e.value for e in expected] == pytest.approx(reference, abs=5e-6)
    assert max(e.tolerance for e in expected) <= 3e-3 * 0.0237


# --- steps that are chosen ------------------------------------------------------------------------


def stepping(file, *overrides):
    built = load_scene(file, overrides).build()
    return built.method, built.dt


def test_steps_by_a_number_or_chosen(file):
    bdf2, auto = "time.method='bdf2'", "time.dt='auto'"
    central = "time.method='central_difference'"
    assert stepping(file, bdf2, "time.dt=0.01") == (fc.BDF2(), 0.01)
    assert stepping(file, bdf2, auto) == (fc.Adaptive(fc.BDF2()), None)
    tolerances = "time.rtol=1e-2", "time.atol=1e-4"
    assert stepping(file, bdf2, auto, *tolerances) == (fc.Adaptive(fc.BDF2(), 1e-2, 1e-4), None)
    assert stepping(file, central, auto) == (StabilityLimited(fc.CentralDifference()), None)
    adaptive = fc.Adaptive(fc.CentralDifference(), 1e-2)
    assert stepping(file, central, auto, tolerances[0]) == (adaptive, None)
    assert stepping(file, "time.method='auto'", auto) == (fc.Auto(), None)
    assert stepping(file, "time.method='auto'", auto, *tolerances) == (fc.Auto(1e-2, 1e-4), None)
    for overrides in ([bdf2, auto], ["time.method='auto'", auto, tolerances[0]]):
        scene = load_scene(file, overrides)
        text = file.with_name("again.toml")
        text.write_text(scene.to_toml())
        assert load_scene(text) == scene


def test_frames_of_chosen_steps_are_at_their_times(file):
    built = load_scene(file, ["time.dt='auto'", "time.t_end=1.0", "output={every=0.3}"]).build()
    assert built.frame_steps is None
    assert built.stops == pytest.approx((0.3, 0.6, 0.9))
    built = load_scene(file, ["time.dt='auto'", "output={every_steps=7}"]).build()
    assert (built.frame_steps, built.stops) == (7, ())


def test_a_motion_may_begin_at_the_start(file):
    """√t has no value before, and its difference must not ask for one."""
    built = load_scene(file, ["pins.0.motion.2='0.1*sqrt(t)**3'"]).build()
    steps = fc.march(built.system, built.method, built.start, built.dt, built.t_end)
    assert next(steps)[0].t == 0.01


def test_what_is_no_regular_file_is_no_scene(tmp_path):
    assert "cannot be opened (File name too long)" in refusal(tmp_path / ("a" * 5000))
    if Path("/dev/null").exists():
        assert "is not a regular file" in refusal("/dev/null")
