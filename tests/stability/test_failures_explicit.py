"""Where explicit steps and unresolved motions fail: the boundaries predicted, and those found."""

import numpy as np
import pytest
import scipy.linalg
from conftest import flat

import fecloth as fc

FREQUENCY = 10.0  # Hz


def shaken(start=0.0):
    """A small sheet, whose left edge moves by 2 cm (1 − cos 2πft) from the time `start` on."""

    def motion(t):
        return [0.0, 0.0, 0.02 * (1 - np.cos(2 * np.pi * FREQUENCY * max(t - start, 0.0)))]

    cloth = fc.Cloth.rectangle(0.4, 0.2, h=0.1, pattern="cross")
    fabric = fc.Fabric(0.2, 100.0, 0.3)
    terms = [fc.StVK(), fc.StrainRateDamping(0.01), fc.MassDamping(5.0)]
    system = fc.System(cloth, fabric, terms, pins=[fc.Pin("left", motion), "right"])
    return system, system.state(flat(cloth) * [1.02, 1.0, 1.0])


def deflections(system, start, method, dt, times):
    marching = fc.march(system, method, start, dt, times[-1], stops=times)
    steps = [(state, info) for state, info in marching]
    z = [system.nodal_mass @ s.x[:, 2] for s, _ in steps if s.t in times]
    return np.array(z) / system.nodal_mass.sum(), steps


BEYOND = fc.CentralDifference(beyond_limit=True)
TINY = 1e-9  # m: the motion stays linear


def sheet_system(h=0.1, Y=1000.0, damping=0.0, cloth=None):
    cloth = cloth or fc.Cloth.rectangle(0.5, 0.5, h=h, pattern="right")
    terms = [fc.StVK(), *([fc.StrainRateDamping(damping)] if damping else [])]
    return fc.System(cloth, fc.Fabric(0.2, Y, 0.3), terms, pins=["left"])


def noisy(system):
    """The system at rest, but for noise."""
    noise = np.random.default_rng(3).standard_normal((len(system.cloth.X), 3))
    return system.state(flat(system.cloth) + TINY * system.constraints.project(noise))


def explodes(system, dt, steps=1000):
    start = noisy(system)
    for state, _ in fc.march(system, BEYOND, start, dt, steps * dt):
        if abs(state.x - flat(system.cloth)).max() > 1e4 * TINY:
            return True
    return False


def limits(systems):
    """The predicted limit of each; that the real one lies within 2 % of it is seen here."""
    computed = []
    for system in systems:
        limit = fc.critical_dt(system, system.rest(), "central_difference")
        assert not explodes(system, 0.98 * limit)
        assert explodes(system, 1.02 * limit)
        computed.append(limit)
    return np.array(computed)


# --- 1: beyond the Courant limit ------------------------------------------------------------------


def test_the_limit_falls_with_the_mesh_size():
    coarse, fine = limits([sheet_system(h) for h in (0.1, 0.05)])
    assert fine == pytest.approx(coarse / 2, rel=0.01)


@pytest.mark.stories
def test_where_strain_rate_damping_governs_it_falls_with_the_square_of_the_mesh_size():
    """Then dt d < 1 counts, d = τ k; here τ is 10 to 40 times the undamped limit."""
    coarse, fine = limits([sheet_system(h, damping=0.02) for h in (0.1, 0.05)])
    assert fine == pytest.approx(coarse / 4, rel=0.02)
    (half,) = limits([sheet_system(damping=0.01)])
    assert half == pytest.approx(2 * coarse, rel=0.02)


# --- 7: slivers -----------------------------------------------------------------------------------


def with_a_sliver(height):
    """A good mesh whose middle node is moved to `height` from the next column of nodes."""
    cloth = fc.Cloth.rectangle(0.5, 0.5, h=0.1, pattern="right")
    X = cloth.X.copy()
    middle = np.argmin(np.sum((X - 0.2) ** 2, axis=1))
    X[middle, 0] += 0.1 - height
    return fc.Cloth.from_arrays(X, cloth.triangles, {"left": cloth.nodes("left")})


@pytest.mark.stories
def test_a_sliver_sets_the_step_of_the_whole_cloth():
    """Its stiffness goes like base/height, its nodes have the mass of their other triangles."""
    regular = limits([sheet_system()])[0]
    slivers = limits([sheet_system(cloth=with_a_sliver(h)) for h in (0.01, 0.0025)])
    assert slivers[0] < 0.5 * regular
    assert slivers[1] == pytest.approx(slivers[0] / 2, rel=0.02)  # √height
    system = sheet_system(cloth=with_a_sliver(0.0025))
    with pytest.raises(fc.InputError, match=f"must be at most {slivers[1]:.4g} s"):
        next(fc.march(system, fc.CentralDifference(), system.rest(), regular, 1.0))
    for method, dt in ((fc.CentralDifference(), None), (fc.BackwardEuler(), regular)):
        *_, (end, _) = fc.march(system, method, noisy(system), dt, 0.1)
        assert abs(end.x - flat(system.cloth)).max() < 100 * TINY


def test_the_limit_falls_with_the_root_of_the_stiffness():
    soft, stiff = limits([sheet_system(Y=Y) for Y in (500.0, 8000.0)])
    assert stiff == pytest.approx(soft / 4, rel=1e-6)


@pytest.mark.parametrize("share", [0.1, 0.05])
def test_forward_euler_grows_at_the_predicted_rate(share):
    """√(1 + ω² dt²) a step: half the step only takes twice the time."""
    system = sheet_system()
    rest, Z = system.rest(), system.admissible
    K, M = (Z.T @ A @ Z for A in (system.stiffness(rest), system.mass))
    values, modes = scipy.linalg.eigh(K.toarray(), M.toarray())
    omega, shape = np.sqrt(values[-1]), (Z @ modes[:, -1]).reshape(-1, 3)
    dt, steps = 2 * share / omega, round(2 / share**2)
    start = system.state(rest.x + 1e-7 * shape)

    def growth(method):
        *_, (end, _) = fc.march(system, method, start, dt, steps * dt)
        weight = system.nodal_mass[:, None] * shape  # shape·M shape = 1
        return np.hypot(np.vdot(weight, end.x - rest.x), np.vdot(weight, end.v) / omega) / 1e-7

    assert fc.critical_dt(system, rest, "forward_euler") == 0.0
    grown = growth(fc.ForwardEuler(beyond_limit=True))
    assert np.log(grown) == pytest.approx(0.5 * steps * np.log(1 + (omega * dt) ** 2), rel=1e-3)
    assert grown > 30
    for remedy in (fc.SymplecticEuler(), fc.CentralDifference()):
        assert growth(remedy) < 1.2


@pytest.mark.stories
def test_a_pin_sampled_once_a_period_stands_still():
    system, start = shaken()
    times, method = np.arange(1, 6) / FREQUENCY, fc.ImplicitMidpoint()
    resolved, _ = deflections(system, start, method, 5e-4, times)
    errors = []
    for parts in (1, 8, 64):
        found, _ = deflections(system, start, method, 1 / FREQUENCY / parts, times)
        errors.append(abs(found - resolved).max() / abs(resolved).max())
    print("errors at 1, 8 and 64 steps a period", errors)
    assert errors[0] == pytest.approx(1.0, abs=1e-6)  # nothing moved at all
    assert 0.02 < errors[1] < 0.5
    assert errors[2] < 0.01
