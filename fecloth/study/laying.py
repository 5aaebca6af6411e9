"""Ways of laying a cloth, which may lead it to other equilibria, and what tells these apart."""

from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from fecloth.simulation.load_steps import LoadSteps
from fecloth.simulation.on_request import bind_measure
from fecloth.simulation.setup import Setup
from fecloth.simulation.shapes import compressed_share, stress_cells
from fecloth.study.orders import has_bending, is_round

FOLDS = range(3, 9)  # waves of a start of a round cloth
USUAL_FOLDS = 5.0
WAVE = 0.02  # height of these waves over the extent of the cloth
NEARLY_FLAT = 0.05  # over the extent: a start that is farther from a plane is laid as it is


def describe_state(setup: Setup, x: np.ndarray) -> dict[str, Any]:
    """Return what tells equilibria apart: the folds of the rim, and the part that is compressed.

    The number of folds is None for a cloth without an outer rim. A cloth in tension has one
    equilibrium; where a part of it is compressed, it may have others. Without bending the
    wrinkles follow the mesh, so that no state can be told from another: no part counts.
    """
    folds = None
    with suppress(KeyError):  # without a border
        folds = bind_measure("folds", setup.system, ())(x, {})["folds"]
    compressed = 0.0
    if has_bending(setup):
        compressed = compressed_share(setup.system, stress_cells(setup.system, x))
    return {"folds": folds, "compressed": compressed}


def ways_of_laying(setup: Setup, folds: float | None) -> list[str]:
    """Return other ways of laying a cloth that lies in so many folds, for `lay`.

    A round cloth is laid in waves, fewer and more than it has folds; any other in twice as many
    load steps; any cloth flat and disturbed, or, if its loads grow in steps, dropped: the loads
    act at once.
    """
    has_steps = isinstance(setup.steps, LoadSteps)
    ways = ["in more steps"] if has_steps else []
    ways += ["flat 1", "flat 2"]
    if is_round(setup.cloth):
        near = sorted(FOLDS, key=lambda waves: abs(waves - (folds or USUAL_FOLDS)))
        fewer_and_more = [waves for waves in near if waves != folds][:3]
        ways = [*(f"waves {waves}" for waves in fewer_and_more[:2]), "flat 1"]
        ways.append(f"waves {fewer_and_more[2]}")
    if has_steps and setup.steps.load_steps > 1:
        ways.append("dropped")
    return ways


def lay(setup: Setup, way: str) -> Setup:
    """Return a setup whose cloth is laid in a way of `ways_of_laying`.

    The waves rise from the pins to the rim, upward from the plane of the start.
    """
    kind, _, number = way.partition(" ")
    if kind == "dropped":
        return setup.taking(replace(setup.steps, load_steps=1))
    if kind == "in":
        return setup.taking(replace(setup.steps, load_steps=2 * setup.steps.load_steps))
    flat = replace(setup, start=replace(setup.start, x=_flat(setup)))
    if kind == "flat":
        return flat.disturbed(int(number))
    cloth = setup.cloth
    from_middle = cloth.X - (cloth.X.max(axis=0) + cloth.X.min(axis=0)) / 2
    rise = np.linalg.norm(from_middle, axis=1)
    held = setup.system.constraints.nodes
    if len(held):
        rise, _ = cKDTree(cloth.X[held]).query(cloth.X)
    angle = np.arctan2(from_middle[:, 1], from_middle[:, 0])
    height = WAVE * cloth.extent * rise / rise.max() * (1 + np.cos(int(number) * angle)) / 2
    return flat.raised(height)


def _flat(setup: Setup) -> np.ndarray:
    """Return the start (n, 3) in the plane nearest to it, as far as pins allow; or as it is."""
    x = setup.start.x
    places = np.column_stack([setup.cloth.X, np.ones(len(x))])
    plane = places @ np.linalg.lstsq(places, x, rcond=None)[0]
    if np.abs(plane - x).max() > NEARLY_FLAT * setup.cloth.extent:
        return x
    flat: np.ndarray = x + setup.system.constraints.expand(plane - x)
    return flat
