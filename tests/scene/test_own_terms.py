"""A scene with terms that a user writes."""

import pytest
from support.examples import example

import fecloth as fc
from fecloth.runs.run_scene import run_scene
from fecloth.scene.scene import load_scene

SCENE = """
cloth = { shape = "rectangle", width = 0.4, height = 0.3, h = 0.1, pattern = "right" }
fabric = { areal_density = 0.2, tensile_stiffness = 1000.0 }
terms = [
  { type = "Fung", strain = 0.15 },
  { type = "StrainRateDamping", time = 1e-3, law = { type = "Fung" } },
  { type = "Winkler", k = 300.0 },
]
pins = [{ where = "left" }]
start = { position = ["X", "Y", "0.05 * X"] }
time = { method = "bdf2", dt = 1e-3, t_end = 5e-3 }
"""


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


def test_scene_refuses_an_unknown_user_term(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text(SCENE, encoding="utf-8")
    winkler, fung = example("term").Winkler, example("law").Fung
    with pytest.raises(fc.SceneError, match=r"terms.0.type = 'Fung': must be one of BaraffWitkin"):
        load_scene(path)
    with pytest.raises(fc.SceneError, match=r"terms.2.type = 'Winkler': must be one of .*, Fung"):
        load_scene(path, terms={"Fung": fung})
    path.write_text(SCENE.replace("k = 300.0", "kk = 300.0"), encoding="utf-8")
    with pytest.raises(fc.SceneError, match="terms.2.kk = 300.0: unknown key; the keys are type"):
        load_scene(path, terms={"Winkler": winkler, "Fung": fung})
    with pytest.raises(
        fc.InputError, match="'StVK': must not be the name of a term of the package"
    ):
        load_scene(path, terms={"StVK": fung})
    for wrong in (winkler(1.0), object, 3):
        with pytest.raises(fc.InputError, match="must be the class of a term: a dataclass"):
            load_scene(path, terms={"Winkler": wrong})
