"""A scene with terms that a user writes."""

import pytest
from support.examples import example
from support.wrong_calls import OWN_TERMS as SCENE

from fecloth.runs.run_scene import run_scene
from fecloth.scene.scene import load_scene


@pytest.mark.stories
def test_scene_runs_with_user_terms(tmp_path):
    terms = {"Winkler": example("term").Winkler, "Fung": example("law").Fung}
    path = tmp_path / "scene.toml"
    path.write_text(SCENE, encoding="utf-8")
    scene = load_scene(path, terms=terms)
    system = scene.build().system
    assert system.terms[0] == example("law").Fung(0.15)
    assert system.terms[1].law == example("law").Fung(0.2)
    assert system.terms[2] == example("term").Winkler(300.0)
    outcome = run_scene(scene, tmp_path / "out")
    assert outcome.status == "done"
    header = (tmp_path / "out" / "energies.csv").read_text().splitlines()[0]
    assert header.split(",")[:4] == ["t", "kinetic", "Fung", "Winkler"]
    assert load_scene(tmp_path / "out" / "scene.resolved.toml", terms=terms) == scene
    assert load_scene(path, ["terms.2.k=20"], terms=terms).terms[2].make().k == 20
