"""Orders and errors from successive runs, for known answers and for a scene."""

import numpy as np
import pytest

import fecloth as fc
from fecloth import study
from fecloth.study import richardson
from studies.convergence import __main__ as convergence

SCENE = """
[cloth]
shape = "rectangle"
width = 1.0
height = 1.0
h = 0.125
pattern = "right"
[fabric]
areal_density = 0.2
tensile_stiffness = 100.0
[[terms]]
type = "StVK"
[[pins]]
where = "boundary"
[start]
position = ["1.2 * X", "1.1 * Y", "0.05 * sin(pi * X) * sin(pi * Y)"]
[time]
method = "implicit_midpoint"
dt = 0.0025
t_end = 0.06
[solver]
tolerance = 1e-10
[output]
frames = 1
"""


def test_order_and_error_of_known_answers():
    answers = 3.0 + 0.2 * np.array([1, 1 / 8, 1 / 64, 1 / 512])
    np.testing.assert_allclose(richardson.orders(np.diff(answers)), 3.0)
    assert richardson.remaining_error(np.diff(answers)) == pytest.approx(
        3.0 - answers[-1], rel=1e-9
    )
    assert np.isnan(richardson.orders([1.0, -0.5])).all()


def test_distances_between_meshes():
    """Of x² on neighbouring meshes: the interpolants of one dimension differ by tents."""
    cloths = [fc.Cloth.rectangle(1.0, 1.0, h, "right") for h in (0.5, 0.25, 0.125)]
    apart = richardson.distances(cloths, [cloth.X[:, 0] ** 2 for cloth in cloths])
    # on each coarse cell a tent, (H/2)² high at its middle
    tents = [H**2 / 4 / np.sqrt(3) for H in (0.5, 0.25)]
    np.testing.assert_allclose(apart, tents, rtol=1e-12)


def test_a_scene_is_refined_in_space_and_time(tmp_path, monkeypatch):
    file, made = tmp_path / "my.toml", {}
    file.write_text(SCENE)
    options = study.parse_arguments("Mine.", ["--scene", str(file), "--out", str(tmp_path / "out")])
    keep = lambda *_, tables, **__: made.update(tables) or 0  # noqa: E731
    monkeypatch.setattr(richardson, "write_report", keep)
    assert richardson.refine_scene(options) == 0
    space, time = next(iter(made.values()))
    assert (space["order"], time["order"]) == pytest.approx((2, 2), abs=0.15)
    # the time error against a run of a sixteenth of the step
    built = richardson.load_scene(file).build()
    run_ = built.system, built.method, built.state
    ends = [
        fc.run(*run_, dt, built.t_end, newton=built.newton).state.x for dt in (0.0025, 0.0025 / 16)
    ]
    error = built.cloth.l2_norm(ends[0] - ends[1])
    assert time["error [m²]"] == pytest.approx(error, rel=0.05)


def test_sentences_about_convergence():
    good = {"halved": "h", "order": 2.0, richardson.RELATIVE: 1.234}
    assert "h: the error of the scene is about 1.2 %" in richardson.describe_errors([good])
    changes = dict.fromkeys(richardson.CHANGES, 22.0)
    for order in (0.51, -1.0, np.nan):
        bad = good | changes | {"order": order}
        assert "h: the scene does not converge" in richardson.describe_errors([bad])
    failed = {"halved": "dt", "status": "a run failed"}
    assert "dt: no estimate" in richardson.describe_errors([failed])


def test_a_scene_without_h_is_refused(tmp_path):
    text = SCENE.replace('shape = "rectangle"', 'shape = "file"\npath = "square.msh"')
    lines = text.splitlines()
    gone = ("width", "height", "h =", "pattern")
    (tmp_path / "a.toml").write_text("\n".join(x for x in lines if not x.startswith(gone)))
    cloth = fc.Cloth.rectangle(1.0, 1.0, 0.5, "right")
    fc.write_vtk(tmp_path / "square", cloth, fc.State(0.0, *np.zeros((2, len(cloth.X), 3))))
    (tmp_path / "square.msh").write_bytes((tmp_path / "square_000000.vtu").read_bytes())
    options = study.parse_arguments("Mine.", ["--scene", str(tmp_path / "a.toml")])
    with pytest.raises(fc.SceneError, match=r"needs cloth.h"):
        richardson.refine_scene(options)


def test_a_failed_run_misses_its_orders():
    """Also where every run of a family failed."""
    failed = {"status": "failed", "cause": "x"}
    rows, steps, swings = (
        [case | failed for case in cases(True)]
        for cases in (convergence.space_cases, convergence.time_cases, convergence.swing_cases)
    )
    findings = convergence.conclude_space(rows) + convergence.conclude_time(steps)
    findings += convergence.conclude_swing(convergence.compare_swings(swings))
    assert len(findings) == 80
    assert not any(finding.is_met for finding in findings)
