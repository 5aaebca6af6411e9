"""Which methods studies run follows from their traits."""

from fecloth.integrators import studied_by


def test_methods_that_studies_run_by_default():
    usual = ("backward_euler", "bdf2", "implicit_midpoint", "generalized_alpha")
    assert studied_by("chart") == (*usual, "central_difference")
    assert studied_by("stability") == (
        *usual,
        *("energy_momentum", "linearly_implicit_euler", "symplectic_euler", "central_difference"),
    )
