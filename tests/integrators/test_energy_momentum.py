"""Runs of energy–momentum: reactions, nets that turn, its tangents, and its ledger."""

import numpy as np
import pytest
from support.over_step import energy_momentum as over_step

import fecloth as fc

# steps are coarse and meshes small by intent
pytestmark = pytest.mark.filterwarnings("ignore::fecloth.errors.FeclothWarning")

EXACT = fc.Newton(tolerance=1e-13)
ISOTROPIC = fc.Fabric(0.2, 1000.0, 0.3, bending_rigidity=1e-3)


@pytest.fixture(scope="module")
def cloth():
    return fc.Cloth.rectangle(0.4, 0.3, h=0.1)


def test_reactions_balance_the_change_of_momentum(cloth):
    """The pins hold with dp/dt less the weight, whatever the membrane does."""
    system = fc.System(cloth, ISOTROPIC, [fc.StVK(), fc.Gravity()], pins=["left"])
    dt = 5e-3
    run = fc.run(system, fc.EnergyMomentum(), system.rest(), dt, dt, newton=EXACT)
    reaction = np.array([run.observed[f"reaction:left.{c}"][-1] for c in "xyz"])
    change = (system.scalar_mass @ run.state.v).sum(axis=0) / dt
    weight = system.nodal_mass.sum() * np.array([0, 0, -9.81])
    np.testing.assert_allclose(reaction, change - weight, atol=1e-9 * np.linalg.norm(weight))


def test_the_force_of_springs_over_a_turn_has_no_jump_at_a_small_stretch(cloth):
    """Per stretch it is the same from 1e-10 on; it jumped by φ²/8 where the stretch was 1e-8."""
    system = fc.System(cloth, fc.Fabric(0.2, 500.0, 0.2), [fc.Springs()])
    x, (c, s) = system.rest().x, (np.cos(0.4), np.sin(0.4))
    mean = 0.5 * (x + x @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]))
    over, forces = over_step(system, x), []
    for stretch in (1e-10, 1e-9, 1e-8, 1e-7, 1e-6):
        forces.append(over.force(system.state(mean * (1 + stretch))) / stretch)
    for f in forces:
        assert np.linalg.norm(f - forces[-1]) < 1e-3 * np.linalg.norm(forces[-1])


@pytest.mark.stories
def test_the_exact_tangent_helps_where_the_symmetric_one_does_not_converge():
    """A sheet that turns by 0.6 rad in each step."""
    cloth = fc.Cloth.rectangle(1.0, 1.0, h=0.1)
    fabric = fc.Fabric(0.2, 1000.0, 0.3, bending_rigidity=1e-5)
    system = fc.System(cloth, fabric, [fc.StVK(), fc.HingeBending()])
    x = system.rest().x - [0.5, 0.5, 0.0]
    start = system.state(1.02 * x, np.cross([0.0, 30.0, 9.0], x))

    def end(tangent):
        method = fc.EnergyMomentum(tangent=tangent)
        return [s.x for s, _ in fc.march(system, method, start, 0.02, 0.06, newton=EXACT)][-1]

    with pytest.raises(fc.StepFailed):
        end("symmetric")
    np.testing.assert_allclose(end("auto"), end("exact"), rtol=0, atol=1e-8)


@pytest.mark.stories
@pytest.mark.parametrize(
    "terms",
    [
        [fc.StVK(), fc.StrainRateDamping(0.002), fc.MassDamping(1.0), fc.Gravity()],
        [fc.Springs(damping=0.002), fc.HingeBending(), fc.BendingDamping(0.01), fc.Gravity()],
    ],
    ids=["membrane", "springs"],
)
def test_the_ledger_closes_on_a_nonlinear_problem_with_damping_and_a_moved_pin(terms, cloth):
    pin = fc.Pin("left", motion=lambda t: [0.0, 0.0, 0.05 * np.sin(20 * t)])
    system = fc.System(cloth, ISOTROPIC, terms, pins=[pin])
    newton = fc.Newton(tolerance=1e-13)
    energies = fc.run(system, fc.EnergyMomentum(), system.rest(), 5e-3, 0.2, newton=newton).energies
    flows = [v for k, v in energies.items() if k.startswith("dissipated")] + [energies["pins"]]
    turnover = energies["kinetic"].max() + sum(abs(flow).max() for flow in flows)
    assert all(abs(flow).max() > 1e-5 * turnover for flow in flows)
    assert abs(energies["remainder"]).max() < 1e-10 * turnover


@pytest.mark.stories
@pytest.mark.parametrize("damping", [0.0, 0.003])
@pytest.mark.parametrize(("pattern", "rate"), [("right", 5.0), ("equilateral", 30.0)])
def test_a_net_that_turns_without_stretch_meets_no_jump_of_the_force(pattern, rate, damping):
    """A spring's force over a step has a limit as its stretch over the step goes to zero."""
    cloth = fc.Cloth.rectangle(1.0, 0.6, h=0.1, pattern=pattern)
    system = fc.System(cloth, fc.Fabric(0.2, 500.0, 0.2), [fc.Springs(damping=damping)])
    x = system.rest().x - [0.5, 0.3, 0.0]
    start = system.state(x, np.cross([0.0, 0.0, rate], x))
    run = fc.run(system, fc.EnergyMomentum("exact"), start, dt=0.005, t_end=0.3)
    assert run.newton < 5 * 60
