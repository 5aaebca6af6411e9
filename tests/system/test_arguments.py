"""Mistakes in calls are refused at the public functions, with the argument and the remedy."""

import math

import pytest
from support.wrong_calls import BROKEN, FABRIC, OTHER, SYSTEM, V, X, marched

import fecloth as fc
from fecloth.stability import estimate

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
