"""Runs give the same bits on any number of threads, and say how many they used.

Here on one and three; that terms do on two, too, is in tests/terms/test_terms_on_threads.py.
"""

import json

import numpy as np
import pytest
from support.tiers import stories_except

import fecloth as fc
from fecloth.cli.main import main

pytestmark = pytest.mark.filterwarnings("ignore::fecloth.errors.FeclothWarning")
FABRIC = fc.Fabric(0.2, 1000.0, 0.3, bending_rigidity=1e-5)
ELASTIC = fc.StVK(), fc.PlateBending(), fc.Gravity()
DAMPED = fc.StVK(), fc.HingeBending(), fc.StrainRateDamping(1e-4), fc.MassDamping(0.2), fc.Gravity()
AIR = fc.StVK(), fc.BendingDamping(1e-5), fc.Wind((2.0, 1.0, 3.0), 0.3, 0.1), fc.Springs()
PULLED = fc.Pin("left", motion=("0.1*t", "0", "0"))
CASES = {  # the method, its terms, solver and pin
    "explicit, elastic": (fc.CentralDifference(), ELASTIC, "auto", "left"),
    "explicit, damped": (fc.CentralDifference(), DAMPED, "auto", "left"),
    "explicit, air": (fc.CentralDifference(), AIR, "auto", PULLED),
    "explicit, pressure": (fc.CentralDifference(), (*ELASTIC, fc.Pressure(2.0)), "auto", "left"),
    "backward Euler": (fc.BackwardEuler(), ELASTIC, "pcg", "left"),
    "BDF2, damped": (fc.BDF2(), DAMPED, "auto", "left"),
    "generalised-α": (fc.GeneralizedAlpha(0.8), ELASTIC, "multigrid", "left"),
    "energy–momentum, air": (fc.EnergyMomentum(), AIR, "direct", "left"),
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


@pytest.mark.parametrize(
    "name", stories_except(CASES, "explicit, damped", "backward Euler", "generalised-α")
)
def test_runs_have_the_same_bits(cloth, name):
    """Three implicit steps, or 70 explicit ones, of which 14 have a row: the others are fused."""
    method, terms, solver, pin = CASES[name]
    steps = (2e-5, 1.4e-3) if method.traits.explicit else (2e-3, 6e-3)
    results = []
    for threads in (1, 3):
        system = fc.System(cloth, FABRIC, terms, [pin], threads=threads)
        results.append(fc.run(system, method, system.rest(), *steps, solver=solver, rows=5))
        assert system.team.used == threads
    assert (len(results[0].times) < 40) or not method.traits.explicit
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
