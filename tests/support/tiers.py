"""Choose which parameters of a test run in the first layer."""

import pytest


def stories_except(values, *fast):
    """Return the parameters with all but those in `fast` marked for the second layer."""
    return [v if v in fast else pytest.param(v, marks=pytest.mark.stories) for v in values]
