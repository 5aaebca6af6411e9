"""`chart`: the front, errors against a known limit, rows of failures, the figure, the command."""

import io
import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from support.scene_texts import STRING
from support.strips import scene_file

import fecloth as fc
from fecloth.study.command import StudyFailed
from fecloth.study.convergence import Convergence
from fecloth.study.figures import MOST_GROUPS, spread
from fecloth.study.fronts.drawing import best_rows, bound_of, is_known
from fecloth.study.fronts.result import Front, describe_front
from fecloth.study.result import Table

pytestmark = pytest.mark.usefixtures("counted_work")  # seconds decide
SCENE = '\ntitle = "a string"' + STRING.replace("h = 0.125", "h = 0.25").replace(
    '"sin', '"1e-3 * sin'
)


scene = scene_file(SCENE, "string")


def exact_middle(t):
    """A taut string: ρ z'' = S z_XX with S = Y (1.1² − 1)/2, started with sin(π X) 1e-3 m/s."""
    rate = math.pi * math.sqrt(100.0 * (1.1**2 - 1) / 2 / 0.2)
    return 1e-3 * math.sin(rate * t) / rate


# --- the front, its verdict and its figure, on made-up rows ---------------------------------------


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
    best = best_rows([row for row in rows if is_known(row)])
    return [row | {"on front": row in best} for row in rows]


def made_up_chart():
    rows = made_up_rows()
    limit = Convergence("made up", "converges: x", Table(()), value=1.0, uncertainty=0.02)
    return Front("made up", "…", Table(tuple(rows)), quantity="x", limit=limit, size=1.0)


def test_no_row_beats_the_front_and_the_front_beats_all_others():
    rows = made_up_rows()
    known = [row for row in rows if row["status"] == "ok"]
    for row in known:
        beaten = any(
            other["seconds"] < row["seconds"]
            and max(other["error"], 0.02) <= max(row["error"], 0.02)
            for other in known
        )
        assert row["on front"] != beaten


def test_the_verdict_names_the_cheapest_setting_of_each_level():
    row = {"status": "ok", "method": "BDF2", "element": "P1", "model": "StVK", "on front": True}
    row |= {"uncertainty": 1e-4, "uncertainty %": 0.01, "h": 0.01, "dt": 0.005}
    rows = [
        row | {"seconds": 0.1, "error": 0.05, "error %": 5.0},
        row | {"seconds": 0.8, "error": 0.003, "error %": 0.3},
        row
        | {"seconds": 0.7, "error": 0.00995, "error %": 0.995},  # with its uncertainty above 1 %
    ]
    limit = made_up_chart().limit
    assert describe_front(Table(tuple(rows)), limit) == (
        "10 %: BDF2 with P1, h = 1 cm, dt = 5 ms, 0.1 s (error 5 %)\n"
        "1 %: BDF2 with P1, h = 1 cm, dt = 5 ms, 0.8 s (error 0.3 %)\n"
        "no setting is proved to reach 0.1 %"
    )
    exact = [row | {"seconds": 0.05, "error": 5e-5, "error %": 0.005}, *rows]
    assert describe_front(Table(tuple(exact)), limit).splitlines()[0] == (
        "10, 1, 0.1 %: BDF2 with P1, h = 1 cm, dt = 5 ms, 0.05 s (error at most 0.015 %)"
    )


@pytest.mark.parametrize(("error", "drawn"), [(0.8, 1.8), (1.25, 1.25), (0.0, 1.0)])
def test_an_error_below_its_uncertainty_is_drawn_as_an_open_mark_at_its_bound(error, drawn):
    row = made_up_rows()[0] | {"error": error, "uncertainty": 1.0, "on front": True}
    row |= {"error %": error, "uncertainty %": 1.0}
    assert bound_of(row) == pytest.approx(drawn)
    axes = Front("t", "…", Table((row,)), "x", made_up_chart().limit, size=1.0).figure().axes[0]
    open_marks = [
        line for line in axes.lines if line.get_mfc() == "white" and len(line.get_xdata())
    ]
    assert len(open_marks) == 2 * (error < 1.0)  # the mark of each setting and of the best ones
    assert all(line.get_ydata() == pytest.approx([drawn]) for line in open_marks)


def test_the_chart_says_of_which_quantity_its_errors_are():
    chart = replace(made_up_chart(), others=("y", "z"))
    assert chart.notes()[0] == "All errors are of x, the first quantity; not of y, z."


def test_no_labels_of_the_figure_collide_or_are_cut_off():
    """The small words at the points do not overlap: words without room are left out."""
    from matplotlib.text import Text

    drawing = made_up_chart().figure()
    drawing.savefig(io.BytesIO())
    ax = drawing.axes[0]
    texts = [text for text in ax.texts if text.get_fontsize() > 7]
    texts += [ax.xaxis.label, ax.yaxis.label]
    boxes = [Text.get_window_extent(text) for text in texts if text.get_text()]  # no leaders
    assert len(boxes) == MOST_GROUPS + 3  # the lines, the band and the axes
    for box in boxes:
        assert drawing.bbox.x0 <= box.x0
        assert box.x1 <= drawing.bbox.x1
    points = [text for text in ax.texts if text.get_fontsize() == 7]
    assert {text.get_text() for text in points} == {"h 100 mm, dt 10 ms"}
    assert len(points) > len(made_up_chart().front)
    for group in (boxes, [Text.get_window_extent(text) for text in points]):
        for a, b in itertools.combinations(group, 2):
            assert not a.overlaps(b)


def test_labels_are_spread():
    heights = [0.02, 0.0, 0.99, 1.0, 0.5]
    result = spread(heights, 0.1)
    assert np.argsort(result).tolist() == np.argsort(heights).tolist()
    assert np.diff(np.sort(result)).min() > 0.1 - 1e-6
    assert min(result) >= -1e-9
    assert max(result) <= 1 + 1e-9


# --- runs -----------------------------------------------------------------------------------------


@pytest.mark.stories
def test_errors_of_a_string_with_a_known_solution(scene, tmp_path):
    models = ["StVK", "TensorCondition"]
    methods = ["implicit_midpoint", "auto"]
    result = fc.study.chart(scene, "middle.z", methods, ["P1"], models, cache=tmp_path)
    truth = exact_middle(0.1)
    assert abs(result.limit.limit - truth) <= result.limit.uncertainty
    own = [row for row in result.table if row["method"] == "implicit_midpoint"]
    own = [row for row in own if row["status"] == "ok" and row["pattern"] == "right"]
    assert len(own) > 3
    for row in own[:3]:
        sizes = {"cloth.h": [row["h"]], "time.dt": [row["dt"]], "cloth.element": ["P1"]}
        again = fc.study.sweep(scene, sizes, "middle.z", cache=tmp_path)
        error = abs(again.table["middle.z"][0] - truth)
        assert abs(row["error"] - error) <= row["uncertainty"]
        assert row["error %"] == pytest.approx(100 * row["error"] / abs(truth), rel=0.02)
        assert row["at most %"] == row["error %"] + row["uncertainty %"]
    refused = [row for row in result.table if row["status"] == "refused"]
    assert {row["model"] for row in refused} == {"TensorCondition"}
    assert "k" in refused[0]["cause"]
    tolerances = {row["rtol"] for row in result.table if row["method"] == "auto"}
    assert 0.1 in tolerances
    assert all(row["seconds"] > 0 for row in result.table if row["status"] == "ok")
    assert result.verdict.startswith("10")
    assert min(row["h"] for row in own) >= 0.99 * 0.125  # with meshes = 2


def test_models_that_are_all_refused_are_named(scene):
    with pytest.raises(StudyFailed, match="no limit was found: .*TensorCondition"):
        fc.study.chart(scene, "middle.z", ["bdf2"], ["P1"], ["TensorCondition"])
