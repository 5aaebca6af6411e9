"""fecloth's springs along the edges of triangles (Van Gelder, 1998), solved as `fecloth_p1` is."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

import fecloth as fc
from studies.engines import fecloth_p1

VERSION = fc.__version__
SETTINGS = 'Springs(kind="van_gelder"), PlateBending; the rest as fecloth_p1'


def run(case: Mapping[str, Any]) -> np.ndarray:
    """Return the positions (times, n, 3) [m] of a net of springs."""
    warp, weft = case["fabric"]["tensile_stiffness"]
    if warp != weft:
        raise NotImplementedError("springs of Van Gelder have one stiffness for warp and weft")
    return fecloth_p1.solve(case, fc.Springs(kind="van_gelder"))
