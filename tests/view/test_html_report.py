"""report.html: what it says, that it stands alone, and what it costs."""

import base64
import itertools
import json
import re
import sys

import numpy as np
import pytest

import fecloth as fc
from fecloth.cli.main import main
from fecloth.output.frame_arrays import fields
from fecloth.output.frame_reader import Frame
from fecloth.simulation.shapes import stretch_row
from fecloth.view.html_report import read_table, write_report
from fecloth.view.svg_chart import WIDTH, chart

SCENE = """
title = "a <sheet> & its report"
cloth = { shape = "rectangle", width = 1.0, height = 0.5, h = 0.2 }
fabric = { areal_density = 0.2, tensile_stiffness = 1000.0 }
terms = [{ type = "StVK" }, { type = "Gravity" }]
pins = [{ where = "left" }]
time = { method = "backward_euler", dt = 0.01, t_end = 0.1 }
output = { every = 0.05 }
"""


@pytest.fixture
def run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "sheet.toml").write_text(SCENE, encoding="utf-8")

    def run(*more):
        status = main(["run", "sheet.toml", "-o", "run", "--overwrite", "--quiet", *more])
        return status, (tmp_path / "run" / "report.html").read_text(encoding="utf-8")

    return run


def data_of(page):
    """The numbers a page holds."""
    return json.loads(re.search(r'id="data">(.*?)</script>', page, re.DOTALL)[1])


def unpacked(text, low, high):
    shorts = np.frombuffer(base64.b64decode(text), "<u2").astype(float)
    return low + np.subtract(high, low) * shorts.reshape(-1, np.size(low)) / 65535


def test_a_run_leaves_a_report_of_its_end(run, tmp_path):
    status, page = run()
    assert status == 0
    assert "a &lt;sheet&gt; &amp; its report" in page
    assert "<sheet>" not in page
    assert '<span class="status warned">done, with warnings</span>' in page
    for title in ("Energy ledger", "Principal stretches", "Step size", "Iterations a step"):
        assert f"<figcaption>{title}" in page
    assert "tensile_stiffness = 1000" in page
    assert 'class="note failed' not in page
    log = (tmp_path / "run" / "run.log").read_text()
    assert page.count('<p class="note">') == log.count(" warning: ")
    data = data_of(page)
    cloth = fc.Cloth.rectangle(1.0, 0.5, h=0.2)
    last = fc.read_frame(tmp_path / "run/frames/frame_000002.vtu", cloth)
    low, high = np.array(data["low"]), np.array(data["high"])
    shown = unpacked(data["points"], low, high)
    assert np.abs(shown - last.x).max() < np.max(high - low) / 65535
    assert data["times"] == [last.t] == [0.1]
    drawn = np.frombuffer(base64.b64decode(data["triangles"]), "<u4").reshape(-1, 3)
    assert np.array_equal(drawn, cloth.triangles)


def test_it_shows_fabric_terms_probes_sag_area_and_reactions(run):
    probe = 'probes=[{ name = "tip", where = "right" }]'
    page = run("--set", probe)[1]
    assert "Fabric: 200 g/m², tensile 1000 N/m; terms: StVK, Gravity" in page
    titles = re.findall("<figcaption>(.*?)</figcaption>", page)
    wanted = ["Position of tip", "Mean displacement", "Sag", "Area", "Force of the pin left"]
    assert titles[:5] == wanted


def test_ticks_of_an_axis_differ():
    t = np.linspace(0.0, 1.0, 9)
    ticks = re.findall(
        ">([−0-9.e]+)</text>", chart("area", {"area": (t, 1.4015 + 1e-4 * t)}, "", "")
    )
    assert len(ticks) == len(set(ticks)) > 8


def test_labels_at_the_ends_of_the_axes_are_inside_the_picture():
    figure = chart("small", {"a": (np.array([0, 1e-4]), np.array([-1.25e-7, 2.5e-7]))}, "t", "y")
    for x, anchor, text in re.findall('<text x="([-0-9.]+)".*?anchor="(.*?)">(.*?)<', figure):
        width = 7 * len(text)  # a digit of this size is 6.7 wide
        left = float(x) - width * {"end": 1.0, "middle": 0.5}[anchor]
        # The margins are 72 and 22 wide, and the title of the axis is in the first 17.
        assert 17 - 72 < left < left + width < WIDTH + 22


def test_remainder_is_shown_as_a_share_of_the_moving_energy(run, tmp_path):
    page = run()[1]
    ledger = np.genfromtxt(tmp_path / "run/energies.csv", delimiter=",", names=True)
    moved = [np.abs(ledger[name] - ledger[name][0]) for name in ("kinetic", "StVK", "Gravity")]
    moved = np.max(moved, axis=0)  # it is pinned
    lasting = np.min([moved[2:], moved[1:-1], moved[:-2]], axis=0).max()
    left = ledger["remainder"][-1]
    share = 100 * abs(left) / lasting
    assert f"<b>{left:.2g} J, {share:.2g} %</b><span>energy unexplained" in page


def test_page_needs_no_other_files(run):
    page = run()[1]
    assert not re.search(r"https?://|\b(src|href)=|@import|url\(", page)
    assert "{{" not in page.split("<script")[0]


def test_it_is_for_phones(run):
    assert '<meta name="viewport" content="width=device-width' in run()[1]


def test_failures_and_warnings_are_at_the_top(run):
    stop = ["--set", "solver.max_iterations=1", "--set", "solver.tolerance=1e-9"]
    status, page = run(*stop)
    assert status == 3
    assert '<span class="status failed">failed</span>' in page
    assert page.index("did not converge") < page.index("<canvas")


def test_warnings_of_the_log_are_shown_once(run, tmp_path):
    run()
    folder = tmp_path / "run"
    with (folder / "run.log").open("a") as log:
        log.writelines(["2026-01-01 warning: steep <mesh>\n", "2026-01-02 warning: steep <mesh>\n"])
    cloth = fc.Cloth.rectangle(1.0, 0.5, h=0.2)
    system = fc.System(cloth, fc.Fabric(0.2, 1000.0), [fc.StVK()], pins=["left"])
    state = system.rest()
    frame = Frame(0.0, state.x, cloth.cells, *fields(system, state))
    summary = json.loads((folder / "summary.json").read_text())
    page = write_report(folder, summary, frame).read_text(encoding="utf-8")
    assert page.count('<p class="note">steep &lt;mesh&gt;</p>') == 1


def test_strains_are_those_of_the_frames(run, tmp_path):
    run()
    table = read_table(tmp_path / "run" / "strains.csv")
    cloth = fc.Cloth.rectangle(1.0, 0.5, h=0.2)
    for i in range(3):
        x = fc.read_frame(tmp_path / f"run/frames/frame_{i:06d}.vtu", cloth).x
        edges = np.stack([x[cloth.triangles[:, k]] - x[cloth.triangles[:, 0]] for k in (1, 2)], 2)
        flat = cloth.X[cloth.triangles]
        flat = np.stack([flat[:, k] - flat[:, 0] for k in (1, 2)], 2)
        stretches = np.linalg.svd(edges @ np.linalg.inv(flat), compute_uv=False)
        assert table["smallest"][i] == pytest.approx(stretches.min(), rel=1e-12)
        assert table["largest"][i] == pytest.approx(stretches.max(), rel=1e-12)


def test_percentiles():
    row = stretch_row(
        0.0, np.column_stack([np.linspace(0.5, 1.0, 101), np.linspace(1.0, 2.0, 101)])
    )
    assert list(row.values()) == pytest.approx([0.0, 0.5, 0.505, 1.5, 1.99, 2.0])


def test_long_tables_are_thinned_and_keep_their_end(tmp_path):
    file = tmp_path / "steps.csv"
    file.write_text("t,x\n" + "".join(f"{i},{i * i}\n" for i in range(10_001)))
    table = read_table(file)
    assert 3000 < len(table["t"]) <= 4001
    assert table["t"][-1] == 10_000
    assert np.array_equal(table["x"], table["t"] ** 2)


def test_charts_show_peaks_and_omit_values_without_a_logarithm():
    x = np.linspace(0.0, 1.0, 100_000)
    y = np.ones_like(x)
    y[54_321] = 7.0
    path = re.search(r'd="M(.*?)"', chart("peak", {"y": (x, y)}, "x", "y"))[1]
    points = np.array([point.split() for point in path.split("L")], float)
    assert len(points) < 1100
    assert np.ptp(points[:, 1]) > 100
    assert points[np.argmin(points[:, 1]), 0] == pytest.approx(WIDTH * 0.54321, abs=0.5)
    assert chart("none", {"y": (x, -y)}, "x", "y", log=True) == ""
    assert chart("one", {"y": (x[:1], y[:1])}, "x", "y") == ""


@pytest.mark.parametrize(("log", "gap"), [(True, 0.0), (True, np.nan), (False, np.nan)])
def test_a_curve_has_a_gap_where_it_has_no_value(log, gap):
    broken = np.array([1.0, 2.0, gap, gap, 50.0, gap, 90.0, 100.0])
    figure = chart("gap", {"y": (np.arange(8.0), broken)}, "x", "y", log=log)
    path = re.search(r' d="(.*?)"', figure)[1]
    assert [len(piece.split("L")) for piece in path.split("M")[1:]] == [2, 2, 2]  # a dot is two
    assert "nan" not in figure


def test_a_little_below_zero_costs_no_step_of_the_grid():
    figure = chart("energy", {"E": (np.linspace(0.01, 1.0, 9), np.linspace(-0.01, 1, 9))}, "t", "E")
    assert ">−0.2<" not in figure
    assert figure.count(">0<") == 2  # at both axes, though the curve begins at t = 0.01


def test_it_is_cheap(run, tmp_path):
    """It makes no more calls for 20,000 triangles than for 5,000: no loop of Python over them."""
    run()
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())

    def count_calls(h):
        cloth = fc.Cloth.rectangle(1.0, 1.0, h=h, pattern="right")
        system = fc.System(cloth, fc.Fabric(0.2, 1000.0), [fc.StVK()], pins=["left"])
        state, calls = system.state(1.01 * system.rest().x), itertools.count()
        frame = Frame(0.0, state.x, cloth.cells, *fields(system, state))
        sys.setprofile(lambda *_: next(calls))
        write_report(tmp_path / "run", summary, frame)
        sys.setprofile(None)
        return len(cloth.triangles), next(calls)

    count_calls(0.1)  # reads the template
    (few, first), (many, second) = count_calls(0.02), count_calls(0.01)
    assert (few, many) == (5_000, 20_000)
    assert abs(second - first) < 1_000
