"""A method that a user writes: studies/examples/integrator.py, and what is refused."""

import re

import numpy as np
import pytest
from support.examples import example
from support.wrong_calls import own_method

import fecloth as fc

# steps are coarse and meshes small by intent
pytestmark = pytest.mark.filterwarnings("ignore::fecloth.errors.FeclothWarning")


@pytest.fixture(scope="module")
def own():
    return example("integrator")


@pytest.fixture(scope="module")
def cloth():
    return fc.Cloth.rectangle(0.4, 0.3, h=0.1, pattern="right")


@pytest.mark.stories
def test_integrators_agree_with_their_stability_functions(own):
    """R(z) at z = iω dt: of θ (1 + (1 − θ) z)/(1 − θ z), of SDIRK2 (1 + (1 − 2γ) z)/(1 − γ z)²."""
    omega = np.array([1e-2, 0.3, 1.0, 30.0])
    z, gamma = 1j * omega, 1 - np.sqrt(0.5)
    computed = fc.stability.amplification(own.SDIRK2(), omega)
    assert computed == pytest.approx(
        abs((1 + (1 - 2 * gamma) * z) / (1 - gamma * z) ** 2), rel=1e-10
    )
    for theta in (0.5, 0.6, 1.0):
        computed = fc.stability.amplification(own.Theta(theta), omega)
        assert computed == pytest.approx(abs((1 + (1 - theta) * z) / (1 - theta * z)), rel=1e-10)


@pytest.mark.stories
def test_the_example_prints_their_orders(own):
    lines = re.findall(r"(\w+)\(.*order (\S+), at .* by \[(\S+) +(\S+)\]", own.printed)
    assert [line[0] for line in lines] == ["Theta", "SDIRK2", "BDF2"]
    orders, slow, fast = np.array([line[1:] for line in lines], dtype=float).T
    assert orders == pytest.approx([1, 2, 2], abs=0.1)
    assert fast[0] == pytest.approx(0.4 / 0.6, abs=1e-6)  # (1 − θ)/θ
    assert fast[1] < 1e-5
    assert 1 - slow[1] < 0.1 * (1 - slow[2])


@pytest.fixture(scope="module")
def swinging(cloth, isotropic):
    """A damped sheet, taut, one of whose edges is moved along an arc."""
    lift = fc.Pin("left", lambda t: [0.05 * np.sin(20 * t), 0, 0.05 * (1 - np.cos(20 * t))])
    terms = [fc.StVK(), fc.StrainRateDamping(1e-3), fc.Gravity()]
    system = fc.System(cloth, isotropic, terms, pins=[lift, "right"])
    return system, system.state(system.rest().x * [1.1, 1.05, 1])


def test_a_method_needs_a_step_and_traits_for_a_march_and_numerical_for_a_run(swinging):
    system, start = swinging
    bare = own_method(fc.BackwardEuler(), "step", "traits")
    assert len(list(fc.march(system, bare, start, 1e-3, 2e-3, solver="direct"))) == 2


@pytest.mark.stories
def test_they_serve_a_run_with_moved_pins_and_its_ledger(own, swinging, cloth):
    """The pinned edge is where it should be; half the step leaves a quarter of the remainder."""
    system, start = swinging
    edge, remainders = cloth.nodes("left"), {}
    for method in (own.SDIRK2(), own.Theta(0.6)):
        for dt in (1e-3, 5e-4):
            result = fc.run(system, method, start, dt, 0.05)
            at = [0.05 * np.sin(1.0), 0, 0.05 * (1 - np.cos(1.0))]
            assert abs(result.state.x[edge] - start.x[edge] - at).max() < 1e-12
            speed = [np.cos(1.0), 0, np.sin(1.0)]
            np.testing.assert_allclose(
                result.state.v[edge], np.tile(speed, (len(edge), 1)), 1e-6, 1e-6
            )
            remainders[repr(method), dt] = abs(result.energies["remainder"][-1])
            assert remainders[repr(method), dt] < 0.02 * result.energies["StVK"][0]
            assert result.energies["numerical"][-1] > 0
    assert remainders["SDIRK2()", 1e-3] > 3 * remainders["SDIRK2()", 5e-4]
