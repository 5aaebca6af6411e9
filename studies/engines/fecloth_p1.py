"""fecloth with linear triangles, and what it takes where nothing is said.

Steps are of central differences at 0.9 of the stable step, which studies/recommend advises for
cloth that moves with its own waves; what rests is found by `equilibrium`. Bending, where there is
any, is by `PlateBending`, and the loads then grow in 20 steps, as a cloth that folds needs it.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import Any

import numpy as np

import fecloth as fc
from fecloth.simulation.fused_march import Wanted

VERSION = fc.__version__
SETTINGS = (
    "StVK on P1, PlateBending; CentralDifference at 0.9 of the stable step; equilibrium, where it "
    "bends in 20 load steps with the tolerance 1e-6"
)


def run(case: Mapping[str, Any]) -> np.ndarray:
    """Return the positions (times, n, 3) [m] of fecloth's P1 triangles."""
    return solve(case, fc.StVK())


def solve(case: Mapping[str, Any], membrane: Any) -> np.ndarray:
    """Return the positions with another membrane term."""
    warnings.simplefilter("ignore", fc.FeclothWarning)
    x, times = case["x"].copy(), case["times"]
    if case["motion"] is not None:
        x[case["pins"]] = case["motion"][-1]
    positions = np.repeat(x[None], len(times), axis=0)
    cloth, nodes = cut_clamped(case)
    system = make_system(case, membrane, cloth, nodes)
    if case["static"]:
        how: dict = {"load_steps": 20, "tolerance": 1e-6} if bends(case) else {}
        positions[:, nodes] = fc.equilibrium(system, system.state(x[nodes]), **how).x
        return positions
    start = system.state(x[nodes], case["v"])
    steps = fc.march(system, fc.CentralDifference(), start, t_end=times[-1], stops=times[:-1])
    wanted, done = None, 0
    while done < len(times):
        state, _ = steps.send(wanted)
        wanted = Wanted(10**9, times[-1])
        if abs(times[done] - state.t) < 1e-12:
            positions[done], done = state.x, done + 1
    return positions


def cut_clamped(case: Mapping[str, Any]) -> tuple[fc.Cloth, np.ndarray]:
    """Return the cloth without the triangles whose nodes are all pinned, and its nodes.

    Where such triangles are left out the cloth is clamped: `Pin(clamp=True)` holds its slope.
    """
    pinned = np.isin(case["triangles"], case["pins"]).all(axis=1)
    cut = case["triangles"][~pinned] if bends(case) else case["triangles"]
    nodes, cut = np.unique(cut, return_inverse=True)
    return fc.Cloth.from_arrays(case["X"][nodes], cut.reshape(-1, 3), renumber=False), nodes


def bends(case: Mapping[str, Any]) -> bool:
    return case["fabric"]["bending_rigidity"] > 0


def make_system(
    case: Mapping[str, Any], membrane: Any, cloth: fc.Cloth, nodes: np.ndarray
) -> fc.System:
    """Return the system of a case on a cloth of some of its nodes."""
    constants = dict(case["fabric"])
    grain = constants.pop("grain")
    if not bends(case):
        del constants["bending_rigidity"]
    terms = [membrane, *([fc.PlateBending()] if bends(case) else [])]
    if case["gravity"].any():
        terms.append(fc.Gravity(tuple(case["gravity"])))
    for load in case["loads"]:
        terms.append(fc.PointForce(load["nodes"].tolist(), tuple(load["force"])))
    held = np.flatnonzero(np.isin(nodes, case["pins"])).tolist()
    pins = [fc.Pin(held, clamp=bends(case))] if held else []
    constants["tensile_stiffness"] = tuple(constants["tensile_stiffness"])
    return fc.System(cloth, fc.Fabric(**constants), terms, pins, grain=grain)
