"""A strip clamped at one end under its own weight against the heavy elastica, by pattern.

With s along the strip in units of its length L, φ(s) the angle below the horizontal and
Γ = ρ g L³/B, balance of moments gives φ'' = −Γ (1 − s) cos φ, φ(0) = 0, φ'(1) = 0. The strip is one
cell wide (two rows of `equilateral`) and free at its long edges, so its B_eff is the pattern's
1/(D⁻¹)₁₁ (`bending_tensor`). It is narrow against √(12 B/Y): then neither the clamp keeps it from
curving across, nor does the twist that `right` couples to bending lift it out of its plane.
"""

import numpy as np
import pytest
import scipy.sparse.linalg

import fecloth as fc
from studies.references.elastica import heavy_elastica

# steps are coarse and meshes small by intent
pytestmark = pytest.mark.filterwarnings("ignore::fecloth.errors.FeclothWarning")

LENGTH, DENSITY, G = 1.0, 0.1, 9.81
CELLS = 100  # along the strip


def hanging(pattern, gamma, bending):
    """Reach and drop of the tip of a strip of B = ρ g L³/Γ at rest, in units of its length.

    Two columns of nodes are held: the slope is zero half-way between them, and from there the
    length counts.
    """
    h = LENGTH / (CELLS - 0.5)
    width = {"right": h, "cross": h, "equilateral": 2 * h * np.sqrt(0.75)}[pattern]
    B = DENSITY * G * LENGTH**3 / gamma
    Y = 12 * B / (0.02 * LENGTH) ** 2  # its weight stretches it by 0.3 % at most
    cloth = fc.Cloth.rectangle(CELLS * h, width, h, pattern)
    fabric = fc.Fabric(DENSITY, Y, bending_rigidity=B)
    clamp = fc.Pin(lambda X: X[:, 0] < 1.01 * h)
    terms = [fc.StVK(), bending, fc.Gravity((0, 0, -G))]
    system = fc.System(cloth, fabric, terms, pins=[clamp])
    state = fc.equilibrium(system, system.rest())
    tip = state.x[cloth.nodes("right")].mean(axis=0)
    return (tip[0] - 0.5 * h) / LENGTH, -tip[2] / LENGTH


@pytest.mark.parametrize(
    ("bending", "pattern", "gamma"),
    [
        (fc.HingeBending(), "right", 1.0),
        (fc.HingeBending(), "cross", 10.0),
        (fc.HingeBending(), "equilateral", 100.0),
        # not `right` at 100: B/(Y h²) = 1/3 here, so that the quadratic form stiffens its twist
        (fc.QuadraticBending(), "right", 1.0),
        (fc.QuadraticBending(), "cross", 10.0),
        (fc.QuadraticBending(), "equilateral", 100.0),
    ],
)
def test_heavy_elastica(bending, pattern, gamma):
    effective = 1 / np.linalg.inv(fc.bending_tensor(pattern))[0, 0]
    _, reach, drop = heavy_elastica(gamma / effective)
    assert hanging(pattern, gamma, bending) == pytest.approx((reach[-1], drop[-1]), rel=0.03)


# B_eff/B of a cantilever in small deflection, at width/length 0.25 and 2, as in `HingeBending`
BIAS = {
    "right": (0.83, 0.92),
    "cross": (1.11, 1.29),
    "equilateral": (0.93, 0.99),
    "unstructured": (0.93, 0.98),
}


@pytest.mark.parametrize("pattern", BIAS)
def test_bias_of_a_cantilever(pattern):
    """The table of `HingeBending`: its stiffness at flat, from ρ g L⁴/(8 w) at the tip."""
    for width, bias in zip((0.25, 2.0), BIAS[pattern], strict=True):
        h = 1.0 / 40
        cloth = fc.Cloth.rectangle(1.0 + h, width, h, pattern)
        system = fc.System(
            cloth, fc.Fabric(1.0, 1.0, bending_rigidity=1.0), [fc.QuadraticBending()]
        )
        held = cloth.X[:, 0] < 1.01 * h
        free = np.flatnonzero(~held)
        K = system.bound[0].matrix[free][:, free].tocsc()
        w = scipy.sparse.linalg.spsolve(K, system.nodal_mass[free])
        tip = w[np.isclose(cloth.X[free, 0], 1.0 + h)].mean()
        assert (1.0 + 0.5 * h) ** 4 / (8 * tip) == pytest.approx(bias, abs=0.02)
