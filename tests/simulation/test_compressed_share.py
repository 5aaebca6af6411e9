"""The part of a cloth that is compressed, from the stress in its triangles."""

import numpy as np
import pytest

import fecloth as fc
from fecloth.simulation.shapes import compressed_share


def test_a_triangle_with_a_negative_principal_stress_is_compressed():
    cloth = fc.Cloth.rectangle(1.0, 1.0, h=1.0, pattern="right")
    system = fc.System(cloth, fc.Fabric(0.2, 200.0, 0.3), [fc.StVK()])
    first = np.arange(len(cloth.triangles)) == 0
    # Principal stress of the first triangle: 2 and −1 N/m; of the others 2 and 1 N/m.
    cells = {"S11": np.full(len(first), 2.0), "S22": np.where(first, -1.0, 1.0)}
    cells["S12"] = np.zeros(len(first))
    share = cloth.weights.sum(axis=1)[first].sum() / cloth.weights.sum()
    assert compressed_share(system, cells) == pytest.approx(share)
    # The same by shear: mean 0.5, radius 1.5 N/m.
    sheared = {"S11": np.full(len(first), 0.5), "S22": np.full(len(first), 0.5)}
    sheared["S12"] = np.where(first, 1.5, 0.0)
    assert compressed_share(system, sheared) == pytest.approx(share)
