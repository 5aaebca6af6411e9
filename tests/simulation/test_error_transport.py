"""How an error moves on with the cloth, and the error in time that follows, in closed form."""

import math
from functools import cache

import numpy as np
import pytest
from scipy.linalg import eigh

import fecloth as fc
from fecloth.errors import IndefiniteMatrix
from fecloth.simulation import error_transport
from fecloth.simulation.error_transport import Error, Transport, carry_error
from fecloth.simulation.sampled_error import SampledError, _as_random

# steps are coarse and meshes small by intent
pytestmark = pytest.mark.filterwarnings("ignore::fecloth.errors.FeclothWarning")

RATE = 30.0  # of the damping [1/s]


@cache
def sheet(stretch: float):
    """A held sheet with damping, its state, and the mode of least ω²: shape (n, 3) and ω²."""
    cloth = fc.Cloth.rectangle(0.4, 0.4, h=0.2, pattern="cross")
    terms = [fc.StVK(), fc.MassDamping(rate=RATE)]
    system = fc.System(cloth, fc.Fabric(0.2, 50.0, 0.2), terms, pins=["boundary"])
    state = system.state(np.column_stack([stretch * cloth.X, 0 * cloth.X[:, 0]]))
    free = system.free
    K = system.stiffness(state).toarray()[np.ix_(free, free)]
    squares, shapes = eigh(K, np.diag(np.repeat(system.nodal_mass, 3)[free]))
    shape = np.zeros((len(cloth.X), 3))
    shape.ravel()[free] = shapes[:, 0]
    return system, state, shape, squares[0]


def moved_on(square: float, seconds: float, at, s: float, r: float) -> np.ndarray:
    """(δ, η) after the time of δ' = η + s, η' = −ω² δ − c η + r, by its exponential."""
    A = np.array([[0.0, 1.0, s], [-square, -RATE, r], [0.0, 0.0, 0.0]])
    values, vectors = np.linalg.eig(A)
    flow = vectors @ np.diag(np.exp(values * seconds)) @ np.linalg.inv(vectors)
    return (flow @ [*at, 1.0]).real[:2]


@pytest.mark.parametrize("stretch", [1.05, 0.95], ids=["taut", "buckling"])
@pytest.mark.parametrize("forcing", [(0.0, 0.0), (3.0, 0.0), (0.0, 500.0)], ids=["free", "s", "r"])
def test_an_error_swings_or_grows_as_a_mode(stretch, forcing, monkeypatch):
    """A taut sheet has ω² > 0, a compressed one ω² < 0. The method has order 2."""
    monkeypatch.setattr(error_transport, "RTOL_OF_TRANSPORT", 1e-9)
    system, state, shape, square = sheet(stretch)
    assert (square > 0) == (stretch > 1)
    frequency, (s, r) = math.sqrt(abs(square)), forcing
    far = []
    for seconds in (0.2 / frequency, 0.1 / frequency):
        step = Transport.at(system, state, seconds)
        error = step.carry(Error(0.7 * shape, 20.0 * shape), s * shape, r * shape)
        size = (shape**2).sum()
        said = np.array([(each * shape).sum() / size for each in (error.x, error.v)])
        true = moved_on(square, seconds, (0.7, 20.0), s, r)
        far.append(np.abs((said - true) / [1.0, frequency]).max())
    assert far[0] < 2e-3
    assert far[1] < far[0] / 6  # order 3 in a step


def test_an_error_that_grows_too_fast_for_a_step_is_carried_in_parts(monkeypatch):
    """One step over so long a time has an indefinite matrix, and its error would not grow."""
    system, state, shape, square = sheet(0.95)
    assert square < 0
    seconds = 5.0 / math.sqrt(-square)
    with pytest.raises(IndefiniteMatrix):
        Transport.at(system, state, seconds).carry(Error(shape, 0 * shape), 0 * shape, 0 * shape)
    after = carry_error(system, state, seconds, Error(shape, 0 * shape), 0 * shape, 0 * shape)
    grown = (after.x * shape).sum() / (shape**2).sum()
    true, _ = moved_on(square, seconds, (1.0, 0.0), 0.0, 0.0)
    assert true > 10
    assert grown == pytest.approx(true, rel=0.5)
    monkeypatch.setattr(error_transport, "MOST_PARTS", 1)
    with pytest.raises(IndefiniteMatrix):
        carry_error(system, state, seconds, Error(shape, 0 * shape), 0 * shape, 0 * shape)


def test_waves_that_no_step_resolves_are_taken_away():
    system, state, shape, square = sheet(1.05)
    step = Transport.at(system, state, 1e4 / math.sqrt(square))
    after = step.carry(Error(shape, 0 * shape), 0 * shape, 0 * shape)
    assert np.abs(after.x).max() < 1e-2 * np.abs(shape).max()


def test_random_errors_add_up_by_their_squares(rng):
    a, b = rng.normal(size=(2, 5, 3))
    for sign in (1.0, -1.0):
        assert ((a + _as_random(a, sign * b)) ** 2).sum() == pytest.approx((a**2 + b**2).sum())


def share_of(load, method, dt, t_end):
    """The error that is told of a free sheet under a load, before safety; the system, the end."""
    cloth = fc.Cloth.rectangle(0.4, 0.4, h=0.2, pattern="cross")
    system = fc.System(cloth, fc.Fabric(0.2, 500.0, 0.2), [fc.StVK(), load])
    result = fc.run(system, method, system.rest(), dt, t_end)
    return result.time_error / SampledError.safety, system, result.state.x[:, 2].mean()


@pytest.mark.parametrize("method", [fc.BackwardEuler(), fc.BDF2()], ids=str)
def test_a_sheet_that_the_wind_blows_along_is_judged_rightly(method):
    """Of a free sheet across the wind u' = −k u², u = U − v: the way is U t − ln(1 + k U t)/k."""
    wind, t_end = fc.Wind((0.0, 0.0, 8.0), normal=0.6, tangential=0.0), 0.5
    told, system, z = share_of(wind, method, 0.01, t_end)
    k = system.force(system.rest())[:, 2].sum() / system.nodal_mass.sum() / 8.0**2
    way = 8.0 * t_end - math.log(1 + k * 8.0 * t_end) / k
    true = abs(z - way) / way
    assert 1e-5 < true < 0.1
    assert 1 / 3 < told / true < 3


def test_a_fall_is_judged_rightly():
    """Backward Euler falls by g t dt / 2 too far."""
    told, *_ = share_of(fc.Gravity(), fc.BackwardEuler(), 0.002, 0.5)
    assert told == pytest.approx(0.002 / 0.5, rel=0.3)


def test_a_wind_that_is_switched_off_within_a_step_is_in_the_error():
    """The velocity is off by up to half a step of the acceleration, by a quarter on average."""
    wind = fc.Wind((0.0, 0.0, "where(t < 0.025, 4, 0)"), normal=0.2, tangential=0.0)
    told, *_ = share_of(wind, fc.ImplicitMidpoint(), 0.01, 0.2)
    assert told == pytest.approx(0.25 / 2.5, rel=0.5)


def test_a_flat_sheet_that_is_pressed_together_is_not_resolved():
    """Its buckles grow from nothing, by a factor that no step sees."""
    cloth = fc.Cloth.rectangle(0.6, 0.6, h=0.1, pattern="cross")
    system = fc.System(cloth, fc.Fabric(0.2, 500.0, 0.2), [fc.StVK()], pins=["boundary"])
    x = np.column_stack([0.97 * cloth.X, 1e-5 * np.sin(9 * cloth.X[:, 0])])
    result = fc.run(system, fc.BDF2(), system.state(x), 0.001, 0.03)
    assert 0.3 < result.time_error <= 1.0
    assert any(doubt.kind.value == "time" for doubt in result.doubts)
