"""Choose which parameters of a test run in the fast tier."""

import pytest


def slow_except(values, *fast):
    """Return the parameters with all but those in `fast` marked as slow."""
    return [v if v in fast else pytest.param(v, marks=pytest.mark.slow) for v in values]
