"""Homogenised plane moduli of each model, by pattern and edge length.

    python -m studies.models.homogenised_moduli

The homogenised moduli at rest of a term on an infinite pattern, divided by Y of the fabric. The
moduli of a material depend neither on the edge length nor on the pattern. Baraff and Witkin's
conditions as published do: their stiffness is proportional to the area of a triangle, so that each
halving of h makes the cloth four times as soft. With the square root of the area they are a
material.
"""

from __future__ import annotations

import numpy as np

import fecloth as fc
from studies import harness

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


def main() -> None:
    parser = harness.Parser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="two edge lengths only")
    lengths = (H, H / 2) if parser.parse_args().quick else (2 * H, H, H / 2, H / 4, H / 8)
    print(f"fabric: Y = {Y:g} N/m, nu = {NU:g}; C/Y = {FABRIC.moduli()[:4] / Y}")
    print(f"{'pattern':<12} {'model':<22} {'h [m]':>7}  C11/Y  C22/Y  C12/Y  C33/Y")
    softening = {}
    for pattern in ("right", "cross", "equilateral"):
        for name, term in models(pattern).items():
            rows = [fc.plane_moduli(term, FABRIC, pattern, h) / Y for h in lengths]
            for h, C in zip(lengths, rows, strict=True):
                values = "  ".join(
                    f"{round(c, 3) + 0.0:5.3f}" for c in (C[0, 0], C[1, 1], C[0, 1], C[2, 2])
                )
                print(f"{pattern:<12} {name:<22} {h:>7.4g}  {values}")
            ratio = rows[-1][0, 0] / rows[0][0, 0]
            softening[name] = np.log(ratio) / np.log(lengths[-1] / lengths[0])
    print("exponent of h in C11")
    for name, power in softening.items():
        print(f"  {name:<22} {power + 0.0:5.2f}")


if __name__ == "__main__":
    harness.run_main(main)
