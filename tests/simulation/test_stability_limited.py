"""Explicit runs take steps near their limit, are refused beyond it, and end early if they grow."""

import numpy as np
import pytest

import fecloth as fc
from fecloth.errors import SolveFailed
from fecloth.simulation.energy_balance import MOST_GROWTH
from fecloth.simulation.energy_ledger import Ledger
from fecloth.simulation.stability_limited import STEP_OVER_LIMIT, UPDATE_STEPS
from fecloth.terms.kinematics import largest_stretch, principal_stretches


@pytest.fixture(scope="module")
def sheet():
    cloth = fc.Cloth.rectangle(0.5, 0.25, h=0.125, pattern="cross")
    fabric = fc.Fabric(0.2, tensile_stiffness=200.0, poisson_ratio=0.3)
    return cloth, fabric


def pulled(sheet, to, during):
    """A sheet whose right side is drawn to so many times its length."""
    cloth, fabric = sheet

    def motion(t):
        part = np.clip(t / during, 0.0, 1.0)
        return (0.5 * (to - 1) * part, 0.0, 0.0)

    pins = ["left", fc.Pin("right", motion)]
    return fc.System(cloth, fabric, [fc.StVK(), fc.MassDamping(5.0)], pins)


@pytest.mark.parametrize("method", [fc.CentralDifference(), fc.SymplecticEuler()], ids=repr)
def test_without_a_dt_the_step_is_a_part_of_the_limit(sheet, method):
    system = fc.System(*sheet, [fc.StVK(), fc.Gravity()], ["left"])
    start = system.rest()
    limit = fc.critical_dt(system, start, method)
    infos = [info for _, info in fc.march(system, method, start, t_end=0.01)]
    assert infos[0].dt == pytest.approx(STEP_OVER_LIMIT * limit, rel=0.03)
    assert infos[0].dt < limit
    assert infos[-1].t == 0.01


def test_the_step_follows_a_cloth_that_stiffens(sheet):
    """At twice its length a membrane is far stiffer: the first step would not do at the end."""
    method, system = fc.CentralDifference(), pulled(sheet, 2.0, 2.0)
    infos = [info for _, info in fc.march(system, method, system.rest(), t_end=2.0)]
    first, last = infos[0].dt, infos[-2].dt
    assert len(infos) > UPDATE_STEPS
    assert last < 0.6 * first
    assert last < fc.critical_dt(system, infos[-1].result.state, method)
    with pytest.raises(fc.StepFailed):
        list(fc.march(system, method, system.rest(), first, t_end=2.0))


def test_a_dt_beyond_the_limit_is_refused(sheet):
    system = fc.System(*sheet, [fc.StVK()], ["left"])
    start, method = system.rest(), fc.CentralDifference()
    limit = fc.critical_dt(system, start, method)
    with pytest.raises(fc.InputError, match=rf"at most {limit:.4g} s.*beyond_limit=True") as error:
        next(fc.march(system, method, start, 1.01 * limit, 1.0))
    assert "implicit" in str(error.value)
    next(fc.march(system, method, start, 0.99 * limit, 1.0))
    next(fc.march(system, fc.CentralDifference(beyond_limit=True), start, 1.01 * limit, 1.0))


def test_a_stretch_beyond_the_bound_ends_the_run(sheet):
    system = pulled(sheet, 3.0, 0.2)
    march = fc.march(system, fc.BackwardEuler(), system.rest(), 0.01, 0.3, most_stretch=2.0)
    with pytest.raises(fc.StepFailed, match=r"stretched to .* times, beyond 2") as failure:
        list(march)
    right = failure.value.state
    assert 0.05 < right.t < 0.15
    assert largest_stretch(system.cloth, right.x) <= 2.0


def test_largest_stretch(sheet, rng):
    cloth, _ = sheet
    x = rng.standard_normal((len(cloth.X), 3))
    assert largest_stretch(cloth, x) == pytest.approx(principal_stretches(cloth, x).max(), 1e-12)
    x[3, 1] = np.nan
    assert np.isnan(largest_stretch(cloth, x))


def test_unexplained_growth_of_energy_ends_the_run_early(sheet):
    """Just beyond the limit of a fall: the energy is out of hand before the numbers are."""
    system = fc.System(*sheet, [fc.StVK(), fc.Gravity()], ["left"])
    start, method = system.rest(), fc.CentralDifference(beyond_limit=True)
    dt = 1.05 * fc.critical_dt(system, start, method)
    with pytest.raises(fc.StepFailed, match=r"the method has made the rest") as failure:
        fc.run(system, method, start, dt, 2.0)
    right = failure.value.state
    assert largest_stretch(system.cloth, right.x) < 3.0
    weight = 9.81 * system.nodal_mass
    fallen = weight @ (start.x - right.x)[:, 2]
    kinetic = 0.5 * system.nodal_mass @ (right.v**2).sum(axis=1)
    assert kinetic < 2 * MOST_GROWTH * abs(fallen)


@pytest.mark.parametrize("name", ["wind", "pins", "spin"])
def test_what_was_supplied_bounds_the_energy_of_an_exact_method(sheet, name):
    """By loads without energy, by moved pins, from the start: the method has made nothing."""
    cloth, fabric = sheet
    loads = [fc.Wind((0.0, 3.0, 8.0), normal=1.0)] if name == "wind" else []
    shake = fc.Pin("left", lambda t: (0.0, 0.0, 0.05 * np.sin(20 * t)))
    pins = {"wind": ["left"], "pins": [shake], "spin": []}[name]
    system = fc.System(cloth, fabric, [fc.StVK(), *loads], pins)
    rest = system.rest()
    start = system.state(rest.x, np.column_stack([-rest.x[:, 1], rest.x[:, 0], 0 * rest.x[:, 0]]))
    method, shares = fc.EnergyMomentum(), []
    begin = start if name == "spin" else rest
    ledger = Ledger.open(system, begin)
    for _, info in fc.march(system, method, begin, 2e-3, 0.3):
        ledger = ledger.after(system, method, info.old, info.result)
        shares.append(ledger.kinetic / ledger.supplied)
    assert 0.1 < max(shares) < 1.01


class Push(fc.BoundTerm):
    """A user's load that tells neither an energy nor its work."""

    name = "Push"
    symmetric, has_energy, dissipative, velocity_dependent = True, False, False, False

    def stencil(self, cloth):
        return None

    def bind(self, panel, slots):
        return self

    def add_force(self, x, v, t, f):
        f[:, 2] += t

    def add_tangent(self, x, v, t, wx, wv, J, definite):
        pass


def test_load_without_a_supply_is_not_taken_for_a_blow_up(sheet):
    """The energy that it gives is not known, so no motion is too fast."""
    system = fc.System(*sheet, [Push()])
    result = fc.run(system, fc.BackwardEuler(), system.rest(), 0.01, 0.1)
    assert result.energies["kinetic"][-1] > 100 * result.energies["kinetic"][1] > 0


@pytest.mark.parametrize("term", [fc.StVK(), fc.NeoHookean("compressible")], ids=repr)
@pytest.mark.parametrize("method", [fc.CentralDifference(), fc.SymplecticEuler()], ids=repr)
def test_cloth_released_from_a_stretch_stays_stable(sheet, term, method):
    """It is stiffest at another time than at the start: at rest, or when it has sprung back."""
    system = fc.System(*sheet, [term], ["left"])
    start = system.state(1.1 * system.rest().x)
    result = fc.run(system, method, start, t_end=0.3)
    assert abs(result.energies["remainder"]).max() < 0.5 * result.energies["kinetic"].max()
    assert np.diff(result.times).max() < 1.02 * fc.critical_dt(system, system.rest(), method)


# --- terms without a finite stiffness at rest -----------------------------------------------------


def inflated(*terms):
    """A rectangle held at its rim as a dome over 24 litres of gas, and its start."""
    cloth = fc.Cloth.rectangle(1.0, 0.6, h=0.2, pattern="right")
    gas = fc.Gas(101825.0, 0.0243)
    fabric = fc.Fabric(0.2, 500.0, 0.2, bending_rigidity=1e-5)
    system = fc.System(cloth, fabric, [fc.StVK(), gas, *terms], pins=["boundary"])
    X, Y = cloth.X.T
    dome = 0.1 * np.sin(np.pi * X) * np.sin(np.pi * Y / 0.6)
    return system, system.state(np.column_stack([X, Y, dome]))


@pytest.mark.parametrize(
    ("method", "dt"),
    [
        (fc.CentralDifference(), None),
        (fc.SymplecticEuler(), None),
        (fc.CentralDifference(), 1e-6),
        (fc.SymplecticEuler(), 1e-6),
        (fc.Adaptive(fc.CentralDifference()), None),
        (fc.Auto(), None),
    ],
    ids=str,
)
@pytest.mark.parametrize("terms", [[], [fc.HingeBending()], [fc.StrainRateDamping(1e-3)]], ids=str)
def test_gas_is_run_by_every_explicit_method(method, dt, terms):
    """At rest it has no volume, so that its stiffness there is not finite."""
    system, start = inflated(*terms)
    assert not np.isfinite(system.force(system.rest())).all()
    steps = list(fc.march(system, method, start, dt, t_end=5e-5))
    assert steps[-1][1].t == 5e-5
    assert np.isfinite(steps[-1][0].x).all()


def test_a_state_of_no_finite_stiffness_is_an_error_that_names_the_term():
    system, _ = inflated()
    for method in (fc.CentralDifference(), fc.SymplecticEuler()):
        with pytest.raises(SolveFailed, match="Gas has no finite force"):
            fc.stability.estimate(system, system.rest(), method)
        with pytest.raises(SolveFailed, match="the stable step cannot be computed"):
            fc.critical_dt(system, system.rest(), method)


@pytest.mark.parametrize(
    ("dt", "remedy"),
    [(None, "take an implicit method"), (0.0012, "Take a smaller dt")],
    ids=["own steps", "given steps"],
)
def test_where_no_step_follows_a_collapse_the_remedy_is_another_method(dt, remedy):
    """A force draws a stiff plate into a point, in whose folds the limit falls without an end."""
    cloth = fc.Cloth.rectangle(1.0, 1.0, h=0.1)
    draw = fc.UserForce(("-400*(x-0.5)", "-400*(y-0.5)", "-400*z"))
    fabric = fc.Fabric(0.2, 500.0, 0.2, bending_rigidity=1e-3)
    system = fc.System(cloth, fabric, [fc.StVK(), fc.PlateBending(), draw])
    start = system.state(np.column_stack([cloth.X, 0.01 * np.sin(9 * cloth.X[:, 0])]))
    with pytest.raises(fc.StepFailed, match=remedy):
        fc.run(system, fc.CentralDifference(), start, dt, 0.3)
