"""`chart`: the front, errors against a known limit, rows of failures, the figure, the command."""

import io
import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from fecloth.study.chart_result import (
    Chart,
    bound_of,
    describe_chart,
    find_front,
    grey_letters,
    split_series,
)
from matplotlib.text import Text
from support.rundirs import rows_of
from support.scene_texts import STRING

import fecloth as fc
from fecloth.cli import main as cli
from fecloth.errors import InputError
from fecloth.study.convergence import Convergence
from fecloth.study.figures import MOST_GROUPS, spread
from fecloth.study.result import Table

pytestmark = [pytest.mark.stories, pytest.mark.usefixtures("counted_work")]  # seconds decide
SCENE = '\ntitle = "a string"' + STRING.replace("h = 0.125", "h = 0.25").replace(
    '"sin', '"1e-3 * sin'
)


@pytest.fixture
def scene(tmp_path):
    file = tmp_path / "string.toml"
    file.write_text(SCENE)
    return file


def exact_middle(t):
    """A taut string: ρ z'' = S z_XX with S = Y (1.1² − 1)/2, started with sin(π X) 1e-3 m/s."""
    rate = math.pi * math.sqrt(100.0 * (1.1**2 - 1) / 2 / 0.2)
    return 1e-3 * math.sin(rate * t) / rate


def made_up_rows(count=60, uncertainty=0.02):
    random = np.random.default_rng(1)
    rows = []
    for i in range(count):
        seconds, error = np.exp(random.uniform(-4, 1, 2))
        row = {"status": "ok", "method": f"Method{i % 11}", "element": "P1", "model": "StVK"}
        row |= {"h": 0.1, "dt": 0.01, "seconds": seconds, "error": error}
        row |= {"uncertainty": uncertainty, "error %": 100 * error}
        rows.append(row | {"uncertainty %": 100 * uncertainty})
    rows[7] = {"status": "failed", "method": "Method7", "element": "P1", "model": "StVK"}
    front = find_front(rows)
    return [row | {"on front": i in front} for i, row in enumerate(rows)]


def made_up_chart():
    rows = made_up_rows()
    limit = Convergence("made up", "converges: x", Table(()), value=1.0, uncertainty=0.02)
    return Chart("made up", "…", Table(tuple(rows)), quantity="x", limit=limit, size=1.0)


def test_no_row_beats_the_front_and_the_front_beats_all_others():
    rows = made_up_rows()
    good = [row for row in rows if row["status"] == "ok"]
    for row in good:
        beaten = any(
            other["seconds"] < row["seconds"]
            and max(other["error"], 0.02) <= max(row["error"], 0.02)
            for other in good
        )
        assert row["on front"] != beaten


def test_the_verdict_names_the_cheapest_setting_of_each_level():
    row = {"status": "ok", "method": "BDF2", "element": "P1", "model": "StVK", "on front": True}
    row |= {"uncertainty": 1e-4, "uncertainty %": 0.01, "h": 0.01, "dt": 0.005}
    rows = [
        row | {"seconds": 0.1, "error": 0.05, "error %": 5.0},
        row | {"seconds": 0.8, "error": 0.003, "error %": 0.3},
        row
        | {"seconds": 0.9, "error": 0.00995, "error %": 0.995},  # with its uncertainty above 1 %
    ]
    limit = made_up_chart().limit
    assert describe_chart(Table(tuple(rows)), limit) == (
        "10 %: BDF2 with P1, h = 1 cm, dt = 5 ms, 0.1 s (error 5 %)\n"
        "1 %: BDF2 with P1, h = 1 cm, dt = 5 ms, 0.8 s (error 0.3 %)\n"
        "no setting is proved to reach 0.1 %"
    )
    exact = [row | {"seconds": 0.05, "error": 5e-5, "error %": 0.005}, *rows]
    assert describe_chart(Table(tuple(exact)), limit).splitlines()[0] == (
        "10, 1, 0.1 %: BDF2 with P1, h = 1 cm, dt = 5 ms, 0.05 s (error at most 0.015 %)"
    )
    vague = [one | {"uncertainty %": 0.2} for one in rows]
    assert describe_chart(Table(tuple(vague)), limit).endswith("is known to 0.2 % only")


@pytest.mark.parametrize(("error", "drawn"), [(0.8, 1.8), (1.25, 1.25), (0.0, 1.0)])
def test_an_error_below_its_uncertainty_is_drawn_as_an_open_mark_at_its_bound(error, drawn):
    row = made_up_rows()[0] | {"error": error, "uncertainty": 1.0, "on front": True}
    row |= {"error %": error, "uncertainty %": 1.0}
    assert bound_of(row) == pytest.approx(drawn)
    axes = Chart("t", "…", Table((row,)), "x", made_up_chart().limit, size=1.0).figure().axes[0]
    open_marks = [
        line for line in axes.lines if line.get_mfc() == "white" and len(line.get_xdata())
    ]
    assert len(open_marks) == 2 * (error < 1.0)  # the mark of each setting and of the best ones
    assert all(line.get_ydata() == pytest.approx([drawn]) for line in open_marks)


def test_the_chart_says_of_which_quantity_its_errors_are():
    chart = replace(made_up_chart(), others=("y", "z"))
    assert chart.notes()[0] == "All errors are of x, the first quantity; not of y, z."


def test_errors_of_a_string_with_a_known_solution(scene, tmp_path):
    found = fc.study.chart(
        scene,
        "middle.z",
        ["implicit_midpoint", "auto"],
        ["P1"],
        ["StVK", "TensorCondition"],
        cache=tmp_path,
    )
    truth = exact_middle(0.1)
    exact = abs(found.limit.limit - truth)
    assert exact <= found.limit.uncertainty
    again = fc.study.sweep(scene, "cloth.h=0.25,0.125", "middle.z", cache=tmp_path)
    own = [row for row in found.table if row["method"] == "ImplicitMidpoint"]
    same = [row for row in own if row.get("dt") == 0.01]
    for row, value in zip(same, again.table["middle.z"], strict=True):
        assert abs(row["error"] - abs(value - truth)) <= row["uncertainty"]
        assert row["error %"] == pytest.approx(100 * row["error"] / abs(truth), rel=0.02)
        assert row["at most %"] == bound_of(row, " %")  # which is what the figure has
    settings = {(row["h"], row["dt"]) for row in own if row["status"] == "ok"}
    assert settings == set(itertools.product((0.25, 0.125), (0.01, 0.005, 0.0025)))
    refused = [row for row in found.table if row["status"] == "refused"]
    assert {row["model"] for row in refused} == {"TensorCondition"}
    assert "k" in refused[0]["cause"]
    tolerances = {row["rtol"] for row in found.table if row["method"] == "Auto"}
    assert tolerances == {0.1, 0.01, 0.001}
    assert all(row["seconds"] > 0 for row in found.table if row["status"] == "ok")
    assert found.verdict.startswith("10")


def test_too_long_cases_are_rows(scene):
    found = fc.study.chart(scene, "middle.z", ["bdf2"], ["P1"], time_limit=1e-9, meshes=1)
    assert found.table["status"] == ["skipped"] * 3
    assert found.table["dt"] == [0.01, 0.005, 0.0025]
    assert found.table["h"] == [0.25] * 3
    assert found.verdict == "no setting has an error"
    assert "3 skipped, of 3" in found.notes()[-1]
    assert not len(found.front)
    found.figure()


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"methods": ["bfd2"]}, "Did you mean 'bdf2'"),
        ({"elements": ["P3"]}, "must be one of P1, P2"),
        ({"models": ["StKV"]}, "Did you mean 'StVK'"),
        ({"meshes": 0}, "from 1 to 4"),
        ({"quantity": "midle.z"}, "unknown quantity"),
        ({"quantity": "frequency(1)"}, "take converge"),
        ({"models": ["TensorCondition"], "elements": ["P1"]}, "refuses every setting"),
    ],
)
def test_mistakes(scene, more, message):
    with pytest.raises(InputError, match=message.replace("(", r"\(")):
        fc.study.chart(scene, **({"quantity": "middle.z"} | more))


def test_a_huge_scene_is_refused_before_it_is_meshed(scene, monkeypatch):
    scene.write_text(SCENE.replace("h = 0.25,", "h = 0.0005,"))
    monkeypatch.setattr("fecloth.study.charts.make_settings", lambda *_: pytest.fail("meshed"))
    with pytest.raises(InputError, match="predicted time above"):
        fc.study.chart(scene, "middle.z")


def test_at_most_eight_lines_and_a_letter_for_each_other_series():
    chart = made_up_chart()
    lines, rest = split_series(chart.table)
    assert (len(lines), len(rest)) == (MOST_GROUPS, 3)
    on_front = {f"{row['method']} P1" for row in chart.front}
    assert len(on_front) <= MOST_GROUPS
    assert on_front <= set(lines)
    letters = grey_letters(chart.table)
    assert set(letters) == set(rest)
    assert all(f"{letter} {name}" in chart.notes()[1] for name, letter in letters.items())


def test_no_labels_of_the_figure_collide_or_are_cut_off():
    drawing = made_up_chart().figure()
    drawing.savefig(io.BytesIO())
    ax = drawing.axes[0]
    texts = [*ax.texts, ax.xaxis.label, ax.yaxis.label]
    boxes = [Text.get_window_extent(text) for text in texts if text.get_text()]  # no leaders
    assert len(boxes) == MOST_GROUPS + 3  # the lines, the band and the axes
    for box in boxes:
        assert drawing.bbox.x0 <= box.x0
        assert box.x1 <= drawing.bbox.x1
    for a, b in itertools.combinations(boxes, 2):
        assert not a.overlaps(b)


def test_labels_are_spread():
    heights = [0.02, 0.0, 0.99, 1.0, 0.5]
    found = spread(heights, 0.1)
    assert np.argsort(found).tolist() == np.argsort(heights).tolist()
    assert np.diff(np.sort(found)).min() > 0.1 - 1e-6
    assert min(found) >= -1e-9
    assert max(found) <= 1 + 1e-9


@pytest.mark.filterwarnings("ignore")
def test_a_function_with_a_step_that_is_refused():
    def string(h, dt, method):
        cloth = fc.Cloth.rectangle(1.0, 0.25, h, pattern="right")
        system = fc.System(cloth, fc.Fabric(0.2, 100.0), [fc.StVK()], pins=["left", "right"])
        v = np.column_stack([0 * cloth.X, 1e-3 * np.sin(np.pi * cloth.X[:, 0])])
        return cloth, system, getattr(fc, method)(), system.state(system.rest().x * [1.1, 1, 1], v)

    run = {"h": 0.25, "dt": 0.01, "t_end": 0.1, "probes": [fc.Probe("m", point=(0.5, 0.1))]}
    methods = ["BDF2", "CentralDifference"]
    found = fc.study.chart(string, "m.z", methods, method="BDF2", meshes=1, **run)
    assert abs(found.limit.limit - exact_middle(0.1)) <= found.limit.uncertainty
    unstable = found.table[3]
    assert (unstable["method"], unstable["dt"]) == ("CentralDifference", 0.01)
    assert unstable["status"] == "refused"
    assert found.table["status"].count("ok") == 5


def test_the_command(scene, tmp_path, capsys):
    folder = tmp_path / "out"
    words = ["--quantity", "middle.z", "--methods", "bdf2", "--elements", "P1", "-o", str(folder)]
    assert cli.main(["chart", str(scene), *words, "--meshes", "1"]) == 0
    rows = rows_of(folder / "results.csv")
    assert [row["method"] for row in rows] == ["BDF2"] * 3
    assert (folder / "figure.png").exists()
    printed = capsys.readouterr()
    assert "Limit: middle.z" in printed.out
    assert str(tmp_path) not in printed.err
