"""The warning of wrinkles as fine as the mesh: each remedy that it names takes it away."""

import numpy as np
import pytest

import fecloth as fc
from fecloth.simulation.doubts.doubt import DoubtKind

PLATE = (fc.StVK(), fc.PlateBending())


def wrinkles(h, terms):
    """The warnings of wrinkles of a sheet whose ends come nearer by 7 %."""
    cloth = fc.Cloth.rectangle(0.4, 0.2, h=h, pattern="right")
    pins = [fc.Pin("left"), fc.Pin("right", ("-0.03 * smoothstep(0, 0.2, t)", "0", "0"))]
    damping = fc.StrainRateDamping(time=0.005), fc.MassDamping(rate=5.0)
    fabric = fc.Fabric(0.2, 200.0, 0.3, bending_rigidity=1e-3)
    system = fc.System(cloth, fabric, [*terms, *damping], pins)
    X, Y = cloth.X.T
    z = 2e-3 * np.sin(np.pi * X / 0.4) ** 2 * (1 + np.sin(9 * Y))
    start = system.state(np.column_stack([X, Y, z]))
    result = fc.run(system, fc.BackwardEuler(), start, 0.01, 0.3)
    return [str(doubt) for doubt in result.doubts if doubt.kind is DoubtKind.WRINKLES]


@pytest.mark.filterwarnings("ignore::fecloth.errors.FeclothWarning")
@pytest.mark.parametrize(
    ("h", "terms", "remedy", "by"),
    [
        (0.1, PLATE, "take h below half of the present one", (0.045, PLATE)),
        (0.05, [fc.StVK()], "add PlateBending", (0.05, PLATE)),
        (0.05, [fc.StVK()], "use TensionField", (0.05, [fc.TensionField()])),
    ],
)
def test_each_remedy_takes_the_warning_away(h, terms, remedy, by):
    (words,) = wrinkles(h, terms)
    assert remedy in words
    assert wrinkles(*by) == []
