"""Derivatives by parameters against twin runs, over methods, terms, elements and quantities."""

import inspect
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

import fecloth as fc
from fecloth.simulation.derived_loads import find_rest
from fecloth.simulation.energy_ledger import Ledger
from fecloth.simulation.load_steps import LoadSteps
from fecloth.simulation.probes import Observer
from fecloth.simulation.quantity import parse_quantity
from fecloth.simulation.quantity_values import RunRecord, value_of
from fecloth.simulation.run import columns
from fecloth.system.system import System

pytestmark = pytest.mark.stories

TIGHT = fc.Newton(tolerance=1e-12)
PROBES = [fc.Probe("tip", "right")]
CHANGE = 2e-4  # of a parameter, in the finer pair of twin runs


@dataclass(frozen=True)
class Case:
    problem: Callable
    quantities: list[str]
    parameters: str
    dt: float | None = 0.01
    t_end: float | None = 0.1
    tight: float = 1e-6  # relative distance from the twin runs with the tight setting
    h: float = 0.25

    @property
    def values(self) -> dict[str, float]:
        """The parameters, as the problem itself has them."""
        known = inspect.signature(self.problem).parameters
        return {name: known[name].default for name in self.parameters.split()}


def sheet(h: float, element: str = "P1", width: float = 0.5) -> fc.Cloth:
    return fc.Cloth.rectangle(1.0, width, h, pattern="right", element=element)


def swinging(method, membrane, bending=(), **more) -> Callable:
    def problem(h, Y=300.0, B=1e-3, rho=0.2, tau=0.01, drag=0.3, rate=2.0):
        cloth, fabric = sheet(h), fc.Fabric(rho, Y, 0.3, bending_rigidity=B)
        damping = fc.StrainRateDamping(time=tau), fc.MassDamping(rate)
        terms = [membrane, *bending, *damping, fc.Drag(drag), fc.Gravity()]
        system = System(cloth, fabric, terms, pins=["left"], **more)
        x, v = system.rest().x, np.zeros_like(system.rest().x)
        v[:, 2] = 0.5 * x[:, 0] ** 2
        return cloth, system, method, system.state(x, v)

    return problem


def blown(h, Y=300.0, p=3.0, amplitude=0.03):
    cloth, fabric = sheet(h, "P2"), fc.Fabric(0.2, Y, 0.3, bending_rigidity=1e-3)
    terms = [fc.StVK(), fc.PlateBending(), fc.Pressure(p)]
    pin = fc.Pin("left", clamp=True, motion=lambda t: (0, 0, amplitude * np.sin(20 * t)))
    system = fc.System(cloth, fabric, [*terms, fc.Gravity()], pins=[pin])
    return cloth, system, fc.BDF2(), system.rest()


def windy(h, Y=300.0, speed=4.0, normal=1.0):
    cloth, fabric = sheet(h), fc.Fabric(0.2, Y, 0.3)
    wind = fc.Wind((0.5, 0.0, speed), normal)
    system = fc.System(cloth, fabric, [fc.TensionField(), wind, fc.Gravity()], pins=["left"])
    return cloth, system, fc.ImplicitMidpoint(), system.rest()


def crossed(h, Y=300.0, B=1e-3, rho=0.2):
    cloth, fabric = sheet(h), fc.Fabric(rho, Y, bending_rigidity=B)
    terms = [fc.Springs(), fc.QuadraticBending(), fc.Gravity((1.0, 0.0, -9.81))]
    system = fc.System(cloth, fabric, terms, pins=["left"])
    return cloth, system, fc.EnergyMomentum(), system.rest()


def landing(h, Y=300.0, height=0.004, gap=5e-3, rho=0.2):
    """A sheet falls at one side on a ball that moves up; it touches from the first steps on."""
    cloth, fabric = sheet(h), fc.Fabric(rho, Y, 0.3, bending_rigidity=1e-3)
    ball = fc.Obstacle(fc.shapes.Sphere((0.8, 0.25, height - 0.3), 0.3), gap=gap, restitution=1.0)
    terms = [fc.StVK(), fc.PlateBending(), fc.MassDamping(5.0), fc.Gravity(), ball]
    system = fc.System(cloth, fabric, terms, pins=["left"])
    start = system.rest()
    return cloth, system, fc.BackwardEuler(), system.state(start.x + [0.0, 0.0, 0.012])


def adaptive(h, Y=300.0, rho=0.2):
    cloth, system, _, start = swinging(None, fc.StVK(), [fc.PlateBending()])(h, Y=Y, rho=rho)
    return cloth, system, fc.Adaptive(fc.BDF2(), rtol=0.05), start


def hung(h, Y=300.0, B=1e-2, rho=0.2, p=1.0, element="P1", side=9.81):
    cloth, fabric = sheet(h, element), fc.Fabric(rho, Y, 0.3, bending_rigidity=B)
    terms = [fc.StVK(), fc.PlateBending(), fc.Pressure(p), fc.Gravity((0.3 * side, 0.0, -side))]
    system = fc.System(cloth, fabric, terms, pins=[fc.Pin("left", clamp=True)])
    return cloth, system, None, system.rest()


def drawn(h, Y=300.0, nu=0.3, stretch=0.05, p=2.0):
    """A strip between two grips, one of which moves over the load steps."""
    cloth, fabric = sheet(h), fc.Fabric(0.2, Y, nu)
    pins = ["left", fc.Pin("right", motion=lambda t: (stretch * t, 0, 0))]
    system = fc.System(cloth, fabric, [fc.StVK(), fc.Pressure(p)], pins=pins)
    return cloth, system, LoadSteps(2), system.rest()


def inflated(h, Y=300.0, p=50.0):
    cloth, fabric = fc.Cloth.disk(0.5, h), fc.Fabric(0.2, Y, 0.3)
    cloth = fc.Cloth.from_arrays(
        cloth.X,
        cloth.triangles,
        sets={"boundary": cloth.nodes("boundary"), "right": [int(cloth.X[:, 0].argmax())]},
    )
    x = np.column_stack([cloth.X, 0.2 * (0.25 - (cloth.X**2).sum(axis=1))])
    terms = [fc.StVK(), fc.Gas(p, volume=0.1)]
    system = fc.System(cloth, fabric, terms, pins=["boundary"])
    return cloth, system, None, system.state(x)


LUMPED = {"dt": 2e-4, "t_end": 4e-3, "tight": 1e-5}
CASES = {
    "backward_euler": Case(
        swinging(fc.BackwardEuler(), fc.StVK(), [fc.PlateBending()]),
        ["tip.z", "reaction.left.z", "dissipated:Drag", "path of tip"],
        "Y B rho tau drag rate",
    ),
    "bdf2": Case(
        swinging(fc.BDF2(), fc.NeoHookean(), [fc.HingeBending()]),
        ["tip.z", "energy.NeoHookean"],
        "Y B rate",
    ),
    "midpoint": Case(
        swinging(fc.ImplicitMidpoint(), fc.TensorCondition(100.0)),
        ["tip.z", "sag"],
        "rho drag",
    ),
    "newmark": Case(
        swinging(fc.Newmark(), fc.BaraffWitkin()), ["tip.z", "reaction.left.x"], "Y rho"
    ),
    "generalized_alpha": Case(
        swinging(fc.GeneralizedAlpha(), fc.StVK(), [fc.PlateBending()]),
        ["tip.z", "max tip.z"],
        "B tau",
    ),
    "energy_momentum": Case(crossed, ["tip.z", "displacement"], "Y rho"),
    "linearised": Case(swinging(fc.LinearlyImplicitEuler(), fc.StVK()), ["tip.z"], "Y rho"),
    "central_difference": Case(
        swinging(fc.CentralDifference(), fc.StVK()), ["tip.z", "reaction.left.z"], "Y rho", **LUMPED
    ),
    "symplectic_euler": Case(
        swinging(fc.SymplecticEuler(), fc.StVK()), ["tip.z"], "Y rho", **LUMPED
    ),
    "forward_euler": Case(swinging(fc.ForwardEuler(), fc.StVK()), ["tip.z"], "Y rho", **LUMPED),
    "quadratic": Case(blown, ["tip.z", "area"], "Y p amplitude", h=0.5),
    "wind": Case(windy, ["tip.z", "work:Wind"], "Y speed normal"),
    "contact": Case(
        landing,
        ["tip.z", "reaction.Obstacle.z"],
        "Y height gap rho",
        dt=0.005,
        t_end=0.05,
        tight=1e-5,
    ),
    "adaptive": Case(adaptive, ["tip.z"], "Y rho", dt=None),
    "equilibrium": Case(
        hung,
        ["tip.z", "reaction.left.x", "energy.PlateBending"],
        "Y B rho p",
        dt=None,
        t_end=None,
    ),
    "load_steps": Case(
        drawn,
        ["reaction.right.x", "energy.StVK"],
        "Y nu stretch",
        dt=None,
        t_end=1.0,
    ),
    "gas": Case(inflated, ["sag", "volume"], "Y p", dt=None, t_end=None),
}


def twin(case: Case, name: str, value: float, sizes) -> list[float]:
    """The quantities of a run with another value of a parameter, and the same steps."""
    cloth, system, method, start = case.problem(case.h, **{name: value})
    if case.t_end is None:
        state, watch = find_rest(system, start), Observer.bind(system, start, PROBES, shape=True)
        rows = [
            Ledger.open(system, start).row() | watch.row(None, None),
            Ledger.open(system, state).row() | watch.row_at_rest(state),
        ]
        times, table = np.array([0.0, 1.0]), columns(rows)
    else:
        given = method if isinstance(method, LoadSteps) else getattr(method, "method", method)
        if isinstance(method, LoadSteps):
            given, dt, newton = LoadSteps(method.load_steps, tolerance=1e-11), None, None
        else:
            dt, newton = list(sizes), TIGHT
        result = fc.run(system, given, start, dt, case.t_end, newton=newton, probes=PROBES)
        state, times, table = result.state, result.times, {**result.energies, **result.observed}
    fields = {"displacement": state.x - start.x, "velocity": state.v}
    record = RunRecord(times, table, cloth, fields, ("tip",))
    return [value_of(parse_quantity(text), record) for text in case.quantities]


def derivative_by_twins(case: Case, name: str, sizes) -> np.ndarray:
    """Richardson's extrapolation of central differences of two sizes."""
    p = case.values[name]
    slopes = []
    for change in (CHANGE, 2 * CHANGE):
        plus, minus = (twin(case, name, p * (1 + sign * change), sizes) for sign in (1, -1))
        slopes.append((np.array(plus) - np.array(minus)) / (2 * change * p))
    return (4 * slopes[0] - slopes[1]) / 3


@pytest.mark.filterwarnings("ignore::fecloth.errors.FeclothWarning")
@pytest.mark.parametrize("name", CASES)
def test_derivatives_are_those_of_twin_runs(name):
    case = CASES[name]
    run = {"h": case.h, "dt": case.dt, "t_end": case.t_end, "probes": PROBES}
    asked = case.problem, list(case.values), case.quantities
    tight = fc.sensitivity(*asked, tolerance=1e-8, check=False, **run)
    usual = fc.sensitivity(*asked, **run)
    sizes = np.array([])
    if name == "adaptive":
        _, system, method, start = case.problem(case.h)
        steps = fc.march(system, method, start, None, case.t_end, newton=fc.Newton(tolerance=1e-10))
        sizes = [info.size for _, info in steps]
    elif case.dt:
        sizes = np.full(round(case.t_end / case.dt), case.dt)
    changes = np.abs(tight.derivative * list(case.values.values()))
    for i, (parameter, value) in enumerate(case.values.items()):
        exact = derivative_by_twins(case, parameter, sizes)
        # Where a quantity hardly depends on a parameter, twin runs show round-off: there the error
        # is relative to what the largest parameter, or the quantity itself, would change.
        least = np.maximum(changes.max(axis=1), np.abs(tight.value)) / value
        of_tight = np.maximum(np.abs(exact), 1e-3 * least)
        of_usual = np.maximum(np.abs(exact), 1e-2 * least)
        assert (np.abs(tight.derivative[:, i] - exact) <= case.tight * of_tight).all(), parameter
        assert (np.abs(usual.derivative[:, i] - exact) <= 1e-4 * of_usual).all(), parameter
    assert (usual.checked < 2e-3).all()
