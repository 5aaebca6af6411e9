"""The assembled operators: sums over terms, masses, and what does not change."""

import numpy as np
import pytest
import skfem
from conftest import affine, rough

import fecloth as fc
from fecloth.linalg.block_matrix import BlockMatrix

MASSES = ["lumped", "consistent"]
TERMS = [fc.Gravity((1, 0, 0)), fc.StVK(), fc.StrainRateDamping(0.01), fc.Gravity((0, 0, -9.81))]


@pytest.fixture(params=MASSES)
def system(request, sheet, orthotropic):
    return fc.System(sheet, orthotropic, TERMS, pins=["left"], mass=request.param)


@pytest.fixture
def state(system, rng):
    return system.state(rough(system.cloth, rng), rng.standard_normal((len(system.cloth.X), 3)))


def test_terms_that_stand_twice_are_numbered(system, state):
    assert system.names == ("Gravity.1", "StVK", "StrainRateDamping", "Gravity.2")
    energies = system.energies(state)
    assert list(energies) == ["kinetic", "Gravity.1", "StVK", "Gravity.2"]  # damping has none
    for name, term in zip(system.names, TERMS, strict=True):
        if name in energies:
            alone = system.replace(terms=[term]).energies(state)
            assert energies[name] == alone[type(term).__name__]
    assert energies["Gravity.1"] != energies["Gravity.2"]


def test_force_is_the_sum_over_terms(system, state):
    """Pins do not enter it."""
    alone = [system.replace(terms=[term]).force(state) for term in TERMS]
    force = system.force(state)
    assert force.shape == (len(system.cloth.X), 3)
    np.testing.assert_allclose(force, sum(alone), atol=1e-13 * abs(force).max())
    assert all(abs(f[system.constraints.nodes]).max() > 0 for f in alone)


def test_assembled_matrix_is_the_weighted_sum(system, state):
    J = BlockMatrix.zeros(system.pattern)
    J.values[:] = 7.0  # `assemble` starts from zero
    got = system.assemble(J, state, wx=0.3, wv=0.02, wa=5.0).to_scipy()
    K, D, M = system.stiffness(state), system.damping(state), system.mass
    expected = 0.3 * K + 0.02 * D + 5.0 * M
    assert abs(got - expected).max() < 1e-13 * abs(expected).max()
    again = system.add_tangents(J, state, wa=2.0).to_scipy()
    assert abs(again - got - 2.0 * M).max() < 1e-13 * abs(expected).max()


def test_mass_meets_scikit_fem(sheet, orthotropic):
    """∫ ρ u·v dA in the vector space of scikit-fem; the lumped mass has its row sums."""
    basis = skfem.Basis(sheet.mesh, skfem.ElementVector(skfem.ElementTriP1(), dim=3), intorder=2)
    density = orthotropic.areal_density
    form = skfem.BilinearForm(lambda u, v, w: density * (u * v).sum(axis=0))
    expected = form.assemble(basis)
    consistent = fc.System(sheet, orthotropic, [], mass="consistent")
    lumped = fc.System(sheet, orthotropic, [fc.StVK()])
    assert abs(consistent.mass - expected).max() < 1e-17
    J = BlockMatrix.zeros(consistent.pattern)  # Newton's matrix has room for it without a term
    assembled = consistent.assemble(J, consistent.rest(), wa=2.0).to_scipy()
    assert abs(assembled - 2 * expected).max() < 1e-17
    rows = np.asarray(expected.sum(axis=1)).ravel()
    np.testing.assert_allclose(lumped.mass.toarray(), np.diag(rows), atol=1e-17)
    np.testing.assert_allclose(np.repeat(lumped.nodal_mass, 3), rows, rtol=1e-12)
    np.testing.assert_allclose(np.repeat(consistent.nodal_mass, 3), rows, rtol=1e-12)


@pytest.mark.parametrize("mass", [None, "lumped", "consistent"])
def test_a_system_can_be_copied_with_a_change(mass):
    cloth = fc.Cloth.rectangle(1.0, 0.5, h=0.25, pattern="right")
    fabric = fc.Fabric(0.2, (1000.0, 300.0), 0.1, shear_stiffness=50.0)
    arguments = cloth, fabric, [fc.StVK(), fc.Gravity()], ["left"]
    turned = fc.System(*arguments, mass=mass).replace(grain=0.1)
    expected = fc.System(*arguments, mass=mass, grain=0.1)
    state = expected.state(1.1 * expected.rest().x)
    np.testing.assert_array_equal(turned.force(state), expected.force(state))
    assert (turned.mass_kind, turned.grain) == (expected.mass_kind, 0.1)
    assert turned.replace(mass="consistent").mass_kind == "consistent"
    assert turned.replace(terms=[fc.StVK()]).names == ("StVK",)


def test_the_arguments_of_a_system_do_not_change():
    cloth = fc.Cloth.rectangle(1.0, 0.5, h=0.25, pattern="right")
    system = fc.System(cloth, fc.Fabric(0.2, 1000.0), [fc.StVK()], ["left"])
    for name in ("cloth", "fabric", "terms", "pins", "mass_kind", "grain", "start", "threads"):
        with pytest.raises(AttributeError, match=name):
            setattr(system, name, None)


def test_kinetic_energy_of_a_turning_sheet(sheet, orthotropic):
    """½ ρ ω² ∫ |X|² dA = ½ ρ ω² (w³h + wh³)/3 about a corner, exact for the consistent mass."""
    x = affine(sheet, np.eye(3)[:, :2])
    energy = {}
    for mass in MASSES:
        system = fc.System(sheet, orthotropic, [], mass=mass)
        state = system.state(x, np.cross([0, 0, 4.0], x))
        energy[mass] = system.energies(state)["kinetic"]
    exact = 0.5 * 0.15 * 16 * (0.6 + 0.6**3) / 3
    assert energy["consistent"] == pytest.approx(exact, rel=1e-12)
    assert energy["lumped"] == pytest.approx(exact, rel=0.02)
    assert energy["lumped"] > exact * (1 + 1e-4)
