"""fecloth render: pictures and movies without a display."""

import os
import re
from contextlib import contextmanager
from importlib.util import find_spec
from itertools import pairwise

import numpy as np
import pytest
from support.swinging import swinging

import fecloth as fc
from fecloth.cli.main import main
from fecloth.output.frame_reader import Frame, Series, field_values, unit_of_field
from fecloth.output.frames import Frames, write_vtk
from fecloth.output.obstacle_frames import ObstacleFrames
from fecloth.view.checker_pattern import material_coordinates, square_side

pytestmark = pytest.mark.skipif(find_spec("pyvista") is None, reason="needs the extra [view]")
imageio = pytest.importorskip("imageio.v2")


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Five frames of a swinging sheet."""
    folder = tmp_path_factory.mktemp("run")
    system, states = swinging(dt=0.1)
    write_vtk(folder / "run", system.cloth, states, system)
    return folder


@pytest.fixture
def draw(run, tmp_path, monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)

    def draw(name, *more):
        target = tmp_path / name
        assert main(["render", str(run), "-o", str(target), "--size", "320x240", *more]) == 0
        return target

    return draw


def cloth_of(image):
    """Where the picture is coloured, above the colour bar."""
    return np.ptp(image[:200, :, :3].astype(int), axis=2) > 40


def test_pictures_show_the_cloth_at_their_times(draw):
    first, last = (imageio.imread(draw(f"{t}.png", "--time", t)) for t in ("0", "0.4"))
    assert first.shape[:2] == (240, 320)
    shown = [cloth_of(image) for image in (first, last)]
    assert all(0.03 < mask.mean() < 0.8 for mask in shown)
    rows = [np.mean(np.nonzero(mask)[0]) for mask in shown]
    assert rows[1] > rows[0] + 15  # it has fallen
    assert np.array_equal(imageio.imread(draw("end.png")), last)
    for mask in shown:  # all of it is in the picture
        assert not mask[0].any()
        assert not mask[:, [0, -1]].any()


@pytest.mark.stories
def test_checks_are_those_of_a_weave(draw):
    """Of four squares double have one dark thread and one has double; there is no colour bar."""
    picture = imageio.imread(draw("checks.png", "--field", "checks"))[..., :3]
    red, blue = picture[..., 0].astype(float), picture[..., 2].astype(float)
    double, single = red < 0.5 * blue, (red > 0.6 * blue) & (red < 0.85 * blue)
    assert double.sum() > 1000
    assert 1.6 < single.sum() / double.sum() < 2.4
    assert not (picture[..., 1] > 1.2 * blue).any()  # the green and yellow of a colour bar


def test_the_squares_follow_the_material():
    X = np.array([[0.0, 0.0], [0.3, 0.1]])
    moved = np.array([[2.0, 1.0, 0.5], [1.0, 1.0, 1.0]])
    frame = Frame(0.0, moved, None, {"displacement": moved - np.c_[X, [0, 0]]}, {})
    assert material_coordinates(frame) == pytest.approx(X)
    assert [square_side(scale * X) for scale in (1, 3, 10)] == [0.02, 0.05, 0.2]


def test_the_colours_are_the_field(draw):
    """At rest nothing is fast; the free edge is the fastest later: dark, and dark to bright."""
    rest, moving = (
        imageio.imread(draw(f"{t}.png", "--time", t, "--field", "velocity")).astype(int)
        for t in ("0", "0.1")
    )
    at_rest = rest[:200][cloth_of(rest)]
    assert at_rest[:, 2].mean() > 1.5 * at_rest[:, 1].mean()  # the dark end of viridis is purple
    green = moving[:200][cloth_of(moving)]
    assert green[:, 1].max() > at_rest[:, 1].max() + 40


@pytest.fixture(scope="module")
def two_fabrics(tmp_path_factory):
    """A frame of a sheet with another fabric in each half, at rest."""
    folder = tmp_path_factory.mktemp("two")
    cloth = fc.Cloth.rectangle(1.0, 0.6, h=0.15)
    left = cloth.X[cloth.triangles].mean(axis=1)[:, 0] < 0.5
    halves = {"a": np.flatnonzero(left), "b": np.flatnonzero(~left)}
    cloth = fc.Cloth.from_arrays(cloth.X, cloth.triangles, regions=halves)
    fabrics = {"a": fc.Fabric(0.2, 500.0), "b": fc.Fabric(0.1, 900.0)}
    system = fc.System(cloth, fabrics, [fc.StVK(), fc.Gravity()], pins=[fc.Pin([0])])
    frames = Frames(folder / "run", cloth, system)
    frames.add(system.rest())
    return folder


def test_two_fabrics_are_drawn_in_two_colours(two_fabrics, tmp_path):
    target = tmp_path / "a.png"
    arguments = ["render", str(two_fabrics), "-o", str(target), "--size", "320x240"]
    assert main([*arguments, "--field", "region"]) == 0
    image = imageio.imread(target).astype(int)
    colours = image[:200][cloth_of(image)][:, :3]
    yellow = colours[:, 0] > colours[:, 2] + 40  # the ends of viridis are yellow and purple
    assert 0.3 < yellow.mean() < 0.7
    assert main(["view", str(two_fabrics), "--no-open", "--field", "region"]) == 0
    page = (two_fabrics / "view.html").read_text(encoding="utf-8")
    assert re.findall(r'"title": "(\w+)"', page) == ["region"]


@pytest.mark.parametrize("name", ["principal_stresses", "velocity", "held", "region"])
def test_each_array_of_the_frames_is_drawn(name, run, draw):
    frame = Series.open(run).read(2)
    arrays = frame.point_data | frame.cell_data
    values = field_values(frame, name)
    assert values.shape == (len(arrays[name]),)
    if name == "velocity":
        assert np.allclose(values, np.linalg.norm(arrays[name], axis=1))
        assert unit_of_field(name) == "m/s"
    if name == "principal_stresses":
        assert np.allclose(values, field_values(frame, "larger_stress"))
    assert draw("a.png", "--field", name).is_file()


@pytest.mark.stories
def test_a_gif_has_all_frames_and_they_differ(draw):
    frames = imageio.mimread(draw("run.gif"))
    assert len(frames) == 5
    shown = [cloth_of(frame)[40:] for frame in frames]  # below the words, which differ anyhow
    assert all((a ^ b).mean() > 0.01 for a, b in pairwise(shown))


@pytest.mark.stories
def test_a_movie_has_all_frames(draw):
    pytest.importorskip("imageio_ffmpeg")
    with imageio.get_reader(draw("run.mp4", "--fps", "10")) as movie:
        assert movie.count_frames() == 5
        assert movie.get_meta_data()["fps"] == 10
        assert movie.get_meta_data()["size"] == (320, 240)


@pytest.mark.parametrize(
    ("time", "told"),
    [
        ([], "t = 0.4 s"),
        (["--time", "0.1"], "t = 0.1 s"),
        (["--time", "99"], "t = 0.4 s, of the frame next to 99 s"),
        (["--time", "0.12"], "t = 0.1 s, of the frame next to 0.12 s"),
    ],
)
def test_picture_shows_its_time(time, told, draw, capsys):
    target = draw("a.png", *time)
    assert capsys.readouterr().out == f"wrote {target}: {told}\n"


@pytest.mark.parametrize(
    ("name", "meant"), [("velocit", "velocity"), ("chek", "checks"), ("zz", "")]
)
def test_an_unknown_field_is_a_mistake(name, meant, run, tmp_path, capsys):
    target = tmp_path / "a.png"
    assert main(["render", str(run), "-o", str(target), "--field", name]) == 2
    error = capsys.readouterr().err
    assert "must be one of larger_stretch" in error
    assert error.strip().endswith(f"Did you mean {meant!r}?" if meant else "checks")
    assert not target.exists()


# --- a full disk ----------------------------------------------------------------------------------


@contextmanager
def files_of_at_most(size):
    resource = pytest.importorskip("resource")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.stories
@pytest.mark.parametrize("name", ["run.mp4", "run.gif", "run.png"])
def test_full_disk_is_reported_and_leaves_the_old_file(name, run, tmp_path, capsys):
    if name == "run.mp4":
        pytest.importorskip("imageio_ffmpeg")
    target = tmp_path / name
    target.write_text("old")
    with files_of_at_most(2000):
        status = main(["render", str(run), "-o", str(target), "--size", "320x240"])
    told = capsys.readouterr()
    assert (status, told.out) == (3, "")
    assert f"failed: {target} cannot be written: File too large. Raise the limit" in told.err
    assert [file.name for file in tmp_path.iterdir()] == [name]
    assert target.read_text() == "old"


@pytest.mark.stories
@pytest.mark.skipif(os.name == "nt", reason="needs a shell")
@pytest.mark.parametrize(
    ("reads", "words", "status", "told"),
    [
        ("cat > /dev/null", "x.mp4: No space left on device", 3, "device. Free space or choose"),
        ("true", "x.mp4: No space left on device", 3, "device. Free space or choose"),
        ("true", "Unknown encoder", 2, "ffmpeg ended with 7: Unknown encoder. Choose another"),
    ],
)
def test_error_of_ffmpeg_is_reported(
    reads, words, status, told, run, tmp_path, monkeypatch, capsys
):
    ffmpeg = pytest.importorskip("imageio_ffmpeg")
    script = tmp_path / "ffmpeg"
    script.write_text(f"#!/bin/sh\n{reads}\necho '{words}' >&2\nexit 7\n")
    script.chmod(0o755)
    monkeypatch.setattr(ffmpeg, "get_ffmpeg_exe", lambda: str(script))
    arguments = ["render", str(run), "-o", str(tmp_path / "run.mp4"), "--size", "320x240"]
    assert main(arguments) == status
    assert told in capsys.readouterr().err
    assert [file.name for file in tmp_path.iterdir()] == ["ffmpeg"]


@pytest.mark.stories
def test_an_obstacle_is_in_the_picture(tmp_path):
    """Below a small cloth, where without it there is only the ground."""
    ball = fc.shapes.Sphere((0.3, 0.3, -0.5), 0.45)
    cloth, images = fc.Cloth.rectangle(0.6, 0.6, h=0.15), []
    for terms in ([], [fc.Obstacle(ball)]):
        folder = tmp_path / str(len(terms))
        system = fc.System(cloth, fc.Fabric(0.2, 500.0), [fc.StVK(), *terms])
        Frames(folder / "run", cloth, system).add(system.rest())
        ObstacleFrames(folder, system, system.rest().x).add(0, system.rest())
        target = folder / "end.png"
        assert main(["render", str(folder), "-o", str(target), "--size", "320x240"]) == 0
        images.append(imageio.imread(target)[:, :, :3].astype(int))
    changed = abs(images[1] - images[0]).max(axis=2) > 20
    assert changed[120:].mean() > 0.05
