"""`sweep`: values of keys, rows, refused values, the command."""

import re

import numpy as np
import pytest
from support.rundirs import rows_of
from support.scene_texts import STRIP
from support.strips import TIP, scene_file
from support.strips import strip as hung

import fecloth as fc
from fecloth.cli import main as cli
from fecloth.cli.studies import converge, sweep
from fecloth.cli.study_command import name_question
from fecloth.study.variants import parse_range, read_ranges
from studies.references.closed_forms import hanging_strip_tip

SCENE = STRIP.replace('"tip.x"', '"tip.x", "sag"')
scene = scene_file(SCENE, "strip")


def strip(h, stiffness, power=0):
    return hung(h, stiffness * 10.0**power)


def test_the_tip_of_a_strip_over_its_stiffness(scene, tmp_path):
    over = "fabric.tensile_stiffness=5:500:log:3"
    result = fc.study.sweep(scene, over, cache=tmp_path)
    exact = [1 + hanging_strip_tip(1.0, y, 0.2) for y in (5.0, 50.0, 500.0)]
    np.testing.assert_allclose(result.table["tip.x"], exact, rtol=1e-4)
    assert result.quantities == ("tip.x", "sag")  # all of [interest]
    assert result.units == ("m", "m")
    assert result.table["fabric.tensile_stiffness"] == [5.0, 50.0, 500.0]
    assert result.verdict.startswith(f"tip.x from {exact[2]:.4g} to {exact[0]:.4g}")


def test_two_keys_of_a_function_and_a_field():
    over = {"stiffness": [5.0, 50.0], "power": [0, 1]}
    result = fc.study.sweep(strip, over, ["tip.x", "displacement"], h=0.25, probes=TIP)
    assert result.table["power"] == [0, 1, 0, 1]
    assert result.table["tip.x"][1] == pytest.approx(result.table["tip.x"][2], rel=1e-12)
    same = fc.study.sweep(strip, "h=0.25,0.125", "tip.x", stiffness=5.0, probes=TIP)
    assert same.table["tip.x"][0] == pytest.approx(result.table["tip.x"][0], rel=1e-12)
    assert result.figure().axes[0].get_ylabel() == "tip.x [m]"


def test_a_refused_value_has_a_row_with_its_reason_and_the_others_run(scene):
    key = "fabric.tensile_stiffness"
    result = fc.study.sweep(scene, f"{key}=-1,20", "tip.x")
    assert result.table["status"] == ["refused", "ok"]
    assert f"{key} = -1.0: must be" in result.table["cause"][0]
    assert result.table["tip.x"][1] > 1
    assert result.exit_status == 3
    mesh = fc.study.sweep(scene, "cloth.h=3,0.25", "tip.x")
    assert "must be at most" in mesh.table["cause"][0]
    assert "/tmp" not in mesh.table["cause"][0]
    assert mesh.table["status"] == ["refused", "ok"]
    assert mesh.table["tip.x"][1] > 1
    assert "1 of 2 runs failed" in mesh.verdict


def test_ranges():
    assert parse_range("a.b=0:1:lin:3") == ("a.b", [0.0, 0.5, 1.0])
    assert parse_range("a=1,2.5,bdf2") == ("a", [1, 2.5, "bdf2"])


def test_the_command(scene, tmp_path, capsys):
    over = ["--over", "fabric.tensile_stiffness=5:500:log:3"]
    folder = tmp_path / "out"
    assert cli.main(["sweep", str(scene), *over, "--quantity", "sag", "-o", str(folder)]) == 0
    rows = rows_of(folder / "results.csv")
    assert [row["fabric.tensile_stiffness"] for row in rows] == ["5.0", "50.0", "500.0"]
    assert "sag" in rows[0]
    assert (folder / "report.html").exists()
    assert "fabric.tensile_stiffness = 50.0: ok" in capsys.readouterr().err


def test_a_text_in_a_mapping_is_read_as_after_the_key():
    assert read_ranges({"a": "1,2"}) == {"a": [1, 2]}


def test_each_question_of_the_command_has_its_own_folder(scene, monkeypatch, capsys):
    for quantity in ("tip.x", "sag"):
        over = ["--over", "cloth.h=0.25", "--quantity", quantity]
        assert cli.main(["sweep", str(scene), *over]) == 0
    names = sorted(page.parent.name for page in scene.parent.glob("out/sweep/*/report.html"))
    assert names == [
        "strip,quantity=sag,over=cloth.h=0.25",
        "strip,quantity=tip.x,over=cloth.h=0.25",
    ]
    assert "1 case, up to 8 triangles × 10 Newton iterations" in capsys.readouterr().err
    over = ["cloth.h=0.25:0.125:lin:2"]  # which no folder can be called everywhere
    name = name_question(sweep.__wrapped__, {"quantity": None, "set_": None, "over": over})
    assert re.fullmatch(r",over=cloth.h=0.25_0.125_lin_2-\w{6}", name)
    assert name_question(converge.__wrapped__, {"levels": 4, "set_": None}) == ""
    own = {"levels": 5, "set_": ["a=1", "b=2"], "grade": True}
    assert name_question(converge.__wrapped__, own) == ",levels=5,set=a=1,set=b=2,grade=True"


def test_a_study_shows_what_is_to_be_checked_in_the_set_up(scene, tmp_path, capsys):
    scene.write_text(
        SCENE.replace("= 1.0", "= 40.0").replace("0.25", "10.0").replace("0.125", "5.0")
    )
    result = fc.study.sweep(scene, "cloth.h=5.0", "sag")
    line = next(doubt.line for doubt in result.doubts if "40 m long" in doubt.words)
    assert line.startswith("check: ")
    assert line in capsys.readouterr().err
    assert line in result.summary()
    assert "check: " in result.report(tmp_path / "report").read_text()
    assert result.warnings == ()
