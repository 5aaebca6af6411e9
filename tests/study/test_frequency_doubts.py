"""`converge` of a frequency says where the state about which it is taken is no equilibrium."""

import pytest

import fecloth as fc
from fecloth.simulation.doubts.doubt import DoubtKind


def drum(h, gravity=0.0):
    cloth = fc.Cloth.rectangle(1.0, 1.0, h, pattern="right")
    terms = [fc.StVK(), fc.Gravity((0, 0, -gravity))] if gravity else [fc.StVK()]
    system = fc.System(cloth, fc.Fabric(0.2, 100.0, 0.3), terms, ["boundary"])
    return cloth, system, fc.BDF2(), system.state(1.1 * system.rest().x)


@pytest.mark.parametrize(("gravity", "doubted"), [(0.0, False), (9.81, True)])
def test_a_frequency_about_no_equilibrium_has_one_warning(gravity, doubted):
    """The drum is taut in its plane; its weight would bend it out of the plane."""
    given = {"gravity": gravity, "dt": 0.1, "t_end": 1.0}
    result = fc.study.converge(drum, "frequency(1)", levels=3, h=0.5, **given)
    kinds = [doubt.kind for doubt in result.doubts if doubt.kind.spoils]
    assert kinds == [DoubtKind.BALANCE] * doubted
    assert sum("not in equilibrium" in words for words in result.words()) == doubted
