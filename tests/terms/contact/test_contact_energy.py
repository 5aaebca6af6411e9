"""The energy of a sheet that bounces with friction: on a plane, a mesh, and another sheet."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import flat

import fecloth as fc
from fecloth.terms.step_difference import StepDifference

GAP, KAPPA = 2e-3, 50.0
FABRIC = fc.Fabric(0.2, 200.0, 0.3, bending_rigidity=1e-5)
TABLE = "solid table\n" + "".join(
    "facet normal 0 0 1\nouter loop\n"
    + "".join(f"vertex {x} {y} 0\n" for x, y in corners)
    + "endloop\nendfacet\n"
    for corners in (((-1, -1), (1, -1), (1, 1)), ((-1, -1), (1, 1), (-1, 1)))
)


def against(kind, folder):
    """The term, the cloth, and its positions a gap above what it falls on."""
    sheet = fc.Cloth.rectangle(0.1, 0.05, 0.05, "right")
    if kind == "Obstacle":
        plane = fc.shapes.Plane((0, 0, 0), (0, 0, 1))
        return (
            fc.Obstacle(plane, GAP, 0.2, KAPPA, restitution=1.0),
            sheet,
            flat(sheet) + [0, 0, GAP],
        )
    pytest.importorskip("ipctk")
    if kind == "MeshObstacle":
        path = folder / "table.stl"
        path.write_text(TABLE + "endsolid table\n")
        x = flat(sheet) + [0.3, -0.5, GAP]  # off the diagonal
        return fc.MeshObstacle(path, GAP, 0.2, KAPPA, restitution=1.0), sheet, x
    cloth = fc.Cloth.join([sheet, fc.Cloth.rectangle(0.3, 0.2, 0.1, "right")], ["upper", "lower"])
    upper = np.isin(np.arange(len(cloth.X)), cloth.nodes("upper"))[:, None]
    x = flat(cloth) + np.where(upper, [0.053, 0.031, GAP], [0, 0, 0])
    return fc.SelfContact(GAP, friction=0.2, stiffness=KAPPA, restitution=1.0), cloth, x


@pytest.mark.stories
@pytest.mark.filterwarnings("ignore::fecloth.errors.FeclothWarning")
@pytest.mark.parametrize("kind", ["Obstacle", "MeshObstacle", "SelfContact"])
def test_the_energy_that_a_bounce_has_lost_is_the_heat_of_friction(kind, tmp_path):
    """To 1 %, with steps so short that BDF2 dissipates nothing."""
    contact, cloth, x = against(kind, tmp_path)
    pins = ["lower"] if kind == "SelfContact" else []
    system = fc.System(cloth, FABRIC, [fc.StVK(), contact], pins)
    falls = np.ones(len(x), bool)
    falls[system.constraints.nodes] = False
    start = system.state(x, np.where(falls, 1.0, 0.0)[:, None] * [1.0, 0.0, -0.3])
    run = fc.run(system, fc.BDF2(), start, 2e-4, 0.03, newton=fc.Newton(tolerance=1e-9))
    v, mass = run.state.v[falls], system.nodal_mass[falls]
    heat, total = run.energies[f"dissipated:{kind}"][-1], run.energies["total"]
    assert (mass @ v / mass.sum())[2] > 0.2  # it has bounced
    assert heat > 0.1 * total[0]
    assert heat == pytest.approx(total[0] - total[-1], rel=0.01)


@pytest.mark.parametrize("kind", ["Obstacle", "MeshObstacle", "SelfContact"])
def test_the_work_against_friction_is_heat_and_stored_in_its_springs(kind, tmp_path):
    """F Δe of a step that slides at its end: the heat, and twice k e²/2 of the springs."""
    contact, cloth, x = against(kind, tmp_path)
    dt, x = 0.01, x - np.where(x[:, 2:] > 0, [0, 0, 0.1 * GAP], 0.0)
    end = x + dt * np.where(x[:, 2:] > 0, [0.03, -0.02, 0.0], 0.0)
    step = StepDifference(x, dt, dt, ((1.0, x),))
    forces = []
    for term in (contact, replace(contact, friction=0.0)):
        bound = fc.System(cloth, FABRIC, [term]).bound[0].over_step(step)
        forces.append(np.zeros_like(x))
        bound.add_force(end, (end - x) / dt, dt, forces[-1])
        if term is contact:
            record, heat = bound.commit(end, dt), bound.dissipation(end)
            stored = bound.contact.with_history(record).held(dt).energy(end)
    work = -np.vdot(forces[0] - forces[1], end - x)
    assert heat + 2 * stored == pytest.approx(work, rel=1e-12)
    assert heat > stored > 0.0


@pytest.mark.parametrize("shape", ["z - 0.1*t", "2*z - 0.2*t"])
def test_a_shape_that_deforms_works_over_the_way_of_its_surface(shape):
    """A floor that rises at 0.1 m/s, as a formula: the force across times the way it has risen."""
    cloth, dt = fc.Cloth.rectangle(0.1, 0.05, 0.05, "right"), 0.005
    floor = fc.Obstacle(fc.shapes.Sdf(shape), GAP, stiffness=KAPPA)
    (term,) = fc.System(cloth, FABRIC, [floor]).bound
    x = flat(cloth) + [0, 0, 0.01 + 0.2 * GAP]
    over, f = term.over_step(StepDifference.between(x + [0, 0, 1e-4], dt, 0.1 - dt)), 0 * x
    over.add_force(x, x, 0.1, f)
    assert f[:, 2].sum() > 0
    assert over.work(x) == pytest.approx(0.1 * dt * f[:, 2].sum(), rel=1e-9)
