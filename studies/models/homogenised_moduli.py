"""The membrane models of the studies, matched to one fabric.

Baraff and Witkin's conditions as published are no material: their stiffness is proportional to the
area of a triangle, so that each halving of h makes the cloth four times as soft. With the square
root of the area they are one.
"""

from __future__ import annotations

import numpy as np

import fecloth as fc

Y, NU, H = 1000.0, 0.3, 0.1  # N/m, -, m: where the published conditions are matched
FABRIC = fc.Fabric(areal_density=0.2, tensile_stiffness=Y, poisson_ratio=NU)


def published(pattern: str) -> fc.BaraffWitkin:
    """Return Baraff and Witkin's conditions with the tensile stiffness Y at the edge length H."""
    a = np.median(fc.Cloth.rectangle(4 * H, 4 * H, H, pattern).weights.sum(axis=1))
    return fc.BaraffWitkin((Y / a, Y / a), FABRIC.shear / a, area_exponent=1.0)


def models(pattern: str) -> dict[str, object]:
    return {
        "StVK": fc.StVK(),
        "TensorCondition": fc.TensorCondition(Y / 4),
        "BaraffWitkin p = 1/2": fc.BaraffWitkin(),
        "BaraffWitkin p = 1": published(pattern),
        "Springs structural": fc.Springs(),
        "Springs van_gelder": fc.Springs(kind="van_gelder"),
        "Springs biquadratic": fc.Springs(kind="biquadratic"),
    }
