"""`simplify` says where the friction inside the fabric may be left out."""

import pytest
from support.plates import rolled, square

import fecloth as fc
from fecloth.study.simplification_result import describe_weak_friction

B = 2e-5


BOTH = (fc.PlateBending(), fc.BendingFriction())


def said(part, pair=False, terms=BOTH):
    """Of a strip that is bent to a curvature of 5/m, with HB/B as a part of that."""
    hysteresis = 2 * B * 5.0 * part
    given = (hysteresis / 3, hysteresis) if pair else hysteresis
    fabric = fc.Fabric(0.1, 1.0, bending_rigidity=B, bending_hysteresis=given)
    cloth = square("right", 16)
    system = fc.System(cloth, fabric, terms)
    energies = system.energies(system.state(rolled(cloth.X, 0.2)))
    ends = {name: [0.0, value] for name, value in energies.items()}
    return describe_weak_friction(system, ends)


@pytest.mark.parametrize("pair", [False, True])
def test_friction_may_be_left_out_below_a_tenth_of_the_curvature(pair):
    assert said(0.125, pair) == ""
    words = said(0.08, pair)
    assert "may be left out: HB/B = 0.4/m" in words
    assert float(words.split()[-1].removesuffix("/m")) == pytest.approx(5.0, rel=0.07)


def test_of_a_scene_without_friction_or_without_bending_nothing_is_said():
    assert said(0.08, terms=(fc.PlateBending(),)) == ""
    assert said(0.08, terms=(fc.BendingFriction(),)) == ""
