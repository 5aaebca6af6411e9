"""Tests on values that Hypothesis draws. It is imported when such a test runs, not before."""

from collections.abc import Callable


def drawn(strategies: Callable, **options):
    """Run a test for values of the strategies that ``strategies(hypothesis.strategies)`` lists.

    The test has one parameter for each strategy and no fixtures. `options` are settings of
    Hypothesis.
    """

    def decorate(check):
        def test():
            import hypothesis

            options_of_test = hypothesis.settings(deadline=None, **options)
            options_of_test(hypothesis.given(*strategies(hypothesis.strategies))(check))()

        test.__name__, test.__doc__ = check.__name__, check.__doc__
        return test

    return decorate
