"""Derivatives along a path on which the threads of a fabric slide."""

import pytest

import fecloth as fc
from fecloth.simulation.load_steps import LoadSteps

pytestmark = pytest.mark.stories

LAID, FALLS = LoadSteps(20), fc.BDF2()


def strip(method, hysteresis=6e-4, rigidity=2e-5):
    cloth = fc.Cloth.rectangle(0.2, 0.05, h=0.05, pattern="right")
    fabric = fc.Fabric(0.05, 200.0, bending_rigidity=rigidity, bending_hysteresis=hysteresis)
    terms = [fc.StVK(), fc.PlateBending(), fc.BendingFriction(), fc.Gravity()]
    system = fc.System(cloth, fabric, terms, [fc.Pin("left", clamp=True)])
    return cloth, system, method, system.rest()


@pytest.mark.parametrize(
    ("method", "times"),
    [
        pytest.param(LAID, {"t_end": 1.0}, id="laid"),
        pytest.param(None, {}, id="at rest"),
        pytest.param(FALLS, {"dt": 4e-3, "t_end": 0.1}, id="falls", marks=pytest.mark.stories),
    ],
)
def test_the_place_depends_on_the_hysteresis_as_twin_runs_say(method, times):
    def problem(hysteresis=6e-4, rigidity=2e-5):
        return strip(method, hysteresis, rigidity)

    start = {"hysteresis": 6e-4, "rigidity": 2e-5}
    probes = [fc.Probe("tip", "right")]
    answer = fc.sensitivity(problem, start, "tip.z", probes=probes, **times)
    assert answer.checked < 1e-4
    assert abs(answer.elasticity).min() > 1e-3
