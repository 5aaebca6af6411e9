"""Choose which parameters of a test run in the first layer."""

from collections.abc import Sequence

import pytest

MASSES = ["lumped", "consistent"]


def stories_except(values, *fast):
    """Return the parameters with all but those in `fast` marked for the second layer."""
    return [v if v in fast else pytest.param(v, marks=pytest.mark.stories) for v in values]


def in_turn(*lists: Sequence) -> list[tuple]:
    """Return as many cases as the longest list has values: each value of each list is in one.

    It takes the place of the product where the parameters are served by separate code.
    """
    count = max(map(len, lists))
    return [tuple(values[i % len(values)] for values in lists) for i in range(count)]
