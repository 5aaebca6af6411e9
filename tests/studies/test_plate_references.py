"""The references of the bending study against published figures and other closed forms."""

import numpy as np
import pytest
from support.plates import navier

from studies.references import plates

D = np.array([[1.0, 0.3, 0.0], [0.3, 1.0, 0.0], [0.0, 0.0, 0.35]])
ORTHOTROPIC = np.array([[4.0, 0.4, 0.0], [0.4, 1.0, 0.0], [0.0, 0.0, 0.6]])


def test_ritz_agrees_with_timoshenko_navier_and_leissa():
    """Timoshenko and Woinowsky-Krieger (1959), table 35; Leissa (1973): 13.468, 19.596, 24.271."""
    centre, X = np.array([[0.5, 0.5]]), np.random.default_rng(0).random((20, 2))
    w = plates.square_deflection(centre, D, "clamped")
    assert w == pytest.approx([0.00126532], rel=1e-5)
    supported = plates.square_deflection(X, ORTHOTROPIC, "supported")
    assert supported == pytest.approx(navier(X, ORTHOTROPIC, 200), rel=1e-5)
    rates = plates.square_frequencies(D, "free", 3)
    assert rates == pytest.approx([13.4682, 19.5961, 24.2702], rel=1e-5)


@pytest.mark.parametrize("at", [0.5, 0.3])
def test_beam_of_two_parts_bends_by_its_moment(at):
    X = np.linspace(0, 1, 1001)
    w = plates.beam_of_two(X, 1.0, 10.0, at)
    curvature = -np.diff(w, 2) / (X[1] - X[0]) ** 2
    exact = 0.5 * X * (1 - X) / np.where(at > X, 1.0, 10.0)
    away = np.abs(X[1:-1] - at) > 2e-3
    assert w[[0, -1]] == pytest.approx(0, abs=1e-15)
    assert curvature[away] == pytest.approx(exact[1:-1][away], abs=1e-6)
    slope = np.diff(w) / (X[1] - X[0])
    assert np.abs(np.diff(slope)).max() < 2e-4  # no corner at the seam
