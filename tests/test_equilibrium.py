"""Static equilibrium: closed forms, quadratic convergence, and what has none is reported."""

from itertools import pairwise

import numpy as np
import pytest
from conftest import flat
from references import hanging_strip, hanging_strip_mean
from test_pressure import enclosed, shooting

import fecloth as fc
from fecloth.verify import observed_order

DOWN = fc.Gravity((0.0, 0.0, -9.81))


def solved(system, state, **options):
    """The equilibrium and its iterations; its residual is recomputed here."""
    iterations = []
    found = fc.equilibrium(system, state, report=iterations.append, **options)
    f = system.constraints.project(system.force(found))
    scale = sum(np.linalg.norm(part) for part in loads(system, found))
    assert np.linalg.norm(f) < max(1e-8 * scale, 1e-11)  # of about 1e3 N/m × 1 m, rounded
    assert not found.v.any()
    assert found.t == state.t
    return found, iterations


def loads(system, state):
    for term in system.bound:
        f = np.zeros_like(state.x)
        term.add_force(state.x, 0 * state.x, state.t, f)
        yield system.constraints.project(f)


# --- solutions known otherwise --------------------------------------------------------------------


def test_hanging_strip_meets_the_closed_form():
    errors = []
    for h in (0.1, 0.05, 0.025):
        cloth = fc.Cloth.rectangle(0.2, 1.0, h=h, pattern="right")
        fabric = fc.Fabric(areal_density=0.2, tensile_stiffness=20.0)  # 10 % strain at the clamp
        terms = [fc.StVK(), fc.Gravity((0.0, -9.81, 0.0))]
        system = fc.System(cloth, fabric, terms, pins=["top"])
        found, iterations = solved(system, system.rest())
        assert len(iterations) < 10
        down = system.rest().x[:, 1] - found.x[:, 1]
        mean = np.vdot(system.nodal_mass, down) / system.nodal_mass.sum()
        errors.append(abs(mean / hanging_strip_mean(1.0, 20.0, 0.2) - 1))
    assert errors[-1] < 1e-3
    exact = hanging_strip(1 - cloth.X[:, 1], 1.0, 20.0, 0.2)
    np.testing.assert_allclose(down, exact, rtol=0, atol=0.003 * exact.max())
    np.testing.assert_allclose(observed_order([4, 2, 1], errors), 2.0, atol=0.1)


@pytest.mark.parametrize("kind", ["symmetric", "exact"])
def test_pressurised_disk_from_the_flat_meets_the_exact_membrane(kind):
    height, volume = shooting(500.0)
    cloth = fc.Cloth.disk(0.5, 0.025)
    fabric = fc.Fabric(0.2, 1000.0, 0.3)
    system = fc.System(cloth, fabric, [fc.StVK(), fc.Pressure(500.0, kind)], pins=["boundary"])
    found, iterations = solved(system, system.rest())
    assert len(iterations) < 30
    assert iterations[0].shift > 0  # flat: no stiffness across
    assert (cloth.interpolator(np.zeros((1, 2))) @ found.x)[0, 2] == pytest.approx(height, rel=5e-3)
    assert enclosed(cloth, found.x) == pytest.approx(volume, rel=3e-3)


@pytest.mark.parametrize("rigidity", [1e-3, 1e-5])
def test_square_hung_by_its_corners_with_bending(rigidity):
    """From the flat state at rest, 1 478 triangles; the four corners carry the weight."""
    cloth = fc.Cloth.rectangle(1.0, 1.0, h=0.04)
    fabric = fc.Fabric(0.2, 1000.0, 0.3, bending_rigidity=rigidity)
    corners = fc.Pin(lambda X: (abs(X - 0.5) > 0.5 - 1e-9).all(axis=1))
    terms = [fc.StVK(), fc.HingeBending(), DOWN]
    system = fc.System(cloth, fabric, terms, pins=[corners])
    found, iterations = solved(system, system.rest())
    assert 1000 < len(cloth.triangles) <= 2000
    assert len(iterations) < 60
    carried = -system.force(found)[system.constraints.nodes]
    np.testing.assert_allclose(carried.sum(axis=0), [0, 0, 0.2 * 9.81], atol=1e-7)
    assert -0.5 < found.x[:, 2].min() < -0.02
    # a minimum of the energy: nearby admissible states have more
    rng = np.random.default_rng(1)
    for _ in range(5):
        noise = system.constraints.project(rng.standard_normal(found.x.shape))
        other = system.state(found.x + 1e-4 * noise)
        assert sum(system.energies(other).values()) > sum(system.energies(found).values())


def test_a_cloth_that_starts_squeezed():
    """In compression the tangent is indefinite: the definite one and σ M lead out of it."""
    cloth = fc.Cloth.rectangle(1.0, 1.0, h=0.1)
    fabric = fc.Fabric(0.2, 1000.0, 0.3, bending_rigidity=1e-4)
    pin = fc.Pin(lambda X: (abs(X[:, 0] - 0.5) > 0.5 - 1e-9) & (X[:, 1] > 1 - 1e-9))
    system = fc.System(cloth, fabric, [fc.StVK(), fc.HingeBending(), DOWN], pins=[pin])
    x = flat(cloth)
    x[:, 0] *= 0.8
    _, iterations = solved(system, system.state(x))
    assert len(iterations) < 60
    assert iterations[-1].shift == 0


def test_gas_couples_all_nodes():
    """What is found also balances the plain pressure p₀ V₀/V less the ambient one."""
    cloth = fc.Cloth.disk(0.5, 0.05)
    fabric = fc.Fabric(0.2, 1000.0, 0.3)
    terms = [fc.StVK(), fc.Gas(pressure=103325.0, volume=0.02)]
    system = fc.System(cloth, fabric, terms, pins=["boundary"])
    x = flat(cloth)
    x[:, 2] = 0.05 * (1 - np.sum(cloth.X**2, axis=1) / 0.25)
    x[cloth.nodes("boundary"), 2] = 0.0
    found, iterations = solved(system, system.state(x))
    assert quadratic(iterations)  # with the dense part left out it is not
    p = 103325.0 * 0.02 / enclosed(cloth, found.x) - 101325.0
    blown = fc.System(cloth, fabric, [fc.StVK(), fc.Pressure(p)], pins=["boundary"])
    f, (pull, push) = blown.force(found), loads(blown, found)
    assert np.linalg.norm(system.constraints.project(f)) < 1e-5 * np.linalg.norm(push)
    assert np.linalg.norm(pull) > 0.1


def test_slides_move_in_their_plane_only():
    """A strip between a wall and a slide is stretched by its weight along the slide's plane."""
    cloth = fc.Cloth.rectangle(0.2, 1.0, h=0.1, pattern="right")
    fabric = fc.Fabric(0.2, 20.0, 0.3)
    terms = [fc.StVK(), fc.Gravity((0.0, -9.81, 0.0))]
    slide = fc.Slide("top", normal=(0, 1, 0))
    corner = fc.Pin(lambda X: (X[:, 0] < 1e-9) & (X[:, 1] < 1e-9))
    hold = fc.Slide(lambda X: (X[:, 0] < 1e-9) & (X[:, 1] > 1e-9) & (X[:, 1] < 1), normal=(1, 0, 0))
    system = fc.System(cloth, fabric, terms, pins=[slide, corner, hold])
    found, _ = solved(system, system.rest())
    top = cloth.nodes("top")
    np.testing.assert_array_equal(found.x[top, 1], 1.0)
    assert np.ptp(found.x[top, 0]) < 0.2 - 1e-4  # contracts across, as Poisson has it


# --- convergence ----------------------------------------------------------------------------------


def quadratic(iterations):
    """Each of the last exact full steps squares the residual, down to round-off."""
    r = np.array([it.residual for it in iterations if it.shift == 0 and it.length == 1])
    r = r[r < 0.05]
    pairs = [(a, b) for a, b in pairwise(r) if a > 1e-7]
    return len(pairs) >= 2 and all(b < max(20 * a**2, 1e-9) for a, b in pairs)


def test_convergence_is_quadratic_near_the_solution():
    cloth = fc.Cloth.disk(0.5, 0.05)
    fabric = fc.Fabric(0.2, 1000.0, 0.3)
    for load in (DOWN, fc.Pressure(500.0)):
        system = fc.System(cloth, fabric, [fc.StVK(), load], pins=["boundary"])
        _, iterations = solved(system, system.rest())
        assert quadratic(iterations)


def test_the_solution_starts_solved(isotropic):
    """A second call takes no iteration; nor does a cloth without any load."""
    cloth = fc.Cloth.disk(0.5, 0.1)
    for terms in ([fc.StVK(), DOWN], [fc.StVK()]):
        system = fc.System(cloth, isotropic, terms, pins=["boundary"])
        found, _ = solved(system, system.rest())
        again, iterations = solved(system, found)
        assert iterations == []
        np.testing.assert_array_equal(again.x, found.x)


def test_superlu_finds_the_same(isotropic):
    cloth = fc.Cloth.disk(0.5, 0.1)
    system = fc.System(cloth, isotropic, [fc.StVK(), DOWN], pins=["boundary"])
    one, other = (solved(system, system.rest(), solver=name)[0] for name in ("direct", "superlu"))
    np.testing.assert_allclose(one.x, other.x, atol=1e-8)


# --- what has no equilibrium ----------------------------------------------------------------------


def test_an_unpinned_cloth_under_gravity_is_reported(sheet, isotropic):
    system = fc.System(sheet, isotropic, [fc.StVK(), DOWN])
    iterations = []
    with pytest.raises(fc.EquilibriumFailed, match="nothing holds the cloth") as failure:
        fc.equilibrium(system, system.rest(), report=iterations.append)
    assert len(iterations) < 30
    way = failure.value.state.x - system.rest().x
    assert (way[:, 2] < -5).all()


def test_slack_triangles_are_counted(isotropic):
    """Cut short on its way, a squeezed cloth without bending says how much of it is slack."""
    cloth = fc.Cloth.rectangle(1.0, 1.0, h=0.2)
    system = fc.System(cloth, isotropic, [fc.StVK(), DOWN], pins=["left"])
    state = system.state(0.8 * flat(cloth))
    with pytest.raises(fc.EquilibriumFailed, match=r"in 1 iterations; \d+ of \d+ triangles") as e:
        fc.equilibrium(system, state, max_iterations=1)
    assert "bending stiffness" in str(e.value)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"tolerance": 0.0}, r"equilibrium: tolerance = 0.0: must lie in \(0, 1\)"),
        ({"max_iterations": 0}, "max_iterations = 0: must be >= 1"),
        ({"solver": "pcg"}, "solver = 'pcg': must be direct, pardiso or superlu"),
    ],
)
def test_refusals(sheet, isotropic, options, said):
    system = fc.System(sheet, isotropic, [fc.StVK()])
    with pytest.raises(fc.InputError, match=said):
        fc.equilibrium(system, system.rest(), **options)
