"""`PlateBending` beside Morley's element of scikit-fem, on the same mesh under the same load."""

import numpy as np
import pytest
from support.plates import BENDING, deflection, on_sides, square, uniform_load

import fecloth as fc
from studies.references import morley, plates

GRAIN = 0.4
ISOTROPIC = fc.Fabric(**BENDING, bending_poisson_ratio=0.3)
ORTHOTROPIC = fc.Fabric(1.0, 1e3, bending_rigidity=(4.0, 1.0), bending_poisson_ratio=0.2)


def turned(D, angle):
    """(3, 3) D on (κ₁₁, κ₂₂, 2κ₁₂) along X and Y of a fabric whose warp lies at the angle."""
    c, s = np.cos(angle), np.sin(angle)
    R = np.array([[c, -s], [s, c]])
    columns = []
    for kappa in ([[1, 0], [0, 0]], [[0, 0], [0, 1]], [[0, 0.5], [0.5, 0]]):
        own = R.T @ np.array(kappa) @ R
        columns.append([own[0, 0], own[1, 1], 2 * own[0, 1]])
    T = np.transpose(columns)
    return T.T @ D @ T


@pytest.mark.stories
@pytest.mark.parametrize(
    ("pattern", "edges", "fabric"),
    [
        ("right", "supported", ISOTROPIC),
        ("cross", "clamped", ORTHOTROPIC),
        ("unstructured", "supported", ORTHOTROPIC),
        ("unstructured", "clamped", ISOTROPIC),
    ],
)
def test_plate_and_morley_approach_each_other(pattern, edges, fabric):
    """Their distance falls with h², and both approach Ritz's solution."""
    D = turned(fabric.plate(), GRAIN)
    apart, errors = [], []
    for n in (16, 32):
        cloth = square(pattern, n)
        clamp = edges == "clamped"
        pins = [fc.Pin(on_sides, clamp=clamp)]
        system = fc.System(cloth, fabric, [fc.PlateBending()], pins, grain=GRAIN)
        w = deflection(system, uniform_load(cloth))
        each = np.broadcast_to(D, (len(cloth.triangles), 3, 3))
        other = morley.deflection(cloth.X, cloth.triangles, each, on_sides(cloth.X), clamp)
        exact = plates.square_deflection(cloth.X, D, edges)
        apart.append(abs(w - other).max() / other.max())
        errors.append([abs(each - exact).max() / exact.max() for each in (w, other)])
    assert apart[1] < 0.012
    assert 1.8 < np.log2(apart[0] / apart[1]) < 2.2
    assert errors[1][0] < errors[1][1] < 0.025
