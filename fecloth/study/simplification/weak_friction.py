"""Whether the friction inside a fabric is small beside its bending."""

import math
from collections.abc import Mapping

import numpy as np

from fecloth.system.system import System
from fecloth.terms import BendingFriction
from fecloth.terms.traits import traits_of

WEAK = 0.1  # of the curvature: HB/B, the curvature that friction may hold


def describe_weak_friction(system: System, columns: Mapping[str, np.ndarray]) -> str:
    """A sentence, if HB/B is below a tenth of the curvature at the end of a run; else \"\"."""
    # The curvature κ is the mean of the energy of bending, W = ½ B κ² per area. HB/B is the largest
    # of all fabrics, along warp or weft.
    if not any(isinstance(term, BendingFriction) for term in system.terms):
        return ""
    pairs = zip(system.names, system.terms, strict=True)
    names = [name for name, term in pairs if traits_of(term).kind == "bending"]
    energy = sum(float(columns[name][-1]) for name in names)
    both = [
        pair
        for f in system.panel.fabrics
        for pair in zip(f.hysteresis or (), f.bending or (), strict=False)
    ]
    held = max((hysteresis / (2 * bending) for hysteresis, bending in both), default=0.0)
    rigidity = system.panel.each(lambda fabric: np.mean(fabric.bending or 0.0))[:, 0]
    total = float(rigidity @ system.cloth.weights.sum(axis=1))
    curvature = math.sqrt(2 * energy / total) if total else 0.0
    if not held < WEAK * curvature:
        return ""
    return (
        f"BendingFriction may be left out: HB/B = {held:.3g}/m is below a tenth of the curvature, "
        f"{curvature:.3g}/m"
    )
