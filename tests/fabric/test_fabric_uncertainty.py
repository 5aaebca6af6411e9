"""Standard uncertainties of fabrics: tables, covariances, files, presets, and refusals."""

import dataclasses
import math
import tomllib
import typing
from importlib.resources import files

import numpy as np
import pytest

import fecloth as fc
from fecloth.errors import InputError
from fecloth.fabric.uncertainty import CONSTANTS, PAIRS, Uncertainty
from fecloth.scene.scene import load_scene, scene_of
from fecloth.study.parameters import choose_parameters
from fecloth.study.problem import StudyProblem

TABLE = {
    "tensile_stiffness": "1 %",
    "tensile_stiffness.0": "0.12 N/cm",
    "shear_stiffness": "5 %",
    "bending_rigidity": 1e-6,
    "correlation": [["tensile_stiffness.0", "shear_stiffness", -0.4]],
    "source": "a fit",
}
FABRIC = fc.Fabric(0.2, (1000.0, 900.0), 0.2, 60.0, 2e-5, uncertainty=TABLE)
STANDARD = {  # 0.12 N/cm, 1 % of 900, 5 % of 60
    "tensile_stiffness.0": 12.0,
    "tensile_stiffness.1": 9.0,
    "shear_stiffness": 3.0,
    "bending_rigidity": 1e-6,
}
FILE = """[fabric]
areal_density = "200 g/m^2"
tensile_stiffness = [1000.0, 900.0]
shear_stiffness = 60.0
[fabric.uncertainty]
"tensile_stiffness.0" = 12.0
tensile_stiffness.1 = "1 %"
shear_stiffness = "5 %"
correlation = [["tensile_stiffness.0", "shear_stiffness", -0.4]]
"""
REST = """
[cloth]
shape = "rectangle"
width = 1.0
height = 1.0
h = 0.5
pattern = "right"
[[terms]]
type = "StVK"
[[pins]]
where = "left"
[equilibrium]
"""


def test_the_keys_are_the_constants_of_a_fabric():
    hints = typing.get_type_hints(fc.Fabric, include_extras=True)
    names = [each.name for each in dataclasses.fields(fc.Fabric)]
    assert [*CONSTANTS, "source", "uncertainty"] == names
    for name, dimension in CONSTANTS.items():
        assert [*getattr(hints[name], "__metadata__", ())] == ([dimension] if dimension else [])
        assert (name in PAIRS) == ("tuple" in str(hints[name]))


def test_a_table_becomes_standard_uncertainties_and_their_covariance():
    uncertainty = FABRIC.uncertainty
    assert uncertainty.standard(FABRIC) == pytest.approx(STANDARD)
    assert list(uncertainty.standard(FABRIC)) == list(STANDARD)
    expected = np.diag(np.array(list(STANDARD.values())) ** 2)
    expected[0, 2] = expected[2, 0] = -0.4 * 12 * 3
    np.testing.assert_allclose(uncertainty.covariance(FABRIC), expected)
    keys = ["shear_stiffness", "tensile_stiffness"]
    np.testing.assert_allclose(
        uncertainty.covariance(FABRIC, keys), expected[np.ix_([2, 0, 1], [2, 0, 1])]
    )
    assert Uncertainty.read(uncertainty.table()) == uncertainty
    assert Uncertainty.read(None) is None


def test_a_correlation_of_a_pair_is_that_of_both_numbers():
    table = TABLE | {"correlation": [["shear_stiffness", "tensile_stiffness", 0.5]]}
    fabric = dataclasses.replace(FABRIC, uncertainty=table)
    first = fabric.uncertainty.covariance(fabric)[2]
    np.testing.assert_allclose(first, [0.5 * 12 * 3, 0.5 * 9 * 3, 9.0, 0.0])


def test_an_uncertainty_changes_no_fabric():
    plain = dataclasses.replace(FABRIC, uncertainty=None)
    assert (plain, hash(plain)) == (FABRIC, hash(FABRIC))


@pytest.mark.parametrize("rho", [0.4, 0.5 + 2e-7, 0.5 + 2e-6, 0.8])
def test_correlations_that_contradict_each_other_are_refused(rho):
    """Three keys, correlated by ρ, ρ and −ρ: the least eigenvalue is 1 − 2ρ.

    One of −4e-7 comes from rounded correlations, and one of −4e-6 does not.
    """
    a, b, c = "tensile_stiffness.0", "tensile_stiffness.1", "shear_stiffness"
    table = TABLE | {"correlation": [[a, b, rho], [a, c, rho], [b, c, -rho]]}
    fabric = dataclasses.replace(FABRIC, uncertainty=table)
    if 1 - 2 * rho > -1e-6:
        assert fabric.uncertainty.covariance(fabric)[0, 1] == pytest.approx(rho * 12 * 9)
        return
    with pytest.raises(InputError, match="least eigenvalue of its matrix is -"):
        fabric.uncertainty.covariance(fabric)


# --- files and scenes -----------------------------------------------------------------------------


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "fitted.toml").write_text(FILE, encoding="utf-8")
    return tmp_path


def read(folder, fabric, *overrides):
    (folder / "scene.toml").write_text(fabric + REST, encoding="utf-8")
    return load_scene(folder / "scene.toml", overrides)


def test_a_fabric_in_a_file(folder):
    fabric = fc.Fabric.read(folder / "fitted.toml")
    assert fabric == fc.Fabric(0.2, (1000.0, 900.0), shear_stiffness=60.0)
    kept = {k: STANDARD[k] for k in list(STANDARD)[:3]}
    assert fabric.uncertainty.standard(fabric) == pytest.approx(kept)
    scene = read(folder, '[fabric]\nfile = "fitted.toml"\n')
    assert scene.fabric.make() == fabric
    assert scene.fabric.make().uncertainty == fabric.uncertainty
    assert scene_of(tomllib.loads(scene.to_toml())) == scene


def test_keys_beside_a_file_replace_its_own(folder):
    """A constant that is replaced loses its uncertainty and its correlations."""
    own = '[fabric]\nfile = "fitted.toml"\nshear_stiffness = 70.0\n'
    fabric = read(folder, own).fabric.make()
    assert (fabric.shear, fabric.tensile) == (70.0, (1000.0, 900.0))
    assert fabric.uncertainty.standard(fabric) == {
        "tensile_stiffness.0": 12.0,
        "tensile_stiffness.1": 9.0,
    }
    assert fabric.uncertainty.correlation == ()
    changed = read(
        folder, '[fabric]\nfile = "fitted.toml"\nuncertainty = { tensile_stiffness = [1.0, 2.0] }\n'
    ).fabric.make()
    assert list(changed.uncertainty.standard(changed).values()) == pytest.approx([1.0, 2.0, 3.0])
    word = read(folder, 'fabric = "cotton"\n', "fabric.uncertainty.shear_stiffness=3")
    assert word.fabric.make().uncertainty.standard(word.fabric.make())["shear_stiffness"] == 3.0


@pytest.mark.parametrize("table", ["fabric", "fabrics.a"])
def test_studies_take_uncertainties_for_no_numbers_and_for_no_other_case(folder, table):
    constants = FILE.partition("[fabric.")[0].partition("\n")[2]
    text = f"[{table}]\n{constants}{REST}".replace('"left"', '"boundary"')
    if table == "fabrics.a":
        piece = REST.partition("[[terms")[0].replace("[cloth]", "[cloths.b]")
        text = text.replace("[cloth]", "[cloths.a]").replace('"b', '"a/b')
        text += f'{piece}[fabrics]\nb = "silk"\n'
    problems = []
    for more in ("", f'[{table}.uncertainty]\nshear_stiffness = "5 %"\n'):
        (folder / "scene.toml").write_text(text + more, encoding="utf-8")
        problems.append(StudyProblem.of(load_scene(folder / "scene.toml")))
    assert problems[0].case() == problems[1].case()
    assert problems[1].tables != problems[0].tables
    a, b = (choose_parameters(problem, None, {}) for problem in problems)
    assert a == b


# --- presets --------------------------------------------------------------------------------------


def test_presets_carry_the_spread_that_their_sources_show():
    """By hand: the knits' G = c33, the two denims, and the two thicknesses of cotton."""
    knit, denim, cotton = map(fc.Fabric.preset, ("interlock", "denim-wang", "cotton"))
    logs = np.log([36.860302, 83.175644, 31.896357])
    deviations = dict(knit.uncertainty.deviations)
    assert deviations["shear_stiffness"] == f"{100 * np.std(logs, ddof=1):.0f} %"
    ratios = [-14.695990 / 16.593832, -0.234556 / 42.871021, -12.802702 / 31.146198]
    assert deviations["poisson_ratio"] == round(np.std(ratios, ddof=1), 2)
    G = 53.387184, 2.448 * 1e3 * 0.66 / 2  # MPa mm is N/mm; G = G₁₂ h/2
    both = dict(denim.uncertainty.deviations)
    assert both["shear_stiffness"] == f"{100 * math.log(G[1] / G[0]) / math.sqrt(2):.0f} %"
    part = (0.253 - 0.18) / math.sqrt(2) / 0.18
    standard = cotton.uncertainty.standard(cotton)
    assert standard["shear_stiffness"] == pytest.approx(part * cotton.shear, rel=0.02)
    covariance = cotton.uncertainty.covariance(cotton, ["tensile_stiffness.0", "shear_stiffness"])
    assert covariance[0, 1] ** 2 == pytest.approx(covariance[0, 0] * covariance[1, 1])
    assert "0.18 and 0.253 mm" in cotton.uncertainty.source


@pytest.mark.parametrize("name", fc.Fabric.presets())
def test_every_number_of_a_preset_but_its_density_has_an_uncertainty(name):
    fabric = fc.Fabric.preset(name)
    stated = {each.partition(".")[0] for each in fabric.uncertainty.standard(fabric)}
    numbers = {"tensile_stiffness", "poisson_ratio", "shear_stiffness"}
    assert stated == numbers | ({"bending_rigidity", "bias_rigidity"} if fabric.bending else set())
    assert np.linalg.eigvalsh(fabric.uncertainty.covariance(fabric))[0] > -1e-6
    assert "spread of" in fabric.uncertainty.source
    assert name in (files("fecloth.fabric") / "fabrics.toml").read_text(encoding="utf-8")
