"""Fused steps are the steps of `CentralDifference`, to the last bit; so are the ledger's sums."""

import dataclasses

import numpy as np
import pytest

import fecloth as fc
from fecloth.integrators.fused_steps import FusedSteps
from fecloth.simulation.energy_ledger import Ledger

FABRIC = fc.Fabric(
    areal_density=0.2, tensile_stiffness=1000.0, poisson_ratio=0.2, bending_rigidity=1e-3
)
GRAVITY, FIXED = fc.Gravity((1.0, 2.0, -9.0)), ["left"]
SLIDES = ["left", fc.Slide("right", normal=(1.0, 0.5, 0.2))]
MOVED = [
    fc.Pin("left", ["0", "0.1*sin(50*t + 9*Y)*where(t < 0.35, t, 0.35)", "0.1*X*t"]),
    SLIDES[1],
]
LOADS = [
    fc.PointForce([3], (1, 2, 3)),
    fc.UserForce((1, 2, 3.0)),
    fc.Pressure(30.0),
    fc.EdgeForce("right", (1, 2, 3)),
    fc.EdgeForce("top", normal=5.0, follow=True),
]
FORMULAS = [
    fc.EdgeForce("right", normal="3 * t", tangent=1.0),
    fc.EdgeForce("top", ("t", "sin(90*t)", 3), follow=True),
    fc.PointForce("right", ("t", "sin(90*t)", 3)),
    fc.UserForce(("X*t - 2*z", "-0.3*vy", 1.0)),
    fc.Pressure("300*t*cos(70*t)"),
]
PLATE = [fc.PlateBending(), fc.BendingDamping(1e-2)]
CASES = {
    "rates": ([fc.StVK(), fc.StrainRateDamping(1e-4), GRAVITY, fc.MassDamping(3.0)], MOVED, "P1"),
    "loads": ([*LOADS, fc.NeoHookean(), fc.HingeBending(), fc.BendingDamping(1e-3)], FIXED, "P1"),
    "wind": ([fc.Wind((3.0, 1, 2), normal=0.4), fc.StVK(), fc.Drag(normal=0.5)], MOVED, "P1"),
    "air": ([fc.Wind(("3 + z*t", "x", 2), normal=0.4), fc.StVK(), *FORMULAS], MOVED, "P1"),
    "gust": ([fc.Wind((1, "sin(99*t)", 2), 0.4, law="linear"), fc.StVK(), GRAVITY], FIXED, "P1"),
    "plate": ([fc.TensionField(), *PLATE], [fc.Pin("left", clamp=True)], "P1"),
    "springs": ([fc.Springs(), fc.QuadraticBending(), GRAVITY], [], "P1"),
    "conditions": ([fc.BaraffWitkin(), fc.TensorCondition(1.0), GRAVITY], SLIDES, "P1"),
    "curved": ([fc.StVK(), fc.StrainRateDamping(1e-4), *LOADS], MOVED, "P2"),
    "curved formulas": ([fc.StVK(), *FORMULAS], FIXED, "P2"),
    "pointwise": ([fc.StVK(strain="pointwise"), *PLATE, fc.MassDamping(3.0)], SLIDES, "P2"),
}


def moving(terms, pins, element="P1", seed=0):
    cloth = fc.Cloth.rectangle(0.4, 0.3, h=0.1, element=element)
    system = fc.System(cloth, FABRIC, terms, pins, mass="lumped")
    noise = np.random.default_rng(seed)
    x = 1.02 * system.rest().x
    x[:, 2] += 0.02 * noise.normal(size=len(x))
    return system, system.state(x, noise.normal(size=x.shape), t=0.3)


@pytest.mark.parametrize("case", CASES)
def test_bits_and_sums_are_those_of_single_steps(case):
    terms, pins, element = CASES[case]
    system, start = moving(terms, pins, element)
    method, dt, steps = fc.CentralDifference(), 1e-5, 40
    ledgers, infos = [Ledger.open(system, start)], []
    for _, info in fc.march(system, method, start, dt, start.t + steps * dt):
        infos.append(info)
        ledgers.append(ledgers[-1].after(system, method, info.old, info.result))
    first, ledger = ledgers[1], ledgers[-1]
    times = np.array([info.t for info in infos])
    fused, after = FusedSteps.bind(system), infos[0].result
    given = after.state, after.memory, times, np.diff(times), (0, 8), 0.0, np.inf
    taken = fused.take(*given)
    single, flows = infos[-1].result, taken.flows
    end, memory = taken.step.state, taken.step.memory
    assert taken.number == steps - 2
    assert np.array_equal(taken.state.x, infos[-1].old.x)
    assert np.array_equal(taken.step.mean_force(system), single.mean_force(system))
    assert abs(end.x - after.state.x).max() > 1e-4
    for ours, theirs in (
        (end.x, single.state.x),
        (end.v, single.state.v),
        (memory.a, single.memory.a),
        (memory.at.x, single.memory.at.x),
        (memory.at.v, single.memory.at.v),
    ):
        assert np.array_equal(ours, theirs)
    assert (end.t, memory.at.t) == (single.state.t, single.memory.at.t)
    ours, within = first.with_flows(flows), 1e-12 * ledger.kinetic
    for column in ("dissipated", "work"):
        assert getattr(ours, column) == pytest.approx(getattr(ledger, column), rel=0, abs=within)
        assert getattr(ours, column) != getattr(first, column) or not getattr(first, column)
    assert (ours.pins, ours.numerical) == pytest.approx(
        (ledger.pins, ledger.numerical), rel=0, abs=within
    )


def rows_of(system, start, dt, seconds, rows, **options):
    method = fc.CentralDifference()
    return fc.run(system, method, start, dt, start.t + seconds, rows=rows, **options)


@pytest.mark.stories
@pytest.mark.parametrize("pins", [FIXED, MOVED])
@pytest.mark.parametrize("dt", [1e-4, None])
@pytest.mark.filterwarnings("ignore::fecloth.FeclothWarning")
def test_rows_of_a_run_are_those_of_a_run_with_more_rows(dt, pins):
    """With fixed and with stable steps, which change when the cloth stretches, and stops."""
    system, start = moving([fc.StVK(), fc.StrainRateDamping(1e-5), GRAVITY], pins)
    stops = {"stops": [0.3333, 0.345]}
    seconds = 0.06 if dt else 0.4
    full = rows_of(system, start, dt, seconds, 10**6, **stops)
    few = rows_of(system, start, dt, seconds, 20, **stops)
    assert full.steps == few.steps == len(full.times) - 1
    assert len(few.times) < 0.7 * len(full.times)
    assert np.isin(stops["stops"], few.times).all()
    assert np.array_equal(full.state.x, few.state.x)
    assert few.time_error == pytest.approx(full.time_error, rel=1e-9)
    advice = [[(doubt.kind, doubt.remedy) for doubt in run.doubts] for run in (full, few)]
    assert advice[0] == advice[1]  # the step at which a balance was off for ten rows differs
    at = np.searchsorted(full.times, few.times)
    assert np.array_equal(full.times[at], few.times)
    for name, column in few.observed.items():
        assert np.array_equal(column, full.observed[name][at], equal_nan=True)
    within = 1e-12 * full.energies["kinetic"].max()
    for name, column in few.energies.items():
        np.testing.assert_allclose(column, full.energies[name][at], rtol=0, atol=within)


def test_what_needs_python_is_not_fused():
    wind = fc.Wind(lambda x, t: (t, 0, 1), normal=0.4)
    gusts = fc.Wind((1.0, 0, 1), normal=0.4, gusts=0.1)
    turned = fc.Pin("left", rotate=fc.Rotation((0, 0, 0), (1, 0, 0), "t"))
    condition = fc.Condition(lambda y: y[:, 1, 2] - y[:, 0, 2], [(0, 1)], 10.0)
    for terms, pins in (
        ([fc.StVK(), wind], FIXED),
        ([fc.StVK(), gusts], FIXED),
        ([fc.StVK(), fc.PointForce("right", lambda t: (t, 0, 0))], FIXED),
        ([fc.StVK(), fc.Pressure(lambda t: t)], FIXED),
        ([fc.StVK(), fc.UserForce(lambda x, v, t: -x)], FIXED),
        ([fc.StVK(), fc.Tether("right", (0, 0, 1.0), 10.0)], FIXED),
        ([fc.StVK(), condition], FIXED),
        ([fc.StVK()], [turned]),
    ):
        assert FusedSteps.bind(moving(terms, pins)[0]) is None
    system, start = moving([fc.StVK()], [turned])
    assert len(rows_of(system, start, 1e-5, 2e-4, 2).times) == 21


def test_a_force_whose_class_overrides_only_add_force_is_not_fused():
    system, _ = moving([fc.StVK()], FIXED)
    (membrane,) = system.bound

    class Weaker(type(membrane)):
        def add_force(self, x, v, t, f):
            pass

    assert FusedSteps.bind(system)
    own = {field.name: getattr(membrane, field.name) for field in dataclasses.fields(membrane)}
    assert FusedSteps.bind(system.with_bound([Weaker(**own)])) is None
