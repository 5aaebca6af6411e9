"""What pairs of triangles dissipate: they push less while they move apart."""

import meshio
import numpy as np
import pytest
import scipy.sparse as sparse
from conftest import flat

import fecloth as fc
from fecloth.terms.contact.retreat import Retreat
from fecloth.terms.step_difference import StepDifference

pytestmark = pytest.mark.filterwarnings("ignore::fecloth.errors.FeclothWarning")

GAP = 1e-3
FABRIC = fc.Fabric(0.2, 1000.0, 0.3, bending_rigidity=1e-5)


def sheets(height, restitution=0.0, friction=0.0, thickness=0.0):
    """Two sheets, the upper one above the lower; the system, the positions and the upper nodes."""
    pytest.importorskip("ipctk")
    lower, upper = fc.Cloth.rectangle(0.06, 0.06, 0.03), fc.Cloth.rectangle(0.05, 0.05, 0.03)
    cloth = fc.Cloth.join([lower, upper], names=["lower", "upper"])
    contact = fc.SelfContact(GAP, friction, thickness, restitution=restitution)
    system = fc.System(cloth, FABRIC, [fc.StVK(), fc.PlateBending(), contact])
    x, above = flat(cloth), np.arange(len(cloth.X)) >= len(lower.X)
    x[above] += [0.004, 0.006, height]
    return system, x, above


def some_pairs(d0, rho, thickness=0.0):
    """Pairs that one coordinate moves apart."""
    n = len(d0)
    span = (GAP + thickness) ** 2 - thickness**2
    arrays = np.zeros((1, 3)), sparse.csr_matrix(np.outer(np.ones(n), [1.0, 0.0, 0.0]))
    return Retreat(*arrays, d0, np.full(n, 2.0), np.full(n, rho), thickness, span)


@pytest.mark.parametrize("thickness", [0.0, 4e-4])
def test_a_retreat_dissipates_at_any_distance_and_speed(thickness):
    d0 = thickness + GAP * np.array([1e-4, 0.01, 0.1, 0.5, 0.9, 0.99])
    for dt in (1e-6, 1e-4, 0.01, 1.0):
        rho = np.minimum(dt / 400, 0.5 * (GAP + thickness - d0))
        pairs = some_pairs(d0, rho, thickness)
        for z in GAP * np.array([1e-6, 1e-3, 0.02, 0.1, 0.4, 1.5]):
            held, y = pairs.held(np.full(len(d0), z)), np.array([[z, 0.0, 0.0]])
            elastic = pairs._pushes(np.full(len(d0), z))[0]
            assert (held >= 0).all()
            assert (held <= elastic * (1 + 1e-12)).all()
            assert pairs.lost(y) == pytest.approx(held.sum() * z)
            assert pairs.energy(y) >= 0
        assert not pairs.force(-y).any()
        assert not pairs.energy(-y)


def test_above_2_5_millimetres_a_second_nothing_pushes_and_at_half_of_it_a_half():
    d0, dt = np.array([0.5 * GAP]), 1e-4
    pairs = some_pairs(d0, dt / 400)
    push = []
    for speed in (1e-9, 1.25e-3, 2.5e-3, 0.1):
        z = np.array([speed * dt])
        push.append(float((pairs._pushes(z)[0] - pairs.held(z))[0]))
    np.testing.assert_allclose(push / pairs._pushes(0 * d0)[0], [1.0, 0.5, 0.0, 0.0], atol=1e-3)


def over_step(friction=0.0, thickness=0.0):
    """Sheets that move apart, tilt and slide over a step, as a bound term over it; and their x."""
    system, x, above = sheets(thickness + 0.4 * GAP, 0.0, friction, thickness)
    x[above, 2] += 0.2 * GAP * np.sin(40 * x[above, 0])
    (term,) = (each for each in system.bound if each.name == "SelfContact")
    over = term.over_step(StepDifference.between(x, 1e-3, 0.0))
    y = x.copy()
    y[above] += [1e-5, 2e-5, 1.2e-6]
    y[above, 2] += 1e-4 * (y[above, 0] - 0.03)
    return over, x, y


@pytest.mark.parametrize("thickness", [0.0, 4e-4])
def test_the_forces_of_a_retreat_have_a_potential(thickness):
    over, x, y = over_step(thickness=thickness)
    f, elastic = np.zeros_like(y), over.contact.push(y, 1e-3)
    over.add_force(y, y, 1e-3, f)
    assert np.abs(f - elastic).max() > 0.1 * np.abs(elastic).max()
    random, h = np.random.default_rng(1), 3e-11
    K = over.coupling(y, y, 1e-3, 1.0, 0.0, False)
    for _ in range(3):
        way = random.normal(size=y.shape)
        by_energy = (over.energy(y + h * way, 1e-3) - over.energy(y - h * way, 1e-3)) / (2 * h)
        assert by_energy == pytest.approx(-(f * way).sum(), rel=1e-5)
        there, back = np.zeros_like(y), np.zeros_like(y)
        over.add_force(y + h * way, y, 1e-3, there)
        over.add_force(y - h * way, y, 1e-3, back)
        np.testing.assert_allclose(
            (back - there).ravel() / (2 * h),
            K @ way.ravel(),
            atol=1e-4 * np.abs(K @ way.ravel()).max(),
        )
    lost = over.dissipation(y)
    assert lost == pytest.approx(((elastic - f) * (y - x)).sum(), rel=1e-9)
    assert lost > 0


def leave(method, v, dt, phase):
    """The part of its speed with which a sheet leaves another, and the run."""
    system, x, above = sheets(GAP + (2 + phase) * v * dt)
    velocity = np.where(above[:, None], [0.0, 0.0, -v], 0.0)
    run = fc.run(system, method, system.state(x, velocity), dt=dt, t_end=8 * dt + 2 * GAP / v)
    m, v_z = system.nodal_mass, run.state.v[:, 2]
    apart = np.average(v_z[above], weights=m[above]) - np.average(v_z[~above], weights=m[~above])
    return apart / v, run


@pytest.mark.stories
@pytest.mark.parametrize(
    ("method", "v", "dt"),
    [
        (fc.BackwardEuler(), 1.0, 0.01),
        (fc.BDF2(), 1.0, 1e-3),
        pytest.param(fc.BDF2(), 1.0, 1e-4, marks=pytest.mark.stories),
        pytest.param(fc.BackwardEuler(), 0.1, 0.01, marks=pytest.mark.stories),
    ],
)
def test_sheets_that_meet_stay_together(method, v, dt):
    """Elastic pairs leave up to 0.45 at 0.1 ms."""
    left, run = leave(method, v, dt, 0.55)
    assert -0.05 < left < 0.05
    total = run.energies["total"]
    assert total.max() <= total[0] * (1 + 1e-9)
    assert (np.diff(run.energies["dissipated:SelfContact"]) >= -1e-15 * total[0]).all()


THIN_ROD = fc.shapes.Capsule((-0.1, 0.01, -5e-4), (0.1, 0.01, -5e-4), 5e-4)


@pytest.fixture(scope="module")
def plate(tmp_path_factory):
    """A file with a square of two triangles at z = 0."""
    path = tmp_path_factory.mktemp("plate") / "plate.stl"
    corners = 0.1 * np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    meshio.write(path, meshio.Mesh(corners, [("triangle", np.array([[0, 1, 2], [0, 2, 3]]))]))
    return path


@pytest.mark.stories
@pytest.mark.parametrize("body", ["a mesh", "a thin rod"])
def test_a_strip_does_not_leave_what_it_hits(body, plate):
    """With elastic pairs it leaves the mesh with 0.38 of its speed. The rod is under its middle."""
    pytest.importorskip("ipctk")
    e = {"gap": GAP, "restitution": 0.0}
    hit = fc.MeshObstacle(plate, **e) if body == "a mesh" else fc.Obstacle(THIN_ROD, **e)
    cloth, v, dt = fc.Cloth.rectangle(0.02, 0.02, 0.02), 1.0, 1e-4
    system = fc.System(cloth, fc.Fabric(0.2, 1000.0, 0.3, bending_rigidity=1e-2), [fc.StVK(), hit])
    x = flat(cloth) + [0, 0, GAP + 2.4 * v * dt]
    start = system.state(x, 0 * x - [0, 0, v])
    run = fc.run(system, fc.BackwardEuler(), start, dt=dt, t_end=4e-3)
    assert -0.01 < system.nodal_mass @ run.state.v[:, 2] / system.total_mass < 0.05
    assert run.energies["total"].max() <= run.energies["total"][0] * (1 + 1e-9)


def test_a_restitution_of_pairs_is_0_or_1(tmp_path):
    for make in (fc.SelfContact, lambda **e: fc.MeshObstacle(tmp_path / "none.stl", **e)):
        with pytest.raises(fc.InputError, match="must be 0 or 1"):
            make(restitution=0.5)
