"""The sentences and the table of a simplified scene."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence

from fecloth.study.simplification.outcome import Outcome, Trial, judge
from fecloth.study.simplification.resolution import Resolution
from fecloth.study.tables import Table
from fecloth.study.tolerance import in_percent

COMBINED, REDUCED = "combined", "reduced scene"


def make_table(
    found: Sequence[Trial],
    tolerance: float,
    unresolved: Collection[str],
    attempts: Sequence[tuple[Outcome, bool]],
    final: Outcome | None,
) -> Table:
    """Return a row for each variant, by its change; then the combinations and the reduced scene."""
    ranked = sorted(found, key=lambda trial: trial[1].change)
    rows = [_row(one, judge(v, found, tolerance, unresolved)) for v, one in ranked]
    joint = [(one, fits) for one, fits in attempts if " + " in one.name]
    rows += [_row(one, f"{COMBINED}{'' if fits else ', not taken'}") for one, fits in joint]
    return Table((*rows, *([_row(final, REDUCED)] if final else [])))


def _row(outcome: Outcome, verdict: str) -> dict:
    line: dict = {"variant": outcome.name, "verdict": verdict}
    if outcome.predicted is not None:
        line["predicted [%]"] = 100 * outcome.predicted
    line |= {"change [%]": 100 * outcome.change if outcome.is_ok else None}
    line |= {f"{name} [%]": 100 * change for name, change in outcome.changes.items()}
    if outcome.is_ok:
        line |= {"seconds saved": outcome.whole - outcome.seconds, "saved [%]": 100 * outcome.saved}
        line |= {"cpu_seconds": outcome.seconds}
        line |= {"triangles": outcome.triangles, "steps": outcome.steps}
    line["status"] = outcome.status
    if outcome.cause:
        line["cause"] = outcome.cause.splitlines()[0]
    return line


def make_verdict(
    found: Sequence[Trial],
    tolerance: float,
    resolutions: Sequence[Resolution],
    reduced: str,
    final: Outcome | None,
    file: str = "reduced.toml",
) -> str:
    """Return the answer in words: first what is not resolved, then what is not needed."""
    unresolved = {one.kind for one in resolutions if not one.is_resolved}
    lines = [
        f"not resolved to {in_percent(tolerance)}: {one}"
        if not one.failure
        else f"not known whether it is resolved: {one}"
        for one in resolutions
        if not one.is_resolved
    ]
    groups = _groups(found, tolerance, unresolved)
    lines += [f"{head}: {', '.join(items)}" for head, items in groups if items]
    if final is None:
        return "\n".join([*lines, "nothing simpler was found"])
    last = (
        f"{file}: {reduced}; it changes {final.of} by {in_percent(final.change)} and "
        f"{'saves' if final.saved >= 0 else 'adds'} {in_percent(abs(final.saved))} of the seconds"
        if final.is_ok
        else f"{file} fails: {final.cause}"
    )
    return "\n".join([*lines, last])


def _groups(found: Sequence[Trial], tolerance: float, unresolved: Collection[str]) -> list[tuple]:
    """Return the items of the verdict by their heading."""
    gone, cheaper, needed, larger = (list[str]() for _ in range(4))
    for variant, one in sorted(found, key=lambda trial: trial[1].change):
        if variant.is_check:
            continue
        verdict = judge(variant, found, tolerance, unresolved)
        change = f"changes {one.of} by {in_percent(one.change)}" if one.is_ok else one.status
        if verdict in ("needed", "by chance"):
            name = variant.by if variant.kind == "without" else f"{variant.name} ({change})"
            (needed if variant.kind == "without" else larger).append(str(name))
        elif variant.kind == "without":
            costs = in_percent(one.saved) if one.saved > 0 else "none"
            gone.append(f"{variant.by} ({change}, costs {costs} of the seconds)")
        elif verdict == "not needed" and one.saved > 0:
            cheaper.append(f"{variant.name} ({change}, saves {in_percent(one.saved)})")
    return [
        ("not needed", gone or ["none of the terms"]),
        ("can be cheaper", cheaper),
        ("needed", needed),
        ("changes too much", larger),
    ]


def describe_resolved(resolutions: Sequence[Resolution], has_h: bool) -> list[str]:
    """Return sentences on the errors of the scene itself that are within the tolerance."""
    good = [str(one) for one in resolutions if one.is_resolved]
    lines = [f"Resolved: {'; '.join(good)}."] if good else []
    if not has_h:
        lines.append("Whether the mesh is resolved is not known: the scene has no cloth.h.")
    return lines


def describe_predictions(found: Sequence[Trial], tolerance: float, limits: Sequence[str]) -> str:
    """Return how far the predictions hold: by their assumptions, and against what was measured."""
    known = [one for _, one in found if one.is_ok and one.predicted is not None]
    if not known:
        return f"No predictions: {'; '.join(limits) or 'no variant has a formula'}."
    text = (
        "The predictions are orders of magnitude, for a cloth that starts flat and at rest under "
        "steady loads"
    )
    text += f". Beware: {'; '.join(limits)}" if limits else ", as here"
    wrong = [one for one in known if (_size(one) > tolerance) != (one.change > tolerance)]
    text += f". Against the runs, {len(known) - len(wrong)} of {len(known)} lie on the right side "
    text += "of the tolerance"
    if wrong:
        pairs = [
            f"{one.name} (predicted {in_percent(_size(one))}, measured {in_percent(one.change)})"
            for one in wrong
        ]
        text += f"; not so {', '.join(pairs)}"
    return text + "."


def _size(outcome: Outcome) -> float:
    return math.nan if outcome.predicted is None else outcome.predicted
