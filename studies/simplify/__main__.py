"""What a scene does not need: what each of its parts is worth at a tolerance, and a simpler scene.

Dimensionless numbers foretell what each part is worth. Then each term is left out or replaced by
its cheaper sibling, the mesh and the steps are made coarser, and each of these scenes is run and
held against the full one, by the quantities that its table [interest] names; where it has none,
the paths of its probes, or else the displacements at the end. What changes them by less than the
tolerance goes, the greatest saving per change first, as long as all that went changes them by
less together. OUT/reduced.toml is the scene that is left; it is run once more.

    python -m studies.simplify --scene my.toml --tolerance 1% [--jobs N] [--out DIR]
    python -m studies.simplify [--quick]      three scenes whose needs are known
"""

from __future__ import annotations

import argparse
import math
import sys
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from fecloth import study as harness
from fecloth.errors import FeclothError
from fecloth.output.atomic_files import replace_file
from fecloth.scene.scene import load
from fecloth.scene.toml_text import to_toml
from studies.simplify.cases import COUNTED, Answer, answer, changes, data_of, interest_of, scene_of
from studies.simplify.dimensionless import Numbers
from studies.simplify.dimensionless import table as numbers_of
from studies.simplify.predictions import predicted
from studies.simplify.variants import Variant, variants

SCENES = Path(__file__).parents[1] / "scenes" / "needs"
KNOWN = {  # scene: what it needs, what not
    "taut": ("without Gravity", "without HingeBending"),
    "cantilever": ("without HingeBending", "without Drag"),
    "wind": ("without Wind", "without QuadraticBending"),
}
PATIENCE = 3  # times the seconds of the full scene: more than that saves nothing
LOST = 0.05  # of the seconds: less is not told from noise


@dataclass(frozen=True, eq=False)
class Study:
    """One scene, its full answer, and where its cases are kept."""

    name: str
    data: dict
    tolerance: float
    running: dict
    repeats: int = 3
    known: bool = False

    @classmethod
    def of(cls, path: Path, options: argparse.Namespace) -> Study:
        data = data_of(load(path))
        out = options.out if options.scene else options.out / path.stem
        running = harness.running(options) | {"out": out}
        repeats, known = 1 if options.quick else 3, not options.scene
        return cls(path.stem, data, options.tolerance, running, repeats, known)

    @cached_property
    def text(self) -> str:
        return to_toml(self.data)

    @cached_property
    def scene(self):
        return scene_of(self.text)

    @cached_property
    def interest(self):
        return interest_of(self.scene)

    @cached_property
    def full(self) -> Answer:
        (row,) = self.answers([self.case("full", self.data)])
        if row["status"] != "ok":
            raise SystemExit(f"the full scene fails: {row['cause']}")
        return Answer.of(row)

    def case(self, name: str, data: dict, static: bool = False) -> dict:
        settings = {"scene": self.name, "variant": name, "text": to_toml(data)}
        return settings | {"static": static, "repeats": self.repeats}

    def answers(self, cases: list[dict]) -> list[dict]:
        return harness.run_cases(cases, answer, **self.running)

    def simpler(self, name: str, data: dict, static: bool = False) -> dict:
        """A case that may take so many times the seconds of the full scene, at most."""
        most = math.ceil(1 + PATIENCE * self.full.row["cpu_seconds"])
        return self.case(name, data, static) | {"most": most}

    def held(self, row: dict) -> dict:
        """A row with its change and what it saves; or its cause."""
        line = {key: row.get(key) for key in ("scene", "variant", "status")}
        if row["status"] == "ok":
            try:
                each = changes(self.full, Answer.of(row), self.interest)
            except FeclothError as error:
                return line | {"status": "failed", "cause": str(error)}
            line |= {"change": max(each.values()), "of": max(each, key=each.get)}
            line["saved"] = 1 - row["cpu_seconds"] / self.full.row["cpu_seconds"]
            counts = ("cpu_seconds", "triangles", "steps", *COUNTED)
            line |= {name: row.get(name) for name in counts}
        return line | {"cause": row["cause"]}


def one_by_one(study: Study) -> list[tuple[Variant, dict]]:
    """Each variant alone, with its prediction."""
    tried = variants(study.data, study.interest)
    cases = [study.simpler(one.name, one.apply(study.data), one.static) for one in tried]
    numbers = Numbers.of(study.scene)
    found = []
    for variant, row in zip(tried, study.answers(cases), strict=True):
        line = study.held(row)
        found.append((variant, {"predicted": predicted(variant, numbers)} | line))
    return found


def worth(line: dict) -> float:
    """Saving per change; what saves nothing comes last."""
    return line["saved"] / max(line["change"], 1e-12) if line["saved"] > 0 else line["saved"]


def candidates(study: Study, found: list[tuple[Variant, dict]]) -> list[Variant]:
    """What may go alone and can be written into a scene, the greatest saving per change first.

    What stands in for something must save; what is left out may do without.
    """
    able = [
        (variant, line)
        for variant, line in found
        if line["status"] == "ok"
        and not variant.static
        and line["change"] <= study.tolerance
        and line["saved"] > (-LOST if variant.kind == "without" else LOST)
    ]
    return [variant for variant, _ in sorted(able, key=lambda pair: -worth(pair[1]))]


def combined(study: Study, found: list[tuple[Variant, dict]]) -> tuple[dict, list[dict]]:
    """The tables of the scene after all that can go together, and the rows of the attempts.

    Of two changes in one place the later stays if it saves more, or leaves a term out.
    """
    chosen: dict[str, Variant] = {}
    data, seconds, rows = study.data, study.full.row["cpu_seconds"], []
    for variant in candidates(study, found):
        before = chosen.get(variant.slot)
        if before and before.kind == "without":
            continue
        trial = {**chosen, variant.slot: variant}
        simpler = study.data
        for one in trial.values():
            simpler = one.apply(simpler)
        names = " + ".join(one.name for one in trial.values())
        line = study.held(study.answers([study.simpler(names, simpler)])[0])
        fits = line["status"] == "ok" and line["change"] <= study.tolerance
        out = 1 + LOST if variant.kind == "without" or not before else 1 - LOST
        fits = fits and line["cpu_seconds"] <= out * seconds
        rows.append({**line, "taken": "yes" if fits else "no"})
        if fits:
            chosen, data, seconds = trial, simpler, line["cpu_seconds"]
    return data, rows


def reduced(study: Study, data: dict) -> dict:
    """Write reduced.toml, run what is in the file, and hold it against the full scene."""
    path = study.running["out"] / "reduced.toml"
    replace_file(path, to_toml(data).encode())
    case = study.case("reduced.toml", data_of(load(path)))
    (row,) = harness.run_cases([case], answer, **study.running | {"fresh": True})
    return study.held(row)


def ranked(study: Study, found: list[tuple[Variant, dict]]) -> list[dict]:
    """The variants by what they change, with a verdict each."""
    table = []
    for _, line in found:
        good = line["status"] == "ok"
        verdict = "needed" if not good or line["change"] > study.tolerance else "can go"
        if verdict == "can go" and line["saved"] <= -LOST:
            verdict = "can go, saves nothing"
        short = {name: line.get(name) for name in ("variant", "predicted", "change", "of", "saved")}
        counts = {name: line.get(name) for name in ("triangles", "steps", *COUNTED)}
        short |= {"verdict": verdict if good else line["status"], "CPU s": line.get("cpu_seconds")}
        table.append(short | counts)
    return sorted(table, key=lambda line: line["change"] if line["change"] is not None else 1e9)


def chart(study: Study, found: list[tuple[Variant, dict]], final: dict) -> str:
    """Bars of the change of each variant on a logarithmic axis, and of the cost saved."""
    lines = [line for _, line in found if line["status"] == "ok"]
    lines = [*sorted(lines, key=lambda line: line["change"]), final]
    at, name = np.arange(len(lines)), "needs"
    colour = [harness.COLOURS[0 if line["change"] <= study.tolerance else 1] for line in lines]
    size = (9.0, 1.6 + 0.32 * len(lines))
    with harness.figure(
        study.running["out"], name, log=False, panels=(1, 2), size=size, sharey=True
    ) as (figure, (left, right)):
        figure.suptitle(
            f"{study.scene.title or study.name}: blue can go at {percent(study.tolerance)}"
        )
        shown = [min(max(100 * line["change"], 1e-5), 1e4) for line in lines]
        left.barh(at, shown, left=1e-5, color=colour)
        told = [
            (i, 100 * line["predicted"]) for i, line in enumerate(lines) if line.get("predicted")
        ]
        if told:
            y, x = zip(*told, strict=True)
            left.plot(np.maximum(x, 1e-5), y, "kD", ms=5, mfc="w", label="foretold")
        left.axvline(100 * study.tolerance, color="k", ls="--", label="tolerance")
        left.set(xscale="log", xlabel="change of what is asked for [%]", xlim=(1e-5, 300))
        left.set_yticks(at, [line["variant"] for line in lines])
        left.legend(loc="upper left", bbox_to_anchor=(0.0, -0.14), ncols=2)
        right.barh(at, [100 * line["saved"] for line in lines], color=colour)
        right.set(xlabel="CPU seconds saved [%]", xlim=(-100, 100))
        right.axvline(0, color="k", lw=0.8)
        for i, line in enumerate(lines):
            if line["saved"] < -1:
                right.text(-96, i, f"{1 - line['saved']:.2g} × as many", va="center", color="w")
    return name


def asked(study: Study, options: argparse.Namespace) -> tuple[list, str, list[dict]]:
    """One scene from the numbers to its report: the findings, the conclusion, and the rows."""
    found = one_by_one(study)
    data, attempts = combined(study, found)
    final = reduced(study, data) | {"variant": "reduced.toml"}
    table = ranked(study, found)
    names = [line["variant"] for line in attempts if line["taken"] == "yes"]
    conclusion = sentence(study, names[-1] if names else "", final)
    print("\n".join([conclusion, *map(words, table)]))
    findings, rows = told(study, found, final), [line for _, line in found]
    harness.report(
        argparse.Namespace(**vars(options) | {"out": study.running["out"]}),
        f"What {study.name} does not need",
        rows,
        tables={
            "Numbers": numbers_of(Numbers.of(study.scene)),
            "One thing simpler": table,
            "Together": [*attempts, final],
        },
        figures=[chart(study, found, final)],
        findings=() if study.known else findings,  # those stand in the report of all three
        conclusion=conclusion,
        settings={"interest": study.interest.model_dump()},
    )
    return findings, conclusion, rows


def told(study: Study, found: list, final: dict) -> list[harness.Finding]:
    """That the reduced scene keeps the tolerance, and on known scenes what matters and what not."""
    name, low, high = study.name, study.tolerance, study.tolerance
    lines = {line["variant"]: line for _, line in found}
    change = final.get("change", math.nan)
    findings = [harness.Finding(f"{name}: change by reduced.toml", change, high=high)]
    findings.append(harness.Finding(f"{name}: seconds saved by it", final.get("saved", math.nan)))
    if not study.known:
        return findings
    needed, needless = (lines[variant] for variant in KNOWN[name])
    for key in ("predicted", "change"):
        findings.append(harness.Finding(f"{name}, {needed['variant']}: {key}", needed[key], low))
        what = f"{name}, {needless['variant']}: {key}"
        findings.append(harness.Finding(what, needless[key], high=high))
    return findings


def sentence(study: Study, gone: str, final: dict) -> str:
    """The conclusion in words."""
    if not gone:
        return f"At {percent(study.tolerance)} {study.name} needs all that it has."
    change, saved = (percent(final.get(key, math.nan)) for key in ("change", "saved"))
    return (
        f"At {percent(study.tolerance)} {study.name} does so: {gone}. That changes what is asked "
        f"for by {change} and saves {saved} of the CPU seconds."
    )


def percent(value: float) -> str:
    return f"{100 * value:.2g} %" if abs(value) < 1 else f"{100 * value:.0f} %"


def words(line: dict) -> str:
    """A row of the ranking for the terminal."""
    numbers = [
        "-" if line[key] is None else percent(line[key]) for key in ("predicted", "change", "saved")
    ]
    said = "foretold {:>9}  measured {:>9}  saves {:>7}".format(*numbers)
    return f"  {line['variant']:<28} {said}  {line['verdict']}"


def share(text: str) -> float:
    """A tolerance such as 1% or 0.01."""
    value = float(text.rstrip("% ")) / (100 if "%" in text else 1)
    if not 0 < value < 1:
        raise argparse.ArgumentTypeError(f"{text}: must lie between 0 and 100 %")
    return value


def main() -> int:
    options = harness.arguments(__doc__, tolerance={"type": share, "default": "1%"})
    known = [] if options.scene else [SCENES / f"{name}.toml" for name in KNOWN]
    done = [asked(Study.of(path, options), options) for path in known or [options.scene]]
    findings = [finding for found, _, _ in done for finding in found]
    if known:
        names = [path.stem for path in known]
        said = [f"[{n}]({n}/report.md): {d[1]}" for n, d in zip(names, done, strict=True)]
        harness.report(
            options,
            "What a scene does not need",
            [row for _, _, rows in done for row in rows],
            figures=[f"{name}/needs" for name in names],
            findings=findings,
            conclusion="\n\n".join(said),
        )
    return 0 if all(finding.met for finding in findings) else 1


if __name__ == "__main__":
    sys.exit(main())
