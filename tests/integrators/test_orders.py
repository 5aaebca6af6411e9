"""The order in dt of every registered method on the problems of studies/references."""

import numpy as np
import pytest
from support.tiers import stories_except

from fecloth.verify import observed_order
from studies.references.time_problems import CASES, pendulum, swing, wave


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize(
    "problem", stories_except([pendulum, wave, swing], pendulum), ids=lambda p: p.__name__
)
def test_order(problem, name, record_property):
    task, method = problem(), CASES[name]
    errors = [task.error(method, steps) for steps in task.steps]
    order = observed_order(1 / np.array(task.steps), errors)[0]
    record_property("errors", errors)
    print(f"{problem.__name__} {name}: order {order:.3f}, errors {errors[0]:.1e} {errors[1]:.1e}")
    assert order == pytest.approx(method.traits.order, abs=0.15)
