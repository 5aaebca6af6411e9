"""Mistakes in calls are refused at the public functions, with the argument and the remedy."""

import math

import numpy as np
import pytest
from support.messages import message_test

import fecloth as fc
from fecloth.simulation.resolve import solver_for
from fecloth.stability import amplification, estimate

CLOTH = fc.Cloth.rectangle(0.6, 0.3, h=0.15, pattern="right")
FABRIC = fc.Fabric(areal_density=0.2, tensile_stiffness=100.0)
SYSTEM = fc.System(CLOTH, FABRIC, [fc.StVK(), fc.Gravity()], pins=["left"])
START = SYSTEM.rest()
OTHER = fc.Cloth.rectangle(0.6, 0.3, h=0.3, pattern="right")
X, V = START.x, START.v
BROKEN = X.copy()
BROKEN[3, 1] = np.nan


BDF2 = fc.BDF2()


def marched(system=SYSTEM, method=BDF2, state=START, dt=0.01, t_end=0.02, **options):
    return fc.run(system, method, state, dt, t_end, **options)


BAD_STATES = [
    (None, "state = None: must be a State such as system.rest"),
    (X, "state = a ndarray: must be a State"),
    (SYSTEM.rest, "state = the function System.rest, which is not called: must be a State"),
    (fc.System(OTHER, FABRIC, []).rest(), r"state.x of shape \(6, 3\): must be \(15, 3\)"),
    (fc.State(0.0, X[:4], V[:4]), r"state.x of shape \(4, 3\)"),
    (fc.State(0.0, X.tolist(), V), r"state.x = a list: must be an array.*system.state\(x, v\)"),
    (fc.State("0", X, V), "state.t = '0': must be a finite number"),
    (fc.State(math.nan, X, V), "state.t = nan"),
    (fc.State(0.0, BROKEN, V), r"state.x\[3\] = .*nan.*: must be finite"),
    (fc.State(0.0, X, BROKEN), r"state.v\[3\] = .*nan"),
]
CALLS = {
    "run": lambda state: marched(state=state),
    "march": lambda state: next(fc.march(SYSTEM, fc.BDF2(), state, 0.01, 0.02)),
    "critical_dt": lambda state: fc.critical_dt(SYSTEM, state, "central_difference"),
    "estimate": lambda state: estimate(SYSTEM, state, fc.CentralDifference()),
    "equilibrium": lambda state: fc.equilibrium(SYSTEM, state),
    "many_steps": lambda state: fc.many_steps(SYSTEM, state, 1e-4, 2),
}


@pytest.mark.parametrize("call", CALLS)
@pytest.mark.parametrize(("state", "message"), BAD_STATES, ids=range(len(BAD_STATES)))
def test_states_that_are_not_of_the_system_are_refused(call, state, message):
    with pytest.raises(fc.InputError, match=message) as error:
        CALLS[call](state)
    assert str(error.value).startswith("march" if call == "run" else call)


MISTAKES = [
    (lambda: marched(system=None), "march: system = None: must be a System"),
    (lambda: marched(system=CLOTH), "march: system = a Cloth: must be a System"),
    (lambda: marched(method=START, state=fc.BDF2()), "method comes before the state"),
    (lambda: marched(method=fc.BDF2), "method the class BDF2, which is not called"),
    (lambda: fc.critical_dt(START, SYSTEM), "critical_dt: .*The state comes second"),
    (lambda: fc.equilibrium(START, SYSTEM), "equilibrium: .*The state comes second"),
    (lambda: marched(newton={"tolerance": 1e-8}), r"newton = .*: must be such as Newton\("),
    (lambda: marched(newton=1e-8), "newton = 1e-08: must be such as"),
    (lambda: marched(newton=fc.Newton), "newton = the class Newton, which is not called"),
    (lambda: fc.Newton(tolerance="a"), "tolerance = 'a': must lie in"),
    (lambda: fc.Newton(forcing=None), "forcing = None: must lie in"),
    (lambda: fc.Newton(max_iterations=2.5), "max_iterations = 2.5: must be an integer >= 1"),
    (lambda: marched(most_growth=-1), "most_growth = -1: must be a finite number > 0"),
    (lambda: marched(most_growth="a"), "most_growth = 'a'"),
    (lambda: marched(most_stretch=0.9), "most_stretch = 0.9: must be a finite number > 1"),
    (lambda: marched(most_stretch="x"), "most_stretch = 'x'"),
    (lambda: solver_for(SYSTEM, fc.BDF2(), math.inf), "dt = inf: must be a finite number > 0"),
    (lambda: marched(report=3), "report = 3: must be a function, as in lambda info"),
    (lambda: fc.equilibrium(SYSTEM, START, report="x"), "report = 'x': must be a function"),
    (lambda: marched(stops=["a"]), r"stops = \['a'\]: must be numbers"),
    (lambda: marched(stops=[0.01, 0.9]), "stops: 0.9: must lie in the run, from 0 to 0.02 s"),
    (lambda: marched(stops=[-0.01]), "stops: -0.01: must lie in the run"),
    (lambda: marched(dt=True), "dt = True: must be a number"),
    (lambda: solver_for(SYSTEM, fc.BDF2(), -1), "dt = -1: must be a finite number > 0"),
    (lambda: fc.many_steps(SYSTEM, START, "x", 2), "dt = 'x': must be a finite number > 0"),
    (lambda: estimate(SYSTEM, START, fc.CentralDifference(), tol=-1), "tol = -1"),
    (lambda: fc.critical_dt(SYSTEM, START, None), "method = None: must be a method of one step"),
    (lambda: fc.critical_dt(SYSTEM, START, "CentralDifference"), "mean 'central_difference'"),
    (lambda: amplification("bdf", 1.0), "Did you mean 'bdf2'"),
    (lambda: amplification(fc.BDF2, "a"), "omega_dt = 'a': must be numbers"),
    (lambda: amplification(fc.BDF2, [1.0, -2.0]), "omega_dt = -2: must be finite and > 0"),
    (lambda: amplification(fc.BDF2, 1.0, -0.1), "zeta = -0.1: must be finite and >= 0"),
    (lambda: amplification(fc.BDF2, [1, 2], [0, 1, 2]), r"of shape \(2,\), zeta of shape \(3,\)"),
    (lambda: fc.Auto(rtol=-1), "^Auto: rtol = -1: must be a number >= 0"),
    (
        lambda: fc.Adaptive(fc.ForwardEuler()),
        "method ForwardEuler.*: has no stable step",
    ),
    (
        lambda: marched(solver=3),
        "solver = 3: must be one of auto, direct, pardiso, rslab, superlu, pcg, mult",
    ),
    (lambda: marched(method=fc.EnergyMomentum("exact"), solver="pcg"), 'tangent = "symmetric"'),
    (lambda: marched(method=fc.CentralDifference(), dt="auto"), "'auto'.*Leave it out for the lar"),
    (lambda: SYSTEM.state("a"), "System.state: x = 'a': must be numbers"),
    (lambda: SYSTEM.state(X, t="a"), "System.state: t = 'a'"),
    (lambda: fc.write_vtk("w", SYSTEM, START), "write_vtk: cloth = .*: must be such as system.cl"),
    (lambda: fc.read_frame("w.vtu", SYSTEM), "read_frame: cloth = .*: must be such as system.cl"),
]


test_arguments_that_are_swapped_or_of_another_type = message_test(MISTAKES)
