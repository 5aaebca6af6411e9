"""Gas under the cloth: its volume, its energy, and the dense part of its tangent."""

import math

import numpy as np
import pytest
from conftest import flat, rough
from support.inflated import NU, RADIUS, STIFFNESS, enclosed, shooting

import fecloth as fc
from fecloth.linalg import select
from fecloth.linalg.block_matrix import BlockMatrix
from fecloth.linalg.low_rank_update import solve_updated

# steps are coarse and meshes small by intent
pytestmark = pytest.mark.filterwarnings("ignore::fecloth.errors.FeclothWarning")


def dome(cloth, height):
    x = flat(cloth)
    x[:, 2] = height * (1 - np.sum(cloth.X**2, axis=1) / RADIUS**2)
    x[cloth.nodes("boundary"), 2] = 0.0
    return x


def test_volume_is_that_above_the_plane_of_the_rim(isotropic, rng):
    cloth = fc.Cloth.disk(RADIUS, h=0.15)
    x = dome(cloth, 0.2)
    for shift in (np.zeros(3), np.array([3.0, -1.0, 2.0])):
        system = fc.System(cloth, isotropic, [fc.Gas(1.0, 1.0, origin=tuple(shift))])
        assert system.bound[0].volume(x + shift) == pytest.approx(enclosed(cloth, x), rel=1e-12)


def test_the_energy_of_a_gas_is_zero_at_its_first_volume(isotropic):
    cloth = fc.Cloth.disk(RADIUS, h=0.2)
    x = dome(cloth, 0.2)
    gas = fc.Gas(300.0, volume=enclosed(cloth, x), ambient=100.0)
    assert abs(fc.System(cloth, isotropic, [gas]).bound[0].energy(x, 0.0)) < 1e-12


def test_gas_and_pressure_have_equal_forces_inside(isotropic):
    cloth = fc.Cloth.disk(RADIUS, h=0.15)
    x = dome(cloth, 0.2)
    V = enclosed(cloth, x)
    inner = np.setdiff1d(np.arange(len(x)), cloth.nodes("boundary"))
    terms = fc.Gas(2 * 300.0, V / 2, ambient=250.0), fc.Pressure(50.0)
    gas, pressure = (fc.System(cloth, isotropic, [t]).force(fc.State(0, x, 0 * x)) for t in terms)
    np.testing.assert_allclose(gas[inner], pressure[inner], atol=1e-12)


@pytest.mark.parametrize("make", [select.direct, select.SuperLU, select.PCG])
def test_solve_updated_includes_the_rank_one_parts(make, sheet, isotropic, rng):
    system = fc.System(sheet, isotropic, [fc.StVK()])
    J = BlockMatrix.zeros(system.pattern)
    system.assemble(J, system.state(1.02 * flat(sheet)), wx=0.01, wa=100.0)
    updates = [(c, rng.standard_normal((len(sheet.X), 3))) for c in (3.0, 0.5)]
    b = rng.standard_normal((len(sheet.X), 3))
    solver = make()
    solver.prepare(J)
    x, infos = solve_updated(solver, updates, b, 1e-12)
    full = J.to_scipy().toarray() + sum(c * np.outer(u, u) for c, u in updates)
    np.testing.assert_allclose(full @ x.ravel(), b.ravel(), atol=1e-8 * abs(b).max())
    assert len(infos) == 3


def test_flat_start_gives_a_failed_step(isotropic):
    cloth = fc.Cloth.disk(RADIUS, h=0.2)
    system = fc.System(cloth, isotropic, [fc.StVK(), fc.Gas(900.0, 0.1)], pins=["boundary"])
    with pytest.raises(fc.StepFailed, match="not finite"):
        fc.run(system, fc.BackwardEuler(), system.rest(), 1e-3, 1e-2)
    assert math.isinf(system.energies(system.rest())["Gas"])
    system.force(system.state(rough(cloth, np.random.default_rng(0))))


def test_scene_with_gas_and_a_flat_cloth_is_rejected(tmp_path):
    from fecloth.scene.scene import load_scene

    text = """
cloth = { shape = "disk", radius = 0.5, h = 0.2 }
fabric = { areal_density = 0.2, tensile_stiffness = 1000.0 }
terms = [{ type = "StVK" }, { type = "Gas", pressure = 1e5, volume = 0.1 }]
pins = [{ where = "boundary", motion = [0, 0, "0.1 * t"] }]
time = { method = "implicit_midpoint", dt = 0.001, t_end = 0.01 }"""
    (path := tmp_path / "scene.toml").write_text(text)
    with pytest.raises(fc.SceneError, match=r"terms: Gas: has no finite force at the start.*dome"):
        load_scene(path).build()
    load_scene(path, ["start={position=['X', 'Y', '0.1*(0.25-X**2-Y**2)']}"]).build()


@pytest.mark.stories
def test_a_gas_inflates_the_membrane_to_the_exact_equilibrium():
    """At the volume of the reference solution the gas has the pressure of that solution."""
    height, V = shooting(500.0)
    gas = fc.Gas(2 * (500.0 + 800.0), V / 2, ambient=800.0)
    cloth, fabric = fc.Cloth.disk(RADIUS, RADIUS / 20), fc.Fabric(0.2, STIFFNESS, NU)
    system = fc.System(cloth, fabric, [fc.StVK(), gas], pins=["boundary"])
    end = fc.equilibrium(system, system.state(dome(cloth, 0.15)))
    assert system.bound[1].volume(end.x) == pytest.approx(V, rel=3e-3)
    centre = end.x[np.argmin(np.linalg.norm(cloth.X, axis=1)), 2]
    assert centre == pytest.approx(height, rel=5e-3)
    assert end.iterations < 15  # quadratic: without the dense part it takes far longer, or fails


@pytest.mark.stories
@pytest.mark.parametrize("method", [fc.ImplicitMidpoint(), fc.LinearlyImplicitEuler()])
def test_gas_oscillation_conserves_energy(method):
    """With the exact tangent the linearised step keeps pace with backward Euler's losses."""
    _, V = shooting(500.0)
    cloth = fc.Cloth.disk(RADIUS, h=0.1)
    gas = fc.Gas(900.0, V, ambient=500.0, exponent=1.4)
    fabric = fc.Fabric(0.2, STIFFNESS, NU)
    system = fc.System(cloth, fabric, [fc.StVK(), gas], pins=["boundary"])
    left = []
    for dt in (1e-3, 5e-4):
        run = fc.run(system, method, system.state(dome(cloth, 0.15)), dt, 0.05, solver="direct")
        left.append(abs(run.energies["remainder"]).max())
    scale = run.energies["kinetic"].max()
    assert left[1] < 0.05 * scale
    assert left[1] < left[0] / 1.6
