"""Where explicit steps and unresolved motions fail: the boundaries predicted, and those found."""

import numpy as np
import pytest
from conftest import flat

import fecloth as fc

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
