"""Is a wrong law called wrong? Knits that are predicted with the constants of another stitch.

The specimens of Singal et al. (2024) are stockinette and garter between rigid clamps
(`knits.toml`), up to 25 % of extension, which was chosen before any comparison. StVK's stiffness of
wale and course is fitted to the forces of a knit. Poisson's ratio and the shear stiffness, which
forces hardly tell, are uncertain numbers, written down beforehand: ν = 0.35 ± 0.2, G = 0.37 √(Y₁Y₂)
± 50 %; the fitted numbers follow them. So all inputs are known, and `fc.budget` gives a verdict on
the force at 25 %, whose scatter is the one of five repeats. With the constants of the other knit it
should say that the model is wrong. Its own knit is shown beside it.

    python -m studies.validation.knits [--quick]
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

import fecloth as fc
from studies import harness
from studies.fit import knits
from studies.validation import pages

SCENE = Path(__file__).with_suffix(".toml")
KNITS, DIRECTIONS = ("stockinette", "garter"), {"wale": 0.0, "course": 90.0}
PART = 0.25  # of the clamps' first distance: the range of all fits and comparisons
POISSON, SHEAR = (0.35, 0.2), (0.37, 0.5)  # ν, G/√(Y₁Y₂), and their uncertainties (G: relative)
WALE, COURSE = "fabric.tensile_stiffness.0", "fabric.tensile_stiffness.1"
SOUGHT = (WALE, COURSE, "fabric.shear_stiffness", "fabric.poisson_ratio")
START = {"stockinette": (500.0, 250.0), "garter": (80.0, 140.0)}
FORCE = "reaction.grip.x"
SIZE, FEW = (6, 6), (2, 2)  # cells along a specimen, and steps of its pull; the quick form


@dataclass(frozen=True)
class Specimen:
    """A knit drawn in a direction: its repeats in SI."""

    knit: str
    direction: str

    @cached_property
    def _read(self) -> tuple[dict[str, list[float]], float, float]:
        return knits.read(self.knit, self.direction, PART)

    @cached_property
    def forces(self) -> dict[str, list[float]]:
        return {name: values for name, values in self._read[0].items() if not name.startswith("h")}

    def measured(self) -> tuple[float, float]:
        """Mean force of the repeats at the end of the range, and their standard deviation."""
        # beyond the range, so that its end lies between two rows
        columns, length, _ = knits.read(self.knit, self.direction, 1.2 * PART)
        number, extension, force = (
            np.array(columns[name]) for name in ("repeat", "extension [m]", "force [N]")
        )
        end = PART * length
        ends = []
        for repeat in np.unique(number):
            rows = np.flatnonzero(number == repeat)
            rows = rows[np.argsort(extension[rows], kind="stable")]
            ends.append(np.interp(end, extension[rows], force[rows]))
        return float(np.mean(ends)), float(np.std(ends, ddof=1))

    def scene(self, fabric: Mapping[str, Any], cells: int, steps: int) -> Any:
        """The specimen, drawn by all of the range."""
        _, length, width = self._read
        keys = [
            f"grain_degrees={DIRECTIONS[self.direction]}", f"cloth.width={length}",
            f"cloth.height={width}", f"cloth.h={length / cells}",
            f'pins.1.motion=["{PART * length} * t", "0", "0"]', f"equilibrium.load_steps={steps}",
        ]  # fmt: skip
        return pages.scene_with(SCENE, keys, fabric=fabric)

    def experiment(self, fabric: Mapping[str, Any], cells: int, steps: int) -> fc.Experiment:
        return fc.Experiment(
            self.scene(fabric, cells, steps), self.forces, {"force": FORCE},
            {"extension": "grip.x"}, sigma="repeats", name=f"{self.knit}, {self.direction}",
        )  # fmt: skip


def fabric_of(wale: float, course: float, shear: float, poisson: float) -> dict[str, Any]:
    return {
        "areal_density": 0.3, "tensile_stiffness": [wale, course], "poisson_ratio": poisson,
        "shear_stiffness": shear,
    }  # fmt: skip


def fit(knit: str, fabric: Mapping[str, Any], sought: Sequence[str], size: Sequence[int]) -> fc.Fit:
    """Fit to the forces of both directions; what is not sought stays as in `fabric`."""
    experiments = [Specimen(knit, each).experiment(fabric, *size) for each in DIRECTIONS]
    numbers = (*fabric["tensile_stiffness"], fabric["shear_stiffness"], fabric["poisson_ratio"])
    start = {name: value for name, value in zip(SOUGHT, numbers, strict=True) if name in sought}
    return pages.quietly(fc.fit, experiments, start, refined=False)


def fit_with_uncertain(knit: str, size: Sequence[int]) -> tuple[fc.Fit, dict[str, Any]]:
    """The fit of wale and course, and a fabric with the covariance of all four constants."""
    wale, course = START[knit]
    nu, u_nu = POISSON
    shear, part = SHEAR[0] * math.sqrt(wale * course), SHEAR[1]
    pair = WALE, COURSE
    base = fit(knit, fabric_of(wale, course, shear, nu), pair, size)
    begin = base.values[WALE], base.values[COURSE]
    if size == FEW:  # the quick form
        V = joint_covariance(base.covariance, np.zeros((2, 2)), np.array([part * shear, u_nu]))
        return base, fabric_of(*begin, shear, nu) | {"uncertainty": uncertainty_table(V)}
    shear = SHEAR[0] * math.sqrt(begin[0] * begin[1])
    base = fit(knit, fabric_of(*begin, shear, nu), pair, size)
    u = np.array([part * shear, u_nu])
    shifted = [
        fit(knit, fabric_of(*begin, shear + u[0], nu), pair, size),
        fit(knit, fabric_of(*begin, shear, nu + u[1]), pair, size),
    ]
    middle = np.array([base.values[name] for name in pair])
    moved = np.array([[each.values[name] for name in pair] for each in shifted]) - middle
    V = joint_covariance(base.covariance, moved, u)
    fabric = fabric_of(float(middle[0]), float(middle[1]), shear, nu)
    return base, fabric | {"uncertainty": uncertainty_table(V)}


def joint_covariance(own: np.ndarray, moved: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Covariance of fitted numbers (2) and of given ones (k) that are independent.

    `own` (2, 2) is the fit's with the given ones held, `moved` (k, 2) are changes of the fitted
    numbers where a given one is higher by its standard uncertainty `u` (k,).
    """
    cross = moved * u[:, None]
    return np.block([[own + moved.T @ moved, cross.T], [cross, np.diag(u**2)]])


def uncertainty_table(V: np.ndarray) -> dict[str, Any]:
    """The table [fabric.uncertainty] of wale, course, shear stiffness and Poisson's ratio."""
    names = [name.removeprefix("fabric.") for name in SOUGHT]
    u = np.sqrt(np.diag(V))
    pairs = [
        [names[i], names[j], float(V[i, j] / (u[i] * u[j]))]
        for i in range(len(u))
        for j in range(i)
    ]
    return dict(zip(names, u.tolist(), strict=True)) | {"correlation": pairs}


def verdict(specimen: Specimen, own: str, fabric: Mapping[str, Any], size: Sequence[int]) -> dict:
    """What `fc.budget` says of a force with the constants of the knit `own`."""
    measured, scatter = specimen.measured()
    scene = specimen.scene(fabric, *size)
    answer = pages.budget(scene, FORCE, {FORCE: (measured, scatter)})
    said = {True: "agrees", False: "wrong", None: "no verdict"}[answer.agrees]
    return {
        "force of": f"{specimen.knit}, {specimen.direction}",
        "constants of": own,
        "predicted [N]": float(answer.value),
        "input [N]": float(answer.input),
        "measured [N]": measured,
        "scatter [N]": scatter,
        "difference over total": float(answer.difference / answer.total),
        "verdict": said,
    }


def main() -> int:
    options = harness.parse_arguments(__doc__ or "")
    size, owners, directions = SIZE, KNITS, tuple(DIRECTIONS)
    if options.quick:
        size, owners, directions = FEW, KNITS[:1], directions[:1]
    rows = []
    for own in owners:
        _, fabric = fit_with_uncertain(own, size)
        for knit in KNITS:
            rows += [verdict(Specimen(knit, each), own, fabric, size) for each in directions]
    other = [row for row in rows if not row["force of"].startswith(row["constants of"])]
    wrong = sum(row["verdict"] == "wrong" for row in other)
    words = f"of {len(other)} forces with the constants of the other knit, called wrong"
    findings = [harness.Finding(words, wrong, len(other))]
    page = Path(__file__).with_suffix("")
    return harness.conclude(options, __doc__, page, rows, findings, {"Verdicts": rows})


if __name__ == "__main__":
    harness.run_main(main)
