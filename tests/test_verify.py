"""The checks of derivatives and orders detect errors and accept correct code."""

from dataclasses import dataclass

import numpy as np
import pytest
from conftest import affine, flat

import fecloth as fc
from fecloth.linalg.block_matrix import BlockMatrix
from fecloth.terms.kinematics import principal_stretches
from fecloth.terms.protocol import taken_from
from fecloth.verify import (
    Sweep,
    VerificationFailed,
    check_integrator,
    check_term,
    observed_order,
    trial_states,
)

ONE_SCALE = {"scales": (1.0,)}


@dataclass(frozen=True)
class WithErrors:
    """Another term with its energy, force and tangents multiplied."""

    base: object
    energy: float = 1.0
    force: float = 1.0
    stiffness: float = 1.0
    damping: float = 1.0

    def stencil(self, cloth):
        return self.base.stencil(cloth)

    def bind(self, panel, slots):
        return BoundWithErrors(self, self.base.bind(panel, slots))


@dataclass(frozen=True, eq=False)
class BoundWithErrors(fc.BoundTerm):
    by: WithErrors
    bound: fc.BoundTerm

    name = taken_from("bound.name")
    symmetric = taken_from("bound.symmetric")
    has_energy = taken_from("bound.has_energy")
    dissipative = taken_from("bound.dissipative")
    velocity_dependent = taken_from("bound.velocity_dependent")
    power = taken_from("bound.power")

    def energy(self, x, t):
        return self.by.energy * self.bound.energy(x, t)

    def add_force(self, x, v, t, f):
        own = np.zeros_like(f)
        self.bound.add_force(x, v, t, own)
        f += self.by.force * own

    def add_tangent(self, x, v, t, wx, wv, J, definite):
        own = BlockMatrix.zeros(J.pattern)
        wx, wv = wx * self.by.stiffness, wv * self.by.damping
        self.bound.add_tangent(x, v, t, wx, wv, own, definite)
        J.values[:] += own.values


EXACT = fc.StrainRateDamping(0.01, tangent="exact")


@pytest.mark.parametrize(
    ("term", "message"),
    [
        (WithErrors(fc.StVK(), energy=1.001), "^force of WithErrors"),
        (WithErrors(fc.StVK(), force=-1.0, stiffness=-1.0), "^force of WithErrors"),
        (WithErrors(fc.StVK(), stiffness=1.001), "^x-tangent of WithErrors"),
        (WithErrors(fc.StVK(), stiffness=0.0), "^x-tangent of WithErrors"),
        (WithErrors(EXACT, stiffness=1.001), "^x-tangent of WithErrors"),
        (WithErrors(EXACT, damping=1.001), "^v-tangent of WithErrors"),
        (WithErrors(EXACT, damping=0.0), "^v-tangent of WithErrors"),
        (WithErrors(fc.Gravity(), energy=1.001), "^force of WithErrors"),
        (WithErrors(fc.StVK(), force=0.0), "^StVK has no force"),
        (WithErrors(fc.StVK(), force=np.nan), "^StVK has no force"),
        (WithErrors(fc.StVK(), energy=np.nan), "^force of WithErrors"),
    ],
)
def test_check_term_wrong_derivatives_are_rejected(term, message):
    check_term(term.base, **ONE_SCALE)
    with pytest.raises(VerificationFailed, match=message):
        check_term(term, **ONE_SCALE)


def test_check_term_names_term_state_and_scale():
    message = (
        r"WithErrors\(base=StVK.* in the random state at stiffness × 0.001 .* slope .* instead of 2"
    )
    with pytest.raises(VerificationFailed, match=message):
        check_term(WithErrors(fc.StVK(), stiffness=1.1))


def test_check_term_runs_every_derivative_state_and_scale():
    sweeps = check_term(fc.StVK(), scales=(1e-2, 1e2))
    first, names, slopes = repr(sweeps).splitlines()
    assert first.endswith("in states random, compressed, nearly degenerate: passed")
    assert names == "  18 derivatives: force, x-tangent, v-tangent"
    assert slopes.startswith("  slopes 2.00 to 2.00, smallest relative error of each at most ")
    names = ["force", "x-tangent", "v-tangent"]
    assert [sweep.name for sweep in sweeps] == names * 3 * 2
    slopes = [sweep.slope for sweep in sweeps if sweep.name != "v-tangent"]
    assert slopes == pytest.approx(np.full(12, 2.0), abs=0.15)
    assert len(check_term(EXACT, tangents=("v",), **ONE_SCALE)) == 3  # it has no energy


def test_trial_states_have_the_properties_of_their_names(sheet):
    states = {name: principal_stretches(sheet, x) for name, x, _ in trial_states(sheet)}
    assert list(states) == ["random", "compressed", "nearly degenerate"]
    assert np.median(states["compressed"]) == pytest.approx(0.3, abs=0.1)
    assert states["compressed"].max() < 1
    assert (states["nearly degenerate"][:, 0] < 0.05).all()
    assert states["random"].max() > 1.2
    x, other = trial_states(sheet)[0][1], trial_states(sheet, seed=1)[0][1]
    assert np.array_equal(x, trial_states(sheet)[0][1])
    assert abs(x - other).max() > 0.01


H = 0.1 * 0.5 ** np.arange(16)


def test_sweep_with_slope_two_or_round_off_is_accepted():
    """3 h² + 1e-15/h has its minimum at 5e-6; errors below 1e-8 mean a linear function."""
    right = Sweep("force", H, 3 * H**2 + 1e-15 / H)
    right.check("it")
    assert right.slope == pytest.approx(2, abs=0.02)
    linear = Sweep("force", H, 1e-14 / H)
    linear.check("it")
    assert np.isnan(linear.slope)


@pytest.mark.parametrize(
    "errors",
    [3 * H, 3 * H**3, 3 * H**2 + 1e-4, np.full(16, 1e-3), np.full(16, 1e-6), 1e-7 / H, H * np.nan],
    ids=["order 1", "order 3", "plateau", "constant", "small constant", "growing", "nan"],
)
def test_sweep_with_another_slope_is_rejected(errors):
    with pytest.raises(VerificationFailed, match="^force of it is not the derivative: slope"):
        Sweep("force", H, errors).check("it")


def test_sweep_with_large_smallest_error_is_rejected():
    with pytest.raises(VerificationFailed, match="slope 2.00 .* smallest relative error 1.2e-04"):
        Sweep("force", H[:5], 3 * H[:5] ** 2).check("it")


def test_observed_order_of_a_power_law():
    h = [0.4, 0.1, 0.07, 0.01]
    for order in (1, 2, 3.5):
        errors = 7 * np.array(h) ** order
        np.testing.assert_allclose(observed_order(h, errors), np.full(3, order), rtol=1e-12)
    assert observed_order([2, 1], [1, 2]) == pytest.approx([-1])  # it grows, and integers do


def test_check_integrator_returns_orders_and_checks_the_tolerance(isotropic):
    cloth = fc.Cloth.rectangle(0.4, 0.3, h=0.1, pattern="right")
    system = fc.System(cloth, isotropic, [fc.StVK(), fc.Gravity()], pins=["boundary"])
    start = system.state(affine(cloth, [[1.1, 0], [0, 1.1], [0, 0]]))
    orders = check_integrator(system, fc.ImplicitMidpoint(), start, 0.005)
    assert orders.shape == (2,)
    assert orders[-1] == pytest.approx(2, abs=0.15)
    with pytest.raises(VerificationFailed, match="ImplicitMidpoint.*expected 2"):
        check_integrator(system, fc.ImplicitMidpoint(), start, 0.005, tolerance=1e-9)


def test_check_term_round_off_does_not_count_as_force():
    cloth = fc.Cloth.rectangle(0.3, 0.2, h=0.05)
    rest = flat(cloth)
    with pytest.raises(VerificationFailed, match="has no force"):
        check_term(fc.StVK(), cloth=cloth, states=[("rest", rest, 0 * rest)])
