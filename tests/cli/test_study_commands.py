"""The command of each study from a file to its report, as a user types it."""

import pytest
from support.rundirs import rows_of
from support.scene_texts import STRING, STRIP

pytestmark = [pytest.mark.stories, pytest.mark.usefixtures("counted_work")]
STUDIES = {  # its options, what it says, and files beside the report and its table
    "converge": ("--levels 3", "tip.x = 1.0", ["figure.png", "finest.pvd", "cache"]),
    "compare": ("--variants terms.0.type=StVK,Springs", "first.pvd", ["figure.png"]),
    "chart": ("--elements P1 --meshes 1", "Limit: tip.x", ["figure.png"]),
    "stability": (
        "--over fabric.areal_density=0.2 --methods central_difference",
        "central_difference holds the longest step",
        ["figure.png", "runs.csv"],
    ),
    "simplify": ("--tolerance 0.1%", "needed: Gravity", ["figure.svg", "reduced.toml"]),
    "tune": ("--tolerance 3% --elements P1", "proved: ", ["tuned.toml"]),
}


@pytest.mark.parametrize("name", STUDIES)
def test_a_study_goes_from_a_scene_to_its_report(name, tmp_path, run_command):
    options, words, files = STUDIES[name]
    scene, folder = tmp_path / "strip.toml", tmp_path / "out"
    scene.write_text(STRING if name == "stability" else STRIP)
    out, err = run_command(name, scene, *options.split(), "-o", folder)
    assert words in out
    assert "out/report.html" in out
    assert str(tmp_path) not in err + (folder / "report.html").read_text()
    assert rows_of(folder / "results.csv")
    assert not [file for file in files if not (folder / file).exists()]
