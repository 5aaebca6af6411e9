"""fecloth view: what the page holds, and what a browser shows of it."""

import base64
import io
import json
import re

import numpy as np
import pytest
from support.browsers import chromium
from support.swinging import swinging
from test_html_report import data_of, report, unpacked

import fecloth as fc
from fecloth.cli.main import main
from fecloth.output.frame_arrays import fields
from fecloth.output.frame_reader import Frame, Series, field_values, straight
from fecloth.output.frames import Frames, write_vtk
from fecloth.output.obstacle_frames import ObstacleFrames
from fecloth.output.vtkhdf_writer import gather
from fecloth.view import web_page
from fecloth.view.charts import Chart, draw

Image = pytest.importorskip("PIL.Image")


@pytest.fixture(scope="module", params=["P1", "P2"])
def run(request, tmp_path_factory):
    folder = tmp_path_factory.mktemp(request.param)
    system, states = swinging(request.param)
    write_vtk(folder / "run", system.cloth, states, system)
    assert main(["view", str(folder), "--no-open"]) == 0
    return folder, system, states, (folder / "view.html").read_text(encoding="utf-8")


def test_the_page_holds_the_motion_and_the_fields(run):
    _, system, states, page = run
    data = data_of(page)
    assert data["times"] == [state.t for state in states]
    assert data["start"] == len(states) - 1  # it opens at the end of the motion
    span = np.subtract(data["high"], data["low"])
    shown = unpacked(data["points"], data["low"], data["high"])
    x = np.concatenate([state.x for state in states])
    assert np.abs(shown - x).max() <= 0.51 * span.max() / 65535 + 1e-7
    assert [field["title"] for field in data["fields"]] == [
        *("larger_stretch", "smaller_stretch", "velocity", "displacement", "energy_density")
    ]
    speed = data["fields"][2]
    values = unpacked(speed["values"], speed["low"], speed["high"])
    wanted = np.array([np.linalg.norm(state.v, axis=1) for state in states])
    assert np.abs(values.reshape(wanted.shape) - wanted).max() <= 1e-4 * wanted.max()
    assert speed["per"] == "node"
    assert data["fields"][0]["per"] == "cell"
    assert data["fields"][0]["count"] == data["cells"] == len(system.cloth.triangles)


def test_the_page_holds_the_material_coordinates_in_squares(run):
    _, system, _, page = run
    checks = data_of(page)["checks"]
    at = np.frombuffer(base64.b64decode(checks["material"]), "<f4").reshape(-1, 2)
    assert checks["side"] == 0.05
    assert checks["side"] * at == pytest.approx(system.cloth.X, abs=1e-6)


@pytest.mark.filterwarnings("error")
def test_overflowing_values_are_drawn_as_the_largest_finite_one(run):
    _, system, states, _ = run
    frame = Frame(0.0, states[-1].x, system.cloth.cells, *fields(system, states[-1]))
    energy = frame.cell_data["energy_density"]
    energy[:4] = 9e58, 1e308, np.inf, np.nan  # beyond float32, beyond what may be subtracted
    data = web_page.pack_frames([frame], ["energy_density"])
    (field,) = json.loads(json.dumps(data, allow_nan=False))["fields"]
    assert (field["low"], field["high"]) == (energy[4:].min(), 9e58)
    shown = unpacked(field["values"], 0, 1)
    assert np.all(shown[:4] == 1)
    assert np.all(shown[4:] == 0)
    curve = np.array([1.0, 9e58, 1e308, -1e308])
    assert len(draw([Chart("energy", "[J]", np.arange(4.0), {"W": curve})])) == 1


def test_it_opens_offline(run):
    assert not re.search(r"https?://|\b(src|href)=|@import|url\(|fetch\(|import\(", run[3])


def test_every_straight_triangle_is_drawn_once_and_as_oriented(run):
    _, system, _, page = run
    drawn = np.frombuffer(base64.b64decode(data_of(page)["triangles"]), "<u4").reshape(-1, 3)
    a, b, c = np.moveaxis(system.cloth.X[drawn], 1, 0)
    u, v = b - a, c - a
    areas = (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]) / 2
    assert np.all(areas > 0)
    assert areas.sum() == pytest.approx(0.6)
    whole = areas.reshape(len(system.cloth.triangles), -1).sum(axis=1)  # cell by cell, in order
    assert whole == pytest.approx(system.cloth.weights.sum(axis=1))
    assert len(drawn) == len(straight(system.cloth.cells))


def test_one_file_and_many_hold_the_same(tmp_path):
    pytest.importorskip("h5py")
    system, states = swinging()
    write_vtk(tmp_path / "a" / "run", system.cloth, states, system)
    (tmp_path / "b").mkdir()
    gather(Series.open(tmp_path / "a"), tmp_path / "b" / "run.vtkhdf")
    a, b = Series.open(tmp_path / "a"), Series.open(tmp_path / "b")
    assert a.times == b.times
    for i in (0, 3, 8):
        assert np.array_equal(a.read(i).cells, b.read(i).cells)
        for name in ("larger_stretch", "velocity", "height", "S11", "quality"):
            assert np.array_equal(*(field_values(s.read(i), name) for s in (a, b)))


def test_long_run_is_thinned_with_a_note(run, monkeypatch):
    folder = run[0]
    first, fields = Series.open(folder).read(0), 5
    a_frame = 3 * len(first.points) + fields * max(len(first.points), len(first.cells))
    monkeypatch.setattr(web_page, "MOST_BYTES", 4.5 * 8 / 3 * a_frame)  # 2 bytes each, base64
    page = web_page.write_view(folder).read_text(encoding="utf-8")
    times = data_of(page)["times"]
    assert len(times) == 4
    assert times[0] == 0.0
    assert times[-1] == pytest.approx(0.4)
    assert "of 9 frames" in page
    monkeypatch.undo()
    web_page.write_view(folder)


# --- in a browser ---------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def browser():
    """A headless Chromium of this machine."""
    yield from chromium()


class Page:
    """view.html in the browser, with what went wrong there."""

    def __init__(self, browser, file, width=390, height=700):
        self.page = browser.new_page(viewport={"width": width, "height": height})
        self.page.set_default_timeout(0)  # the machine may be busy
        self.troubles = []
        self.page.on("console", lambda message: self.troubles.append(message.text))
        self.page.on("pageerror", lambda error: self.troubles.append(str(error)))
        self.page.goto(file.resolve().as_uri())
        drawn = "new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))"
        self.page.evaluate(drawn)

    def pixels(self):
        shot = self.page.locator("canvas").screenshot()
        return np.asarray(Image.open(io.BytesIO(shot)).convert("RGB")).astype(int)

    def cloth(self):
        """Where the picture is coloured: the cloth; paper, ground and shadow are grey."""
        return np.ptp(self.pixels(), axis=2) > 40

    def slide(self, frame):
        self.page.locator(".time").fill(str(frame))


def rim(mask):
    """Within two pixels of its edge: there each drawing of the same frame may differ."""
    near = [np.roll(mask, shift, (0, 1)) for shift in np.ndindex(5, 5)]
    return np.roll(np.any(near, axis=0) != np.all(near, axis=0), (-2, -2), (0, 1))


@pytest.mark.stories
def test_the_slider_moves_the_cloth(run, browser):
    page = Page(browser, run[0] / "view.html")
    assert "0.4 s" in page.page.locator(".now").inner_text()
    last = page.cloth()
    page.slide(0)
    first = page.cloth()
    assert 0.03 < first.mean() < 0.7
    assert last.mean() > 0.01
    assert (first ^ last).mean() > 0.02
    rows = [np.mean(np.nonzero(mask)[0]) for mask in (first, last)]
    assert rows[1] > rows[0] + 30  # it has fallen
    assert page.page.locator(".now").inner_text() == "t = 0 s"
    page.slide(8)
    assert not ((page.cloth() ^ last) & ~rim(last)).any()
    assert not page.troubles


@pytest.mark.stories
@pytest.mark.parametrize("run", ["P1"], indirect=True)
def test_field_mouse_and_play(run, browser):
    page = Page(browser, run[0] / "view.html")
    page.slide(5)
    before = page.pixels()
    page.page.locator(".field").select_option(label="velocity")
    coloured = page.pixels()
    assert (before != coloured).any(axis=2).mean() > 0.01
    assert "m/s" in page.page.locator(".legend").inner_text()
    page.page.mouse.move(200, 300)
    page.page.mouse.down()
    page.page.mouse.move(280, 300, steps=4)
    page.page.mouse.up()
    assert (page.pixels() != coloured).any(axis=2).mean() > 0.05
    page.slide(8)
    page.page.locator(".play").click()
    page.page.wait_for_function('document.querySelector(".time").value < 8')
    page.page.wait_for_function('document.querySelector(".time").value > 0')
    assert not page.troubles
    page.page.close()  # it plays on


@pytest.mark.stories
@pytest.mark.parametrize("run", ["P1"], indirect=True)
@pytest.mark.parametrize("width", [360, 1280])
def test_it_fits_phone_and_desk(run, browser, width):
    page = Page(browser, run[0] / "view.html", width)
    wide = page.page.evaluate("document.documentElement.scrollWidth")
    tall = page.page.evaluate("document.documentElement.scrollHeight")
    assert wide <= width
    assert tall <= 700
    for name in (".play", ".time", ".field"):
        box = page.page.locator(name).bounding_box()
        assert box["height"] >= 30
        assert box["x"] + box["width"] <= width
    cloth = page.cloth()
    assert cloth.any()
    assert not cloth[[0, -1]].any()
    assert not cloth[:, [0, -1]].any()


@pytest.mark.stories
def test_the_report_fits_a_phone(browser, tmp_path):
    report(tmp_path)
    page = browser.new_page(viewport={"width": 390, "height": 844}, has_touch=True, is_mobile=True)
    page.goto((tmp_path / "run" / "report.html").as_uri())
    for summary in page.locator("summary").all():
        summary.click()
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    page.close()


def test_the_page_holds_obstacles_once_for_each_place(tmp_path):
    cloth = fc.Cloth.rectangle(0.6, 0.6, h=0.3)
    ball = fc.Obstacle(fc.shapes.Sphere((0.3, 0.3, -0.5), 0.45, motion=(0, 0, "where(t>1, t, 1)")))
    system = fc.System(cloth, fc.Fabric(0.2, 500.0), [fc.StVK(), ball])
    frames = Frames(tmp_path / "run", cloth, system)
    obstacles, rest = ObstacleFrames(tmp_path, system, system.rest().x), system.rest()
    for i, t in enumerate((0.0, 1.0, 2.0)):
        obstacles.add(i, fc.State(t, rest.x, rest.v))
        frames.add(fc.State(t, rest.x, rest.v))
    assert main(["view", str(tmp_path), "--no-open"]) == 0
    data = data_of((tmp_path / "view.html").read_text(encoding="utf-8"))
    first, second = data["obstacles"]
    assert (first["from"], second["from"]) == (0, 2)
    points = np.frombuffer(base64.b64decode(second["points"]), "<f4").reshape(-1, 3)
    assert points.mean(axis=0) == pytest.approx([0.3, 0.3, 0.5], abs=1e-5)
    assert data["ground"] < -0.4
    titles = [field["title"] for field in data["fields"]]
    assert titles[-2:] == ["contact_pressure", "slip"]
