"""Forces of strips over the strain, as all rows of a fabric of Wang et al. (2011) give them.

The constants of these presets are the row of zero strain; see the head of fabrics.toml.
"""

import math
from collections.abc import Sequence

import numpy as np

ALONG = {"warp": 90.0, "weft": 0.0, "45°": 45.0}  # angle of a strip to u, the weft [degrees]
CURVATURES = range(0, 50, 10)  # of the columns of bending [1/m]
END = 1 / 6  # strain of the rows 1 to 5 [-]
LEAST_MODULUS = 1e-9  # in place of negative moduli [N/m]; all others are far above it
HALVINGS = 60  # iterations that each about halve the error, down to round-off

Rows = Sequence[Sequence[float]]


def force(rows: Rows, strain: float, along: str) -> float:
    """Return the force per unstretched width [N/m] of a strip with free sides.

    Its moduli C depend on the strain E. So E is found by fixed-point iteration.

    The second Piola-Kirchhoff stress S = s d dᵀ acts only along the direction d of the strip.
    S = C(E) E with Green's strain E, and dᵀ E d = (λ² − 1)/2 at the stretch λ = 1 + ε. The
    force is λ s. A strip along warp or weft does not shear. (Where the rows have c₃₃ < 0 it
    would shear without force.)

    Parameters
    ----------
    rows
        The six rows of `stretching` [N/m].
    strain
        ε of the strip [-].
    along
        A key of `ALONG`.
    """
    c = math.cos(math.radians(ALONG[along]))
    s = math.sin(math.radians(ALONG[along]))
    stretch = 1 + strain
    unit_stress = np.array([c * c, s * s, c * s])  # S11, S22, S12 for s = 1
    green = (stretch**2 - 1) / 2
    table = np.array(rows)
    E = green * unit_stress  # E11, E22, E12: a first guess, as if nothing contracted across
    for _ in range(HALVINGS):
        unit_strain = np.linalg.solve(_moduli(table, E), unit_stress)  # the strain for s = 1
        stress = green / (unit_strain @ [c * c, s * s, 2 * c * s])  # s, so that dᵀ E d is green
        E = (E + stress * unit_strain) / 2  # the mean with the last E, which damps the iteration
    return float(stretch * stress)


def compare(rows: Rows, strain: float, along: str) -> tuple[float, float]:
    """Return the force by all rows, and the relative error of the force by the first row alone.

    The first row has the constants of the preset. Arguments are as in `force`.
    """
    by_all = force(rows, strain, along)
    by_constants = force([rows[0]] * len(rows), strain, along)
    return by_all, by_constants / by_all - 1


def _moduli(rows: np.ndarray, E: np.ndarray) -> np.ndarray:
    """Return the matrix [N/m] from (E11, E22, E12) to (S11, S22, S12) where the strain is E.

    It has twice the numbers of a row, see the head of fabrics.toml. This row is interpolated
    between rows[0] at zero strain and rows[1:] at the strain `END`, by the larger principal
    strain √(1 + 2E) − 1. The angle of its direction to u goes from 0° at rows[1] to 90° at the
    last row, in equal steps. Source: ARCSim, dde.cpp (`evaluate_stretching_sample`) and
    physics.cpp (`stretching_force`).
    """
    values, vectors = np.linalg.eigh([[E[0], E[2]], [E[2], E[1]]])  # the larger one is the last
    # Below zero strain and beyond `END` the moduli stay as they are there.
    fraction = min(max((math.sqrt(1 + 2 * values[1]) - 1) / END, 0.0), 1.0)
    angle = math.degrees(math.atan2(abs(vectors[1, 1]), abs(vectors[0, 1])))
    rows_at_end = rows[1:]
    intervals = len(rows_at_end) - 1
    place = angle / (90 / intervals)  # the angle in intervals between two rows
    i = min(int(place), intervals - 1)  # the row before the angle, at 90° the last but one
    row_at_end = (1 + i - place) * rows_at_end[i] + (place - i) * rows_at_end[i + 1]
    row = (1 - fraction) * rows[0] + fraction * row_at_end
    k0, k1, k2, k3 = 2 * np.maximum(row, LEAST_MODULUS)
    return np.array([[k0, k1, 0.0], [k1, k2, 0.0], [0.0, 0.0, k3]])
