"""Nylon strips of Farrell et al. (2025), drawn at five angles to the grain.

A strip is `nylon.toml`: 2.25 mm wide, drawn between clamps. Measured is one curve an angle
([data](data/README.md)), of twelve strips together, without a scatter; 2 % of the largest force of
each curve is assumed for each point. The first point of each curve is not at zero force, so that
each strip has a slack of its own. Poisson's ratio is 0, as forces of slender strips tell only
1/G − 2 ν/Y₁.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

import fecloth as fc
from studies.validation import pages

SCENE = Path(__file__).with_suffix(".toml")
ANGLES = 0, 30, 45, 75, 90
SIGMA = "2 %"  # of the largest force: assumed, as none was published
START = {
    "fabric.tensile_stiffness.0": 2e4,
    "fabric.tensile_stiffness.1": 4e4,
    "fabric.shear_stiffness": 2e3,
}
STRIPS = 12  # that were drawn together
REACH = 6e-3  # of the grip, beyond the last points [m]
STEPS, FEW = 12, 3  # of the pull; few in the quick form
QUICK = "cloth.element=P1", "cloth.h=0.0045"


@dataclass(frozen=True)
class Strip:
    """A measured curve in SI, of one strip."""

    angle: int
    extension: np.ndarray
    force: np.ndarray

    @classmethod
    def read(cls, angle: int) -> Strip:
        columns = pages.read_columns(pages.DATA / f"farrell_2025_tension_{angle:02d}.csv")
        return cls(angle, 1e-3 * columns["extension [mm]"], columns["force [N]"] / STRIPS)

    def experiment(self, steps: int, fitted: bool) -> fc.Experiment:
        """What `fc.fit` compares: force over extension, with a slack of its own."""
        keys = [f"grain_degrees={self.angle:.1f}", f"equilibrium.load_steps={steps}"]
        keys.append(f'pins.1.motion=["{REACH} * t", "0", "0"]')
        keys += QUICK if steps == FEW else ()
        return fc.Experiment(
            pages.scene_with(SCENE, keys),
            {"extension [m]": self.extension.tolist(), "force [N]": self.force.tolist()},
            {"force": "reaction.grip.x"},
            {"extension": "grip.x"},
            sigma=SIGMA,
            offset=True,
            name=f"{self.angle}°",
            fitted=fitted,
        )
