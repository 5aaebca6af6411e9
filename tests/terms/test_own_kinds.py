"""A user's membrane, bending term, damping and load are served as what their traits say."""

from dataclasses import dataclass

import pytest
from support.local_link import LocalLink
from support.own_terms import OWN, Breeze, Ribs, Rubber, Syrup
from support.planned import warnings_before

import fecloth as fc
from fecloth.distributed.distributed_system import DistributedSystem
from fecloth.scene.plan import plan
from fecloth.scene.scene import load_scene
from fecloth.simulation.setup import Setup
from fecloth.study.orders import find_obstacles
from fecloth.study.problem import StudyProblem

FABRIC = fc.Fabric(0.2, 1000.0, bending_rigidity=1e-5)
TERMS = (Rubber(), Ribs(), Syrup(), Breeze())
SCENE = """
cloth = { shape = "rectangle", width = 1.0, height = 0.5, h = 0.25, pattern = "right" }
fabric = { areal_density = 0.2, tensile_stiffness = 1000.0, bending_rigidity = 1e-5 }
terms = [
  { type = "Rubber", k = 800.0 }, { type = "Ribs" }, { type = "Syrup", rate = 2.0 },
  { type = "Breeze" }, { type = "Gravity" },
]
pins = [{ where = "left" }]
time = { method = "bdf2", dt = 0.01, t_end = 0.5 }
"""


def strip(h, dt=0.01, terms=TERMS, pins=("left",)):
    cloth = fc.Cloth.rectangle(1.0, 0.5, h, pattern="right")
    system = fc.System(cloth, FABRIC, [*terms, fc.Gravity()], pins=list(pins))
    return cloth, system, fc.BackwardEuler(), system.rest()


@pytest.fixture
def scene(tmp_path):
    path = tmp_path / "own.toml"
    path.write_text(SCENE)
    return load_scene(path, terms=OWN)


# --- check and info: the warnings and lines before a run ------------------------------------------


def warned(*terms):
    _, system, _, start = strip(0.25, terms=terms)
    return " ".join(warnings_before(system, 0.01, state=start))


def test_a_membrane_of_its_own_is_one():
    assert "no membrane" not in warned(*TERMS)
    assert "2 membranes act at once (Rubber, StVK)" in warned(*TERMS, fc.StVK())
    assert "Rubber stands 2 times" in warned(Rubber(1.0), Rubber(2.0))


def test_bending_of_its_own_is_bending():
    assert "2 bending terms act at once (Ribs, PlateBending)" in warned(*TERMS, fc.PlateBending())
    assert "2 dampings" not in warned(*TERMS, fc.MassDamping(1.0))  # which is not exclusive
    _, system, _, start = strip(0.25)
    said = " ".join(find_obstacles(Setup(system, start, None, None, 0.01, 1.0), {}, start.x))
    assert "without bending" not in said
    assert "pattern of the mesh" in said


def test_a_load_of_its_own_may_act_twice():
    assert "Breeze" not in warned(*TERMS, Breeze(1.0))
    assert "Breeze stands 2 times" in warned(*TERMS, Breeze())
    _, system, *_ = strip(0.25)
    x = fc.equilibrium(system, system.rest(), load_steps=2).x  # it grows with the loads
    assert x[-1, 1] > system.rest().x[-1, 1]


def test_the_error_in_space_has_the_reason_of_the_traits():
    _, system, _, start = strip(0.25)
    assert "Ribs is as stiff as its ribs" in fc.space_error(system, start).reason


def test_info_of_a_scene_counts_its_bending(scene):
    problem = scene.build()
    lines = "\n".join(plan(problem, "direct"))
    assert "terms: Rubber, Ribs, Syrup, Breeze, Gravity" in lines
    assert "ρ g L³/B" in lines or "bending stiffness" in lines
    assert "no membrane" not in " ".join(map(str, problem.doubts()))


# --- chart, simplify and tune ---------------------------------------------------------------------


def test_chart_replaces_a_membrane_of_its_own(scene):
    values = StudyProblem.of(scene).source.values_of({"method": "newmark", "model": "StVK"})
    types = [term["type"] for term in values["terms"]]
    assert types == ["StVK", *list(OWN)[1:], "Gravity"]


# --- several processes ----------------------------------------------------------------------------


@dataclass(frozen=True)
class Unshared(Ribs):
    """Bending that says nothing of several processes."""

    traits = fc.TermTraits(kind="bending")


def test_a_term_that_does_not_say_so_is_not_shared():
    cloth = fc.Cloth.rectangle(6.0, 0.25, 0.1)
    with pytest.raises(fc.InputError, match="Unshared: cannot be shared among processes yet"):
        DistributedSystem(cloth, FABRIC, [fc.StVK(), Unshared()], link=LocalLink(2))
