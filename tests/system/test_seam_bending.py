"""What a seam does across its edges: a hinge, a spring, or the plate that goes on."""

from dataclasses import replace

import numpy as np
import pytest
from support.sewn_strips import SEAM, halves, in_order, whole_and_cut

import fecloth as fc
from fecloth import verify

FABRIC = fc.Fabric(0.2, 1000.0, poisson_ratio=0.3, bending_rigidity=(1e-2, 2e-2))


@pytest.mark.filterwarnings("ignore::fecloth.FeclothWarning")
@pytest.mark.parametrize("element", ["P1", "P2"])
@pytest.mark.parametrize("bending", [fc.PlateBending(), fc.HingeBending()], ids=["plate", "hinge"])
def test_the_plate_goes_on_across_a_seam_of_cloth(element, bending):
    """The pieces lie 0.3 m apart on the flat cloth."""
    if element == "P2" and isinstance(bending, fc.HingeBending):
        pytest.skip("HingeBending is for P1")
    whole, cut = whole_and_cut(element, "cross", apart=0.3)
    terms = [fc.StVK(), bending, fc.Gravity((0, 0, -9.81))]
    ends = []
    for cloth, pin, seams in (
        (whole, "left", ()),
        (cut, "a/left", [replace(SEAM, stiffness="cloth")]),
    ):
        system = fc.System(cloth, FABRIC, terms, pins=[fc.Pin(pin)], seams=seams)
        place = cloth.X - np.where(cloth.X[:, :1] > 0.6, 0.3, 0.0) * (1, 0) if seams else cloth.X
        x = np.column_stack([place, 0.05 * np.sin(3 * place[:, 0])])
        start = system.state(system.constraints.followers.follow(x))
        result = fc.run(
            system, fc.BDF2(), start, dt=1e-3, t_end=5e-3, newton=fc.Newton(tolerance=1e-12)
        )
        nodes = in_order(system, place)
        ends.append((result.state.x[nodes], system.energies(start)[type(bending).__name__]))
    (x, energy), (x_sewn, energy_sewn) = ends
    assert energy_sewn == pytest.approx(energy, rel=1e-12)
    np.testing.assert_allclose(x_sewn, x, rtol=0, atol=1e-10)


@pytest.mark.parametrize("h", [(0.125, 0.125), (0.125, 0.07)], ids=["matching", "not matching"])
@pytest.mark.parametrize("element", ["P1", "P2"])
def test_the_energy_of_a_folded_seam_is_its_closed_form(element, h):
    """½ k l (θ − θ₀)² of two flat halves at the angle θ."""
    cloth = halves(h, element=element, pattern="right")
    for seam in (
        replace(SEAM, stiffness=3.0, angle=0.2),
        fc.Seam("b.left", "a.right", stiffness=3.0, angle=0.2),
    ):
        system = fc.System(cloth, FABRIC, [fc.StVK()], seams=[seam])
        fold = 0.7
        X, Y = cloth.X.T
        beyond = np.maximum(X - 0.5, 0.0)
        x = np.column_stack([np.minimum(X, 0.5) + beyond * np.cos(fold), Y, beyond * np.sin(fold)])
        energies = system.energies(system.state(x))
        assert energies["SeamBending"] == pytest.approx(0.5 * 3.0 * 0.25 * 0.5**2, rel=1e-12)
        assert energies["StVK"] == pytest.approx(0.0, abs=1e-18)


def test_the_error_in_space_is_that_of_the_cloth_beside_the_seam():
    """The spring is no strain: at equal positions the estimate is the one with a hinge."""
    cloth = halves((0.0625, 0.05), pattern="right")
    seam = replace(SEAM, stiffness=0.02)
    terms = [fc.StVK(), fc.PlateBending(), fc.Gravity((0, 0, -0.5))]
    pins = [fc.Pin("a/left", clamp=True)]
    system = fc.System(cloth, FABRIC, terms, pins, seams=[seam])
    rest = fc.equilibrium(system, system.rest())
    estimate = fc.space_error(system, rest).relative
    hinge = system.replace(terms=terms, seams=[replace(seam, stiffness=0.0)])
    assert 0.01 < estimate < 0.3
    assert estimate == fc.space_error(hinge, rest).relative
    assert rest.space_error == pytest.approx(estimate)


@pytest.mark.parametrize("element", ["P1", "P2"])
def test_seam_bending_passes_the_slope_test(element):
    cloth = halves((0.125, 0.08), element=element)
    seam = replace(SEAM, stiffness=3.0, angle=0.2)
    random = np.random.default_rng(1)
    X, Y = cloth.X.T
    x = np.column_stack([X, Y, 0.3 * np.maximum(X - 0.5, 0.0)])
    x += 0.01 * random.standard_normal(x.shape)
    states = [("folded", x, random.standard_normal(x.shape))]
    verify.check_term(seam.bending(cloth), cloth, FABRIC, states=states)
