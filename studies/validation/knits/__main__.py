"""Knits: do the forces of two knits predict their widths, and does one knit predict the other?

The specimens of Singal et al. (2024), stockinette and garter between rigid clamps
(`specimen.toml`), up to 25 % of extension, which was chosen before any comparison. StVK's stiffness
of wale and course is fitted to the forces alone; `fc.budget` then predicts how much the two pins
across come closer. Poisson's ratio and the shear stiffness, which forces hardly tell, are uncertain
numbers, written down beforehand: ν = 0.35 ± 0.2, G = 0.37 √(Y₁Y₂) ± 50 %. Where a fit of all four
constants says that the forces do tell ν, its own answer is shown, too. Last, garter is predicted
with the constants of stockinette. Expected: garter is not what they say.

    python -m studies.validation.knits [--quick]
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

import fecloth as fc
from studies import harness
from studies.fit import knits
from studies.validation import pages
from studies.validation.comparison import Comparison, from_budget

SCENE, FOLDER = Path(__file__).parent / "specimen.toml", "knits"
KNITS, DIRECTIONS = ("stockinette", "garter"), {"wale": 0.0, "course": 90.0}
PART = 0.25  # of the clamps' first distance: the range of all fits and comparisons
POISSON, SHEAR = (0.35, 0.2), (0.37, 0.5)  # ν, G/√(Y₁Y₂), and their uncertainties (G: relative)
WALE, COURSE = "fabric.tensile_stiffness.0", "fabric.tensile_stiffness.1"
SOUGHT = (WALE, COURSE, "fabric.shear_stiffness", "fabric.poisson_ratio")
START = {"stockinette": (500.0, 250.0), "garter": (80.0, 140.0)}
FORCE, ACROSS = "reaction.grip.x", "distance of low and high"
SIZE, FEW = (6, 6), (2, 2)  # cells along a specimen, and steps of its pull; the quick form
SOURCE = """\
**Measured** ([data](../data/README.md)): force and the distance of two pins across, five repeats
each; the scatter is their standard deviation. In garter along the course the pins are farther apart
than the clamps are wide: the specimen is taken as wide as its pins there.

**Fitted** are two constants a knit, again with ν or G one standard uncertainty higher; the
covariance of all four numbers is made of both. **Predicted** is how much closer the pins come."""


@dataclass(frozen=True)
class Specimen:
    """A knit drawn in a direction: its repeats in SI."""

    knit: str
    direction: str

    @cached_property
    def _read(self) -> tuple[dict[str, list[float]], float, float]:
        return knits.read(self.knit, self.direction, PART)

    @property
    def length(self) -> float:
        return self._read[1]

    @property
    def across(self) -> float:
        """Distance of the pins at first, the mean of all repeats."""
        return 2 * self._read[0]["half [m]"][0]

    @property
    def forces(self) -> dict[str, list[float]]:
        return {name: values for name, values in self._read[0].items() if not name.startswith("h")}

    @cached_property
    def repeats(self) -> list[np.ndarray]:
        """(3, n) of each repeat: extension, force and narrowing from its start [m, N, m]."""
        path = pages.DATA / f"singal_2024_acrylic_{self.knit}_{self.direction}.csv"
        columns = pages.read_columns(path)
        found = []
        for number in np.unique(columns["repeat"]):
            own = {name: values[columns["repeat"] == number] for name, values in columns.items()}
            drawn, across = own["clamp distance [mm]"], own["pin distance across [mm]"]
            rows = [1e-3 * (drawn - drawn[0]), own["force [N]"], 1e-3 * (across[0] - across)]
            found.append(np.array(rows)[:, np.argsort(drawn, kind="stable")])
        return found

    def measured(self, row: int, part: float) -> tuple[float, float]:
        """Mean and standard deviation of the repeats' force (1) or narrowing (2)."""
        at = part * PART * self.length
        values = [np.interp(at, each[0], each[row]) for each in self.repeats]
        return float(np.mean(values)), float(np.std(values, ddof=1))

    def scene(self, fabric: Mapping[str, Any], reach: float, cells: int, steps: int) -> Any:
        length, width = self.length, self._read[2]
        low, high = (width + sign * min(self.across, 0.9999 * width) for sign in (-1, 1))
        keys = [
            f"grain_degrees={DIRECTIONS[self.direction]}", f"cloth.width={length}",
            f"cloth.height={width}", f"cloth.h={length / cells}",
            f'pins.1.motion=["{reach} * t", "0", "0"]', f"equilibrium.load_steps={steps}",
            f"probes.1.point=[{length / 2}, {low / 2}]",
            f"probes.2.point=[{length / 2}, {high / 2}]",
        ]  # fmt: skip
        return pages.scene_with(SCENE, keys, fabric=fabric)

    def experiment(self, fabric: Mapping[str, Any], cells: int, steps: int) -> fc.Experiment:
        data = self.forces
        return fc.Experiment(
            self.scene(fabric, max(data["extension [m]"]), cells, steps), data, {"force": FORCE},
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


def predict(
    specimen: Specimen, fabric: Mapping[str, Any], words: str, fitted: bool, size: Sequence[int]
) -> tuple[list[Comparison], tuple[np.ndarray, ...]]:
    """Comparisons at half and all of the range; and places, force, its u, narrowing, its u."""
    cells, steps = size
    reach = PART * specimen.length
    grid = np.arange(1, steps + 1) / steps
    times = [f" at {t + 1e-9:.10f}" if t < 1 else "" for t in grid]
    names = [FORCE + t for t in times] + [ACROSS + t for t in times]
    answer = pages.budget(specimen.scene(fabric, reach, cells, steps), names, {})
    listed = from_budget(answer, FOLDER, f"{specimen.knit}, {specimen.direction}{words}")
    forces, apart = listed[:steps], listed[steps:]
    first = min(specimen.across, 0.9999 * specimen._read[2])
    closer = [replace(c, predicted=first - c.predicted).scaled(1e3, "mm") for c in apart]
    compared = []
    for part in (0.5, 1.0):
        i = round(part * steps) - 1
        mean, scatter = specimen.measured(1, part)
        kind = "fitted" if fitted else "predicted"
        force = replace(forces[i], quantity=f"force at {100 * part * PART:g} %", unit="N")
        compared += [replace(force, measured=mean, scatter=scatter, kind=kind)]
        mean, scatter = specimen.measured(2, part)
        width = replace(closer[i], quantity=f"narrowing at {100 * part * PART:g} %")
        compared += [replace(width, measured=1e3 * mean, scatter=1e3 * scatter)]
    rows = [([c.predicted for c in each], [c.own for c in each]) for each in (forces, closer)]
    curves = 100 * grid * PART, *(np.array(numbers) for row in rows for numbers in row)
    return compared, curves


def panels(specimen: Specimen, curves: Sequence, other: Sequence | None) -> list[pages.Panel]:
    """Force and narrowing over extension: repeats, the own constants, those of the other knit."""
    points = [each[:, each[0] <= PART * specimen.length] for each in specimen.repeats]
    x = [100 * each[0] / specimen.length for each in points]
    found = []
    for row, factor, label in ((1, 1.0, "force [N]"), (2, 1e3, "narrowing [mm]")):
        measured = [(at, factor * each[row], None) for at, each in zip(x, points, strict=True)]
        value, u = curves[2 * row - 1], curves[2 * row]
        lines = [("with stockinette's", other[0], other[2 * row - 1])] if other else []
        found.append(
            pages.Panel(
                f"{specimen.knit}, {specimen.direction}", "extension [%]", label, measured,
                curves[0], value, u, "fitted ± 2 u" if row == 1 else "predicted ± 2 u", lines,
            )
        )  # fmt: skip
    return found


def constants(words: str, answer: fc.Fit, fabric: Mapping[str, Any]) -> dict[str, Any]:
    """A row of a table: what a fabric is, and how well the fit meets the forces."""
    u = fabric.get("uncertainty", {})
    numbers = (*fabric["tensile_stiffness"], fabric["shear_stiffness"], fabric["poisson_ratio"])
    row: dict[str, Any] = {"fit": words}
    for name, short, value in zip(SOUGHT, ("wale", "course", "G", "ν"), numbers, strict=True):
        deviation = u.get(name.removeprefix("fabric."))
        row[short] = f"{value:.3g}" + (f" ± {deviation:.2g}" if deviation else ", not told")
    for line in answer.experiments:
        row[f"{str(line['experiment']).split(', ')[1]}: rms %"] = f"{line['rms %']:.1f}"
    return row | {"misfit": answer.misfit, "law": "wrong" if answer.law_fails else "not refuted"}


def main() -> int:
    options = pages.parse_arguments(__doc__, FOLDER)
    size = FEW if options.quick else SIZE
    directions = ("wale",) if options.quick else tuple(DIRECTIONS)
    compared, rows, curves = list[Comparison](), list[dict[str, Any]](), dict[tuple, Any]()
    made: dict[str, dict[str, Any]] = {}
    for knit in KNITS[: 1 if options.quick else None]:
        answer, made[knit] = fit_with_uncertain(knit, size)
        rows.append(constants(knit, answer, made[knit]))
        for direction in directions:
            more, curves[knit, direction] = predict(
                Specimen(knit, direction), made[knit], "", True, size
            )
            compared += more
    own = [c for c in compared if c.kind == "predicted"]
    for direction in directions:
        more, curves["other", direction] = predict(
            Specimen("garter", direction), made["stockinette"], " with stockinette's", False, size
        )
        compared += more
    other = [c for c in compared if "with" in c.specimen and c.quantity.startswith("force")]
    wrong = sum(not c.agrees for c in other)
    findings = [
        harness.Finding(
            f"of {len(other)} forces of garter with stockinette's constants, wrong", wrong,
            len(other),
        ),
        harness.Finding(f"of {len(own)} widths, agree", sum(bool(c.agrees) for c in own)),
    ]  # fmt: skip
    sections = [SOURCE]
    if not options.quick:
        told: list[Comparison] = []
        for knit in KNITS:
            begin = fabric_of(*START[knit], 0.37 * math.sqrt(math.prod(START[knit])), 0.35)
            answer = fit(knit, begin, SOUGHT, size)
            rows.append(constants(f"{knit}, all four sought", answer, answer.fabric))
            if "fabric.poisson_ratio" in answer.identified and not answer.law_fails:
                bare = {k: v for k, v in answer.fabric.items() if k != "uncertainty"}
                for direction in directions:
                    words = ", ν by forces"
                    more, _ = predict(Specimen(knit, direction), bare, words, True, size)
                    told += [replace(c, kind="shown") for c in more]
        compared += told
        sections.append(conclude(compared))
        figures = [
            panel
            for knit in KNITS
            for direction in DIRECTIONS
            for panel in panels(
                Specimen(knit, direction), curves[knit, direction],
                curves["other", direction] if knit == "garter" else None,
            )
        ]  # fmt: skip
        pages.draw(options.out / "knits.png", figures, columns=4)
    return pages.write_page(
        options, __doc__, findings, compared, sections=sections, tables={"Constants": rows},
        figure="" if options.quick else "knits.png",
    )  # fmt: skip


def conclude(compared: Sequence[Comparison]) -> str:
    """What is right and what is wrong, in words."""
    widths = [c for c in compared if c.quantity.startswith("narrowing")]
    own = [c for c in widths if c.specimen.count(" ") == 1]
    last = f"{100 * PART:g} %"
    other = [c for c in compared if "with" in c.specimen and c.quantity == f"force at {last}"]
    fitted = [c for c in compared if c.kind == "fitted"]
    agree, met = (sum(bool(c.agrees) for c in each) for each in (own, fitted))
    wrong = ", ".join(f"{c.percent:+.0f} % ({c.specimen})" for c in own if not c.agrees)
    part = {
        knit: np.median([c.input / c.predicted for c in own if c.specimen.startswith(knit)])
        for knit in KNITS
    }
    told = ", ".join(
        f"{c.percent:+.0f} % ({c.specimen.split(', ')[1]})"
        for c in widths
        if "by forces" in c.specimen and c.quantity.endswith(f" {last}")
    )
    times = " and ".join(f"{c.predicted / c.measured:.1f} times" for c in other)
    off = ", ".join(f"{c.percent:+.0f} %" for c in fitted if c.quantity.endswith(f" {last}"))
    said = "No fit of all four constants says that the forces tell ν."
    if told:
        said = f"""\
The fit of all four constants to the forces of stockinette says that they do tell ν, but its
narrowing at {last} is off by {told}: it takes the J of the curves for coupling."""
    stockinette, garter = (f"{100 * part[knit]:.0f} %" for knit in KNITS)
    return f"""\
**Widths:** {agree} of {len(own)} narrowings agree. Those of garter do because they are uncertain by
{garter} (median): forces hardly tell ν, and near ν = √(Y₁/Y₂) all depends on it. Those of
stockinette are uncertain by {stockinette}, and wrong by {wrong}:
its Poisson's ratio is not 0.35 ± 0.2, or the law is wrong; a fit that may use the widths wants
0.76 ± 0.33 (95 %, `studies.fit.knits`). {said}
**Forces:** {met} of {len(fitted)} forces agree with the fit to the same curves, off by
{off} at {last}: the measured curves are J-shaped, StVK's are nearly straight.
**Garter with the constants of stockinette** is wrong: its forces at {last} are {times} the
measured ones. Constants do not go over to another stitch of the same yarn.
**Missing:** curves in place of constants (`MembraneTable`), for the J; a measured Poisson's ratio;
strips at 45° for the shear stiffness; that a repeat begins where the repeat before it ended."""


if __name__ == "__main__":
    harness.run_main(main)
