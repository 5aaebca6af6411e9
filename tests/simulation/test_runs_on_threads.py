"""Runs give the same bits on any number of threads, and say how many they used.

Here on one and three; that terms do on two, too, is in tests/terms/test_terms_on_threads.py.
"""

import json

import numpy as np
import pytest

import fecloth as fc
from fecloth.cli.main import main

pytestmark = pytest.mark.filterwarnings("ignore::fecloth.errors.FeclothWarning")
FABRIC = fc.Fabric(0.2, 1000.0, 0.3, bending_rigidity=1e-5)
ELASTIC = fc.StVK(), fc.PlateBending(), fc.Gravity()
DAMPED = fc.StVK(), fc.HingeBending(), fc.StrainRateDamping(1e-4), fc.MassDamping(0.2), fc.Gravity()
AIR = fc.StVK(), fc.BendingDamping(1e-5), fc.Wind((2.0, 1.0, 3.0), 0.3, 0.1), fc.Springs()
EXPLICIT = {
    "elastic": ELASTIC,
    "damped": DAMPED,
    "air": AIR,
    "pressure": (*ELASTIC, fc.Pressure(2.0)),
}
IMPLICIT = {
    "backward Euler, pcg": (fc.BackwardEuler(), ELASTIC, "pcg"),
    "BDF2, damped, auto": (fc.BDF2(), DAMPED, "auto"),
    "generalised-α, multigrid": (fc.GeneralizedAlpha(0.8), ELASTIC, "multigrid"),
    "energy–momentum, air": (fc.EnergyMomentum(), AIR, "direct"),
}


@pytest.fixture(scope="module")
def cloth():
    """A cloth above the size at which threads share loops."""
    return fc.Cloth.rectangle(1.0, 0.8, h=0.03, pattern="unstructured")


def same(item, other):
    """Whether two results have the same states and the same ledger, to the last bit."""
    states = all(np.array_equal(getattr(item.state, k), getattr(other.state, k)) for k in "xv")
    ledgers = [{k: np.asarray(v) for k, v in each.energies.items()} for each in (item, other)]
    return states and all(np.array_equal(ledgers[0][k], ledgers[1][k]) for k in ledgers[0])


@pytest.mark.stories
@pytest.mark.parametrize("name", EXPLICIT)
def test_explicit_runs_have_the_same_bits(cloth, name):
    results = []
    for threads in (1, 3):
        pins = [fc.Pin("left", motion=("0.1*t", "0", "0")) if name == "air" else "left"]
        system = fc.System(cloth, FABRIC, EXPLICIT[name], pins, threads=threads)
        run = system, fc.CentralDifference(), system.rest(), 2e-5, 1.4e-3
        results.append(fc.run(*run, rows=5))
        assert system.team.used == threads
    assert len(results[0].times) < 40  # of 70 steps, which are fused
    assert same(*results)


@pytest.mark.parametrize("name", IMPLICIT)
def test_implicit_runs_have_the_same_bits(cloth, name):
    method, terms, solver = IMPLICIT[name]
    results = []
    for threads in (1, 3):
        system = fc.System(cloth, FABRIC, terms, ["left"], threads=threads)
        results.append(fc.run(system, method, system.rest(), 2e-3, 6e-3, solver=solver))
    assert same(*results)


SCENE = """
cloth = { shape = "rectangle", width = 1.0, height = 0.8, h = 0.03 }
fabric = { areal_density = 0.2, tensile_stiffness = 1000.0 }
terms = [{ type = "StVK" }, { type = "Gravity" }]
pins = [{ where = "left" }]
time = { method = "backward_euler", dt = 0.002, t_end = 0.004 }
"""


@pytest.mark.parametrize(
    ("scene", "option", "expected"),
    [("", ["--threads", "2"], 2), ("[solver]\nthreads = 3", [], 3), ("", ["--threads", "1"], 1)],
)
def test_a_scene_and_the_command_line_set_the_threads(tmp_path, capsys, scene, option, expected):
    (tmp_path / "a.toml").write_text(SCENE + scene)
    assert main(["run", str(tmp_path / "a.toml"), "-o", str(tmp_path / "out"), *option]) == 0
    assert json.loads((tmp_path / "out/summary.json").read_text())["threads"] == expected
    printed = " ".join(capsys.readouterr().out.split())
    assert (f"on {expected} threads" in printed) == (expected > 1)
