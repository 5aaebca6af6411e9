"""report.html: what it says, that it stands alone, and what it costs."""

import base64
import json
import re

import numpy as np
import pytest

import fecloth as fc
from fecloth.cli.main import main
from fecloth.view.charts import Chart, draw, observed_charts
from fecloth.view.html_report import read_table

SCENE = """
title = "a <sheet> & its report"
cloth = { shape = "rectangle", width = 1.0, height = 0.5, h = 0.2 }
fabric = { areal_density = 0.2, tensile_stiffness = 1000.0 }
terms = [{ type = "StVK" }, { type = "Gravity" }]
pins = [{ where = "left" }]
time = { method = "backward_euler", dt = 0.01, t_end = 0.1 }
output = { every = 0.05 }
"""


def report(folder, *more):
    """The exit status of a run, and its report."""
    (folder / "sheet.toml").write_text(SCENE, encoding="utf-8")
    given = [str(folder / "sheet.toml"), "-o", str(folder / "run"), "--quiet", *more]
    return main(["run", *given]), (folder / "run" / "report.html").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def ended(tmp_path_factory):
    """The folder of a run, and its report."""
    folder = tmp_path_factory.mktemp("report")
    status, page = report(folder)
    assert status == 0
    return folder / "run", page


def data_of(page):
    """The numbers a page holds."""
    return json.loads(re.search(r'id="data">(.*?)</script>', page, re.DOTALL)[1])


def unpacked(text, low, high):
    shorts = np.frombuffer(base64.b64decode(text), "<u2").astype(float)
    return low + np.subtract(high, low) * shorts.reshape(-1, np.size(low)) / 65535


def test_a_run_leaves_a_report_of_its_end(ended):
    folder, page = ended
    assert "a &lt;sheet&gt; &amp; its report" in page
    assert "<sheet>" not in page
    assert '<span class="status warned">done, with warnings</span>' in page
    for title in ("Energy ledger", "Principal stretches", "Step size", "Iterations a step"):
        assert f"<figcaption>{title}" in page
    assert "tensile_stiffness = 1000" in page
    assert 'class="note failed' not in page
    log = (folder / "run.log").read_text()
    assert page.count('<p class="note">') == log.count(" warning: ") + log.count(" check: ")
    data = data_of(page)
    cloth = fc.Cloth.rectangle(1.0, 0.5, h=0.2)
    last = fc.read_frame(folder / "frames/frame_000002.vtu", cloth)
    low, high = np.array(data["low"]), np.array(data["high"])
    shown = unpacked(data["points"], low, high)
    assert np.abs(shown - last.x).max() < np.max(high - low) / 65535
    assert data["times"] == [last.t] == [0.1]
    drawn = np.frombuffer(base64.b64decode(data["triangles"]), "<u4").reshape(-1, 3)
    assert np.array_equal(drawn, cloth.triangles)


def test_its_charts_have_the_names_of_the_columns(tmp_path):
    _, page = report(tmp_path, "--set", 'probes=[{ name = "tip", where = "right" }]')
    titles = re.findall("<figcaption>(.*?)</figcaption>", page)
    assert titles[:5] == ["tip", "mean_displacement", "sag", "area", "reaction:left"]


def test_charts_of_observed_columns_have_their_units():
    names = ["t", "tip.x", "tip.y", "tip.z", "area", "own", "least_distance:ball"]
    reaction = [f"reaction:left.{axis}" for axis in "xyz"]
    shown = observed_charts({name: np.zeros(2) for name in [*names, *reaction]})
    units = {"tip": "[m]", "area": "[m²]", "own": "", "least_distance:ball": "[m]"}
    assert {chart.title: chart.y for chart in shown} == {**units, "reaction:left": "[N]"}
    assert list(shown[0].curves) == ["tip.x", "tip.y", "tip.z"]
    assert observed_charts({}) == []


@pytest.mark.parametrize("size", [1e-9, 2e-4, 2.5e-3, 0.1, 1e3, 1e7])
@pytest.mark.parametrize(
    ("mean", "log"), [(-1, False), (0, False), (1, False), (0, True), (1, True)]
)
def test_labels_of_an_axis_are_inside_the_picture(size, mean, log):
    t = np.array([0.0, 1e-4])
    (figure,) = draw([Chart("a", "label", t, {"a": mean + size * np.array([0.1, 1.0])}, log)])
    labels = re.findall(r'x="-5"[^>]*>([^<]*)<', figure)
    assert len(labels) > 1
    assert len(set(labels)) == len(labels)
    margin = -float(re.search(r'viewBox="([-0-9]+) ', figure)[1])
    title = float(re.search(r"translate\(([-0-9]+) ", figure)[1])
    assert margin + title > 9  # letters of this size are up to 9 high
    # A digit of the widest usual font is 7 wide, and a point half as wide.
    widths = [7.0 * len(text) - 3.5 * text.count(".") for text in labels]
    assert max(widths) < -5 - title - 2  # 2: below its line


def test_remainder_is_shown_as_a_share_of_the_moving_energy(ended):
    folder, page = ended
    ledger = np.genfromtxt(folder / "energies.csv", delimiter=",", names=True)
    stored = np.abs(ledger["StVK"] - ledger["StVK"][0])
    moved = ledger["kinetic"] + stored + np.abs(ledger["numerical"])  # it is pinned
    assert not any(name.startswith("dissipated") for name in ledger.dtype.names)
    left = ledger["remainder"][-1]
    share = 100 * abs(left) / moved.max()
    assert f"<b>{left:.2g} J, {share:.2g} %</b><span>energy unexplained" in page


def test_page_needs_no_other_files(ended):
    page = re.sub(r'xmlns(:xlink)?="http://www.w3.org/[^"]*"', "", ended[1])  # names, not addresses
    assert not re.search(r'https?://|\bsrc=|\bhref="[^#]|@import|url\([^#]', page)
    assert "{{" not in page.split("<script")[0]


def test_what_may_be_a_mistake_in_the_set_up_is_at_the_top(ended, tmp_path):
    """A rigidity that no term uses is no warning, but the page has it."""
    _, page = report(tmp_path, "--set", "fabric.bending_rigidity=1e-5")
    assert '<p class="note">check: ' not in ended[1]
    (check,) = re.findall('<p class="note">check: (.*?)</p>', page)
    assert "bending_rigidity" in check


def test_failures_and_warnings_are_at_the_top(tmp_path):
    stop = ["--set", "solver.max_iterations=1", "--set", "solver.tolerance=1e-9"]
    status, page = report(tmp_path, *stop)
    assert status == 3
    assert '<span class="status failed">failed</span>' in page
    assert page.index("did not converge") < page.index("<canvas")


def test_strains_are_those_of_the_frames(ended):
    folder, _ = ended
    table = read_table(folder / "strains.csv")
    cloth = fc.Cloth.rectangle(1.0, 0.5, h=0.2)
    for i in range(3):
        x = fc.read_frame(folder / f"frames/frame_{i:06d}.vtu", cloth).x
        edges, flat = (
            np.stack([at[cloth.triangles[:, k]] - at[cloth.triangles[:, 0]] for k in (1, 2)], 2)
            for at in (x, cloth.X)
        )
        stretches = np.linalg.svd(edges @ np.linalg.inv(flat), compute_uv=False)
        assert table["smallest"][i] == pytest.approx(stretches.min(), rel=1e-12)
        assert table["largest"][i] == pytest.approx(stretches.max(), rel=1e-12)


def test_an_empty_cell_of_a_table_is_no_number(tmp_path):
    file = tmp_path / "strains.csv"
    file.write_text("t,1 %\n0,\n1,2.5\n")
    assert read_table(file)["1 %"] == pytest.approx([np.nan, 2.5], nan_ok=True)
    file.write_text("")
    assert read_table(file) == {}


def path_of(figure):
    """The points of the only curve, and the number of its pieces."""
    path = re.search(r'd="([^"]*)" stroke="#0072B2"', figure)[1]
    points = re.findall(r"[ML]([-0-9.]+) ([-0-9.]+)", path)
    return np.array(points, float), path.count("M")


def test_a_chart_of_many_points_is_small_and_shows_peaks():
    x = np.linspace(0.0, 1.0, 100_000)
    y = np.ones_like(x)
    y[54_321] = 7.0
    points, _ = path_of(*draw([Chart("peak", "y", x, {"y": y})]))
    assert len(points) < 1100
    assert np.ptp(points[:, 1]) > 100
    share = (points[np.argmin(points[:, 1]), 0] - points[0, 0]) / np.ptp(points[:, 0])
    assert share == pytest.approx(0.54321, abs=1e-3)


@pytest.mark.parametrize(("log", "gap"), [(True, 0.0), (True, np.nan), (False, np.nan)])
def test_a_curve_has_a_gap_where_it_has_no_value(log, gap):
    broken = np.array([1.0, 2.0, gap, gap, 50.0, 60.0, gap, 90.0, 100.0])
    (figure,) = draw([Chart("gap", "y", np.arange(9.0), {"y": broken}, log)])
    points, pieces = path_of(figure)
    assert (len(points), pieces) == (6, 3)
    assert "nan" not in figure
