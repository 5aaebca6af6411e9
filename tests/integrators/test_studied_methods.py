"""Which methods studies run, and in which order, follows from their traits."""

from fecloth.study.tuning.choices import _preference

from fecloth.integrators import studied_by


def test_methods_that_studies_run_by_default():
    usual = ("backward_euler", "bdf2", "implicit_midpoint", "generalized_alpha")
    assert studied_by("chart") == (*usual, "central_difference")
    assert studied_by("stability") == (
        *usual,
        *("energy_momentum", "linearly_implicit_euler", "symplectic_euler", "central_difference"),
    )


def test_tune_prefers_explicit_methods_then_those_that_damp():
    assert sorted(studied_by("tune"), key=_preference) == [
        *("central_difference", "bdf2", "generalized_alpha", "implicit_midpoint"),
        "backward_euler",
        "linearly_implicit_euler",
    ]
