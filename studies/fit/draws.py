"""True constants and starts, drawn by a seed, and the tests that tell them."""

from __future__ import annotations

import math

import numpy as np

from studies.fit import specimens
from studies.fit.measuring import Test

RATIO = 0.05, 0.3  # damping ratio of the strip that swings in its plane
OFF = math.log(3.0)  # of a start, at most
ANGLES = 0, 45, 90
CONSTANTS = "warp", "weft", "shear", "poisson", "bending", "damping", "drag"
TESTS = "pull 0", "pull 45", "pull 90", "hang", "bounce", "swing"
READINGS = 6  # of each value of a strip at rest
P1, P2 = {"element": "P1"}, {"element": "P2"}


def draw_truth(rng: np.random.Generator) -> dict[str, float]:
    """Constants of a fabric, log-uniform about published ones."""
    warp, ratio = between(rng, 300.0, 3000.0), between(rng, 1 / 3, 3.0)
    weft = warp * ratio
    return {
        "warp": warp,
        "weft": weft,
        "shear": math.sqrt(warp * weft) * between(rng, 0.03, 0.4),
        "poisson": rng.uniform(0.1, 0.45) * min(1.0, 1.6 / math.sqrt(ratio)),
        "bending": between(rng, 3e-6, 1e-4),
        "damping": between(rng, *RATIO) * specimens.period(warp) / math.pi,
        "drag": between(rng, 0.4, 2.5),
    }


def draw_start(rng: np.random.Generator, truth: dict[str, float]) -> dict[str, float]:
    """Where a fit begins: off by a factor of up to 3, Poisson's ratio anywhere that is admitted."""
    start = {name: value * math.exp(rng.uniform(-OFF, OFF)) for name, value in truth.items()}
    start["poisson"] = rng.uniform(0.0, 0.5) * min(1.0, math.sqrt(start["warp"] / start["weft"]))
    return start


def between(rng: np.random.Generator, low: float, high: float) -> float:
    return float(math.exp(rng.uniform(math.log(low), math.log(high))))


def make_tests(truth: dict[str, float], swapped: bool) -> dict[str, Test]:
    """All tests of a fabric by name.

    The data come from P1 on other meshes, the fit takes P2; `swapped` the other way around.
    """
    pulls = [pull(angle, swapped) for angle in ANGLES]
    return {each.name: each for each in [*pulls, hang(truth, swapped), bounce(truth), swing()]}


def pull(angle: int, swapped: bool) -> Test:
    data, fit = {"h": 0.01, "pattern": "cross"} | P1, {"h": 0.04} | P2
    if swapped:
        data, fit = (
            {"h": 0.012, "pattern": "unstructured"} | P2,
            {"h": 0.02, "pattern": "cross"} | P1,
        )
    columns = {"reaction.right.x": "reaction:right.x"}
    return Test(
        f"pull {angle}", specimens.pull, ("warp", "weft", "shear", "poisson"),
        columns | ({} if angle == 45 else {"mark.y": "mark.y"}), specimens.GRIP, data, fit,
        range(READINGS), None, settings={"angle": math.radians(angle)},
    )  # fmt: skip


def hang(truth: dict[str, float], swapped: bool) -> Test:
    data, fit = {"h": 1 / 24} | P1, {"h": 1 / 6} | P2
    if swapped:
        data, fit = {"h": 1 / 12, "pattern": "unstructured"} | P2, {"h": 1 / 12} | P1
    length = {"length": specimens.overhang(truth["bending"])}
    return Test(
        "hang", specimens.hang, ("bending",), {"tip.z": "tip.z"}, specimens.TIP, data, fit,
        range(READINGS), None, settings=length,
    )  # fmt: skip


def bounce(truth: dict[str, float]) -> Test:
    data, fit = {"h": 1 / 8, "pattern": "unstructured"} | P2, {"h": 1 / 8} | P1
    T = specimens.period(truth["warp"])
    return Test(
        "bounce", specimens.bounce, ("warp", "damping"), {"tip.x": "tip.x"}, specimens.TIP,
        data, fit, tuple(np.linspace(0.05, 0.75, 16) * T), 0.75 * T, T / 32,
    )  # fmt: skip


def swing() -> Test:
    data, fit = {"h": 0.025, "pattern": "unstructured"}, {"h": 0.05}
    return Test(
        "swing", specimens.swing, ("drag",), {"tip.x": "tip.x"}, specimens.TIP, data, fit,
        tuple(np.linspace(0.05, 0.5, 16)), 0.5, 0.5 / 16,
    )  # fmt: skip
