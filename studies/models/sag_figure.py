"""Finite elements against springs in one figure: the mean sag of a square under its weight.

The square of 1 m is pinned along its whole border. `StVK` converges to one sag on every pattern of
triangles. Springs on edges converge as well, but to sags that depend on the pattern: the network
itself is another material.

    python -m studies.models.sag_figure [--quick] [--out DIR]
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

import fecloth as fc
from fecloth import study
from studies import harness

FABRIC = fc.Fabric(areal_density=0.2, tensile_stiffness=1000.0, poisson_ratio=0.3)
MODELS = {
    "StVK": fc.StVK(),
    "structural springs": fc.Springs("structural"),
    "van Gelder's springs": fc.Springs("van_gelder"),
}
PATTERNS = ("right", "cross", "equilateral")


def mean_sag(term, pattern: str, h: float) -> float:
    """Return the mean sag [mm] of the square at rest, meshed with edges of h [m]."""
    cloth = fc.Cloth.rectangle(1.0, 1.0, h=h, pattern=pattern)
    border = np.flatnonzero((np.abs(cloth.X - 0.5) > 0.5 - 1e-9).any(axis=1))
    system = fc.System(cloth, FABRIC, [term, fc.Gravity()], [fc.Pin(border)])
    return -1000 * cloth.load() @ fc.equilibrium(system, system.rest()).x[:, 2] / cloth.area


def main() -> None:
    parser = harness.Parser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="two coarse meshes, into out/models")
    parser.add_argument("--out", type=Path, help="folder of the figure")
    options = parser.parse_args()
    out = options.out or (Path("out/models") if options.quick else Path(__file__).parent)
    sizes = (0.2, 0.1) if options.quick else (0.2, 0.1, 0.05, 0.025)
    words = "edge length h [m]", "mean sag [mm]", "A square under its weight"
    with harness.figure(out, "sag", *words, log=False) as (_, ax):
        for i, (name, term) in enumerate(MODELS.items()):
            for j, pattern in enumerate(PATTERNS):
                sags = [mean_sag(term, pattern, h) for h in sizes]
                dash = ("-", "--", ":")[j]
                ax.plot(
                    sizes, sags, **study.line_style(i) | {"ls": dash}, label=f"{name}, {pattern}"
                )
                print(f"{name:<21} {pattern:<12} {sags[-1]:.3f} mm at h = {sizes[-1]} m")
        ax.set_xscale("log")
        ax.legend(fontsize=8, ncols=1, loc="center left", bbox_to_anchor=(1, 0.5))
    print(f"wrote {out}/sag.png")


if __name__ == "__main__":
    harness.run_main(main)
