"""What the references say, and what a chart would say that ends at each of their meshes."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.integrate import simpson

from fecloth import study
from studies import harness
from studies.evidence.work_precision.bending_fronts import limit, list_limits, run_rest
from studies.evidence.work_precision.bending_scenes import REACH
from studies.references import falling_disk
from studies.references.elastica import heavy_elastica
from studies.work_precision.scenes import PAPER

TITLE = "References on fine meshes"
CONCLUSION = """\
Trampoline: the triangles converge to the radial solution, which has another discretisation and
another method; so both are right to a few thousandths of a percent. One process needs 20 minutes.

Plates at rest: up to 500,000 triangles the error falls as h². On 2,000,000 the cantilever is less
sure than on 500,000: the round-off of the forces grows as 1/h^2.5, and moves the cloth more than
the triangles do. It remains far below the errors of the charts.

Charts: the limits that the study of bending fits to coarser meshes of P2 are right to 0.05 %. So
its errors below 0.15 % were not sure to a third of their value, and errors above are right. A chart
of a scene without an exact solution states the uncertainty of its limit from three meshes; that
covers the truth on nearly all meshes. In the figure the lines are this uncertainty, the dotted ones
the truth."""
ORDER, LEVELS = 2.0, 3  # theoretical order of linear triangles; meshes of a chart's limit
TIMES = 0.005 * np.arange(1, 41)  # s, of the paths of the trampoline
SHOWN = (0.1, 0.2)  # s: before and after the front has met itself at the centre
Rows = list[dict]


@dataclass(frozen=True)
class Series:
    """A quantity of a scene on meshes from coarse to fine.

    Attributes
    ----------
    sizes, triangles, values
        Of each mesh; values in m.
    whole
        What errors are divided by [m].
    exact
        The value of a solution without triangles, if there is one [m].
    """

    scene: str
    quantity: str
    sizes: np.ndarray
    triangles: np.ndarray
    values: np.ndarray
    whole: float
    exact: float | None

    def windows(self) -> Iterable[tuple[int, study.Estimate]]:
        """The number of the finest of each three successive meshes, and what these say."""
        for end in range(LEVELS, len(self.sizes) + 1):
            of = slice(end - LEVELS, end)
            yield end - 1, study.estimate_uncertainty(self.sizes[of], self.values[of], ORDER)

    @property
    def truth(self) -> float:
        """The exact value, or else the limit of the three finest meshes."""
        return (
            [found for _, found in self.windows()][-1].limit if self.exact is None else self.exact
        )


def list_series(rows: Rows, elements: int) -> list[Series]:
    """Return the quantities of all scenes; `elements` belong to the radial solution."""
    found = []
    for scene in dict.fromkeys(row["scene"] for row in rows):
        own = sorted((row for row in rows if row["scene"] == scene), key=lambda row: -row["h"])
        sizes, triangles = (np.array([row[name] for row in own]) for name in ("h", "triangles"))
        for quantity, values, whole, exact in _quantities(scene, own, elements):
            found.append(Series(scene, quantity, sizes, triangles, values, whole, exact))
    return found


def _quantities(scene: str, own: Rows, elements: int) -> Iterable[tuple]:
    """The names, values, sizes and exact values of the quantities of a scene."""
    if scene == "trampoline":
        disk = falling_disk.trampoline(TIMES, elements=elements)
        paths = {"mean": disk.mean_deflection, "point": disk.centre}
        for name, title in (("mean", "mean"), ("point", "centre")):
            path, values = paths[name], np.array([row[name] for row in own])
            for t in SHOWN if name == "mean" else SHOWN[1:]:
                i = int(np.argmin(abs(TIMES - t)))
                yield f"{title}, {t:g} s", values[:, i], float(path.max()), float(path[i])
        return
    exact = bent_strip() if scene == "cantilever" else {}
    for name, title in (("mean", "mean"), ("point", "free edge" if exact else "corner")):
        values = np.array([row[name] for row in own])
        yield title, values, float(abs(values[-1])), exact.get(name)


def bent_strip() -> dict[str, float]:
    """Return mean and end of the cantilever as a strip that bends and stretches [m]."""
    weight = PAPER.areal_density * 9.81 * REACH
    gamma, softness = weight * REACH**2 / PAPER.bending[0], weight / PAPER.tensile[0]
    s, _, drop = heavy_elastica(gamma, softness=softness)
    return {"mean": REACH * float(simpson(drop, x=s)), "point": REACH * float(drop[-1])}


def table_of_runs(rows: Rows) -> Rows:
    """Return the values on each mesh, and what they cost."""
    lines = []
    for row in rows:
        is_path = isinstance(row["mean"], list)
        mean, point = (row[name][-1] if is_path else row[name] for name in ("mean", "point"))
        lines.append(
            {
                "scene": row["scene"],
                "triangles": row["triangles"],
                "mean [mm]": f"{1e3 * mean:.7g}",
                "point [mm]": f"{1e3 * point:.7g}",
                "steps or iterations": row.get("steps", row.get("newton")),
                "processes": row["processes"],
                "CPU s of each": ", ".join(f"{s:.3g}" for s in row["seconds"]),
                "peak GB of each": ", ".join(f"{mb / 1e3:.2g}" for mb in row["memory_MB"]),
            }
        )
    return lines


def table_of_gains(series: list[Series]) -> Rows:
    """Return what each three successive meshes say of the limit, and how true that is."""
    lines = []
    for one in series:
        for finest, said in one.windows():
            lines.append(
                {
                    "scene": one.scene,
                    "quantity": one.quantity,
                    "finest mesh": int(one.triangles[finest]),
                    "order": said.order,
                    "uncertainty [%]": f"{100 * said.uncertainty / one.whole:.2g}",
                    "from the truth [%]": f"{100 * abs(said.value - one.truth) / one.whole:.2g}",
                    "of its limit [%]": f"{100 * abs(said.limit - one.truth) / one.whole:.2g}",
                }
            )
    return lines


def shifts_of_fitted_limits(options, series: list[Series]) -> list[harness.Finding]:
    """Return how far the limits that the study of bending fits are from the references."""
    fine = study.run_cases(
        list_limits(False), run_rest, **harness.run_options(options), time_limit=300
    )
    names = {"mean": "mean", "free edge": "point", "corner": "point"}
    findings = []
    for one in series:
        if one.scene in ("cantilever", "table"):
            reference = [said for _, said in one.windows()][-1].limit
            fitted = limit(fine, one.scene, "plate, P2", names[one.quantity])
            what = f"{one.scene}, {one.quantity}: fitted limit of the chart from the reference [%]"
            findings.append(harness.Finding(what, 100 * abs(fitted / reference - 1)))
    return findings


def agreements(series: list[Series], loose: bool) -> list[harness.Finding]:
    """Return how far the finest values are from the solutions without triangles."""
    bounds = {"trampoline": 2.0 if loose else 0.15, "cantilever": 1.0 if loose else 1e-3}
    return [
        harness.Finding(
            f"{one.scene}, {one.quantity}: finest mesh from the exact solution [%]",
            100 * abs(one.values[-1] - one.exact) / one.whole,
            high=bounds[one.scene],
        )
        for one in series
        if one.exact is not None
    ]


def least_uncertainties(series: list[Series]) -> list[harness.Finding]:
    """Return the least uncertainty of each quantity, and on how many triangles it is found."""
    findings = []
    for one in series:
        finest, best = min(one.windows(), key=lambda window: window[1].uncertainty)
        what = f"{one.scene}, {one.quantity}: least uncertainty, on {one.triangles[finest]} [%]"
        findings.append(harness.Finding(what, 100 * best.uncertainty / one.whole, high=0.02))
    short = [
        (abs(said.value - one.truth) - said.uncertainty) / one.whole
        for one in series
        for _, said in one.windows()
    ]
    what = f"{sum(s > 0 for s in short)} of {len(short)} uncertainties are too small, by up to [%]"
    return [*findings, harness.Finding(what, 100 * max(0.0, *short), high=1e-3)]


def draw(out, series: list[Series]) -> None:
    """Draw the uncertainty that a chart states, and the true distance, over the triangles."""
    scenes = list(dict.fromkeys(one.scene for one in series))
    words, size = ("triangles of the finest mesh", "error [%]"), (4.2 * len(scenes), 4.2)
    with harness.figure(out, "references", *words, panels=(1, len(scenes)), size=size) as (_, axes):
        for ax, scene in zip(np.atleast_1d(axes).flat, scenes, strict=True):
            ax.set_title(scene)
            for i, one in enumerate(s for s in series if s.scene == scene):
                look = study.line_style(i)
                found = [(one.triangles[k], said) for k, said in one.windows()]
                said = [100 * estimate.uncertainty / one.whole for _, estimate in found]
                ax.loglog([n for n, _ in found], said, **look, label=one.quantity)
                true = 100 * abs(one.values - one.truth) / one.whole
                known = len(true) if one.exact is not None else len(true) - 1
                ax.loglog(one.triangles[:known], true[:known], **look | {"ls": ":", "ms": 3})
            ax.legend()


def report(options, rows: Rows) -> int:
    """Write the report; the quick form has coarse meshes, and nothing of the charts."""
    series = list_series(rows, 400 if options.quick else 4800)
    findings = agreements(series, options.quick)
    if not options.quick:
        findings += least_uncertainties(series)
        findings += shifts_of_fitted_limits(options, series)
    draw(options.out, series)
    runs = table_of_runs(rows)
    finest = {run["scene"]: run for run in sorted(runs, key=lambda run: run["triangles"])}
    parts = {"run": runs, "chart that ends at a mesh": table_of_gains(series)}
    return harness.write_report(
        options,
        TITLE,
        [{"of": part, "status": "ok"} | row for part, own in parts.items() for row in own],
        tables={"Finest meshes": list(finest.values())},
        figures=("references",),
        findings=findings,
        conclusion="" if options.quick else CONCLUSION,
        page=Path(__file__).with_name("references"),
    )
