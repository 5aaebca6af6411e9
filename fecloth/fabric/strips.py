"""Forces of strips over the strain, as all rows of a fabric of Wang et al. (2011) give them.

The constants of these presets are the row of zero strain; see the head of fabrics.toml.
"""

import math
from collections.abc import Sequence

import numpy as np

ALONG = {"warp": 90.0, "weft": 0.0, "45°": 45.0}  # angle of a strip to u, the weft [degrees]
CURVATURES = (0.0, 10.0, 20.0, 30.0, 40.0)  # of the columns of bending [1/m]
END = 1 / 6  # strain of the rows 1 to 5 [-]
STEP = 22.5  # degrees from one of these rows to the next
LEAST = 1e-9  # modulus in place of a negative one [N/m]
ITERATIONS = 60  # each about halves the error

Rows = Sequence[Sequence[float]]


def force(rows: Rows, strain: float, along: str) -> float:
    """Return the force per unstretched width [N/m] of a strip with free sides at the strain ε [-].

    `rows` are the six of `stretching` [N/m], `along` is a key of `ALONG`. The force is λ s at
    the stretch λ = 1 + ε. The second Piola-Kirchhoff stress S = s d dᵀ acts along the strip d
    only, S = C(E) E, and dᵀ E d = (λ² − 1)/2 with Green's strain E. A strip along warp or weft
    does not shear. (Where the rows have c₃₃ < 0 it would shear without force.)
    """
    c = math.cos(math.radians(ALONG[along]))
    s = math.sin(math.radians(ALONG[along]))
    stretch = 1 + strain
    stress = np.array([c * c, s * s, c * s])
    green = (stretch**2 - 1) / 2
    table = np.array(rows)
    E = green * stress  # E11, E22, E12
    for _ in range(ITERATIONS):
        unit = np.linalg.solve(_moduli(table, E), stress)  # the strain for s = 1
        size = green / (unit @ [c * c, s * s, 2 * c * s])
        E = (E + size * unit) / 2
    return float(stretch * size)


def compare(rows: Rows, strain: float, along: str) -> tuple[float, float]:
    """Return `force`, and the force of the constants, the first row, over it, less 1."""
    given = force(rows, strain, along)
    return given, force([rows[0]] * len(rows), strain, along) / given - 1


def _moduli(rows: np.ndarray, E: np.ndarray) -> np.ndarray:
    """Return the matrix [N/m] from (E11, E22, E12) to (S11, S22, S12) where the strain is E.

    It has twice the numbers of a row, which is interpolated by the larger principal strain,
    √(1 + 2E) − 1 from 0 to `END`, and by the angle of its direction to u. Source: ARCSim,
    dde.cpp (`evaluate_stretching_sample`) and physics.cpp (`stretching_force`).
    """
    values, vectors = np.linalg.eigh([[E[0], E[2]], [E[2], E[1]]])
    part = min(max((math.sqrt(1 + 2 * values[1]) - 1) / END, 0.0), 1.0)
    place = math.degrees(math.atan2(abs(vectors[1, 1]), abs(vectors[0, 1]))) / STEP
    i = min(int(place), len(rows) - 3)
    row = (1 - part) * rows[0] + part * ((1 + i - place) * rows[1 + i] + (place - i) * rows[2 + i])
    k0, k1, k2, k3 = 2 * np.maximum(row, LEAST)
    return np.array([[k0, k1, 0.0], [k1, k2, 0.0], [0.0, 0.0, k3]])
