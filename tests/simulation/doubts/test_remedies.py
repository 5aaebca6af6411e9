"""A remedy names an element, a method or a term only if the cloth and its terms accept it."""

import re
from types import SimpleNamespace

import pytest
from support.planned import warnings_before

import fecloth as fc
from fecloth.simulation.doubts import course, terms
from fecloth.simulation.doubts.accepted import accepts_element, accepts_method, accepts_term
from fecloth.simulation.error_in_space import LOCKED, remedy_of_locking
from fecloth.simulation.shapes import doubt_intersections

FABRICS = {
    "soft": fc.Fabric(0.2, 1000.0),
    "bent": fc.Fabric(0.2, 1000.0, bending_rigidity=1e-5),
    "woven": fc.Fabric(0.2, (2000.0, 900.0), 0.2, 60.0, bending_rigidity=1e-5),
}
LOADS = {
    "none": (),
    "wind": (fc.Wind((1.0, 0.0, 0.0), 0.7),),
    "floor": (fc.Obstacle(fc.shapes.Plane((0.0, 0.0, -1.0), (0.0, 0.0, 1.0))),),
}


def make(fabric="bent", load="none", element="P1", more=()):
    cloth = fc.Cloth.rectangle(0.4, 0.2, h=0.1, pattern="right", element=element)
    return fc.System(cloth, FABRICS[fabric], [*(more or [fc.StVK()]), *LOADS[load]], ["left"])


def is_made(**options):
    try:
        make(**options)
    except fc.InputError:
        return False
    return True


@pytest.mark.parametrize("load", LOADS)
@pytest.mark.parametrize("fabric", FABRICS)
def test_a_choice_is_accepted_if_the_system_can_be_made_with_it(fabric, load):
    system = make(fabric, load)
    assert accepts_element(system, "P2") == is_made(fabric=fabric, load=load, element="P2")
    for term in (fc.PlateBending(), fc.TensionField(), fc.Springs(kind="biquadratic")):
        assert accepts_term(system, term) == is_made(fabric=fabric, more=(term,))
    for method in (fc.BDF2(), fc.GeneralizedAlpha(), fc.CentralDifference()):
        runs = True
        try:
            next(fc.march(system, method, system.rest(), dt=1e-6, t_end=1e-5))
        except fc.InputError:
            runs = False
        assert accepts_method(system, method) == runs


@pytest.mark.parametrize(("load", "element"), [("none", "P2"), ("wind", None)])
def test_p2_is_named_where_every_term_knows_it(load, element):
    system = make(load=load, more=(fc.StVK(), fc.PlateBending()))
    words = remedy_of_locking(system, 1.25 * LOCKED)
    assert ("P2" in words) == (element == "P2")
    assert words.endswith("a smaller h")


@pytest.mark.parametrize("fabric", FABRICS)
def test_a_term_against_wrinkles_is_named_if_the_fabric_has_its_constants(fabric):
    remedy = course.doubt_wrinkles(make(fabric), 0.5, 0.9, 0.1, 1.0).remedy
    assert ("TensionField" in remedy) == (fabric != "woven")
    assert ("bending_rigidity" in remedy) == (fabric == "soft")


def test_a_second_order_method_is_named_if_it_takes_the_contact():
    def tell(load):
        system = make(load=load, more=(fc.StVK(), fc.Gravity()))
        (words,) = warnings_before(
            system, 0.05, method=fc.BackwardEuler(), doubts=[course.find_numerical_damping]
        )
        return re.findall("BDF2|GeneralizedAlpha", words)

    assert tell("none") == ["BDF2", "GeneralizedAlpha"]
    assert tell("floor") == ["BDF2"]


def test_a_net_is_biquadratic_on_an_isotropic_fabric_only():
    for fabric, named in (("soft", True), ("woven", False)):
        system = make(fabric, more=(fc.Springs(stiffness=1.0),))
        (words,) = warnings_before(system, 0.01, doubts=[terms.find_springs_of_another_fabric])
        assert ("biquadratic" in words) == named


@pytest.mark.parametrize(
    ("method", "named"),
    [(fc.BDF2(), False), (fc.Auto(), False), (fc.GeneralizedAlpha(), True)],
)
def test_self_contact_is_named_with_a_method_that_takes_it(method, named):
    doubt = doubt_intersections(SimpleNamespace(method=method), 0.5, 3.0)
    assert ("BDF2" in doubt.remedy) == named
