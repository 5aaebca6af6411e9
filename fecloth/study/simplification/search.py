"""Search for the simplest scene: the useful variants, combined."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from fecloth.study.simplification.outcome import LOST, NOISE, Outcome, Trial, reliable_change
from fecloth.study.simplification.runs import Original
from fecloth.study.simplification.variants import Variant


def saving_per_change(outcome: Outcome) -> float:
    """Return the saving per change, by which variants are sorted; without saving it is ≤ 0."""
    saved = outcome.saved
    return saved / max(outcome.change, 1e-12) if saved > 0 else saved


def sort_candidates(
    found: Sequence[Trial], tolerance: float, unresolved: Collection[str]
) -> list[Variant]:
    """Return the variants within the tolerance, the greatest saving per change first.

    A replacement must save time; a dropped term need not. Larger triangles and steps are
    candidates only if the scene itself is resolved.
    """
    able = [
        (variant, outcome)
        for variant, outcome in found
        if outcome.is_ok
        and not variant.is_check
        and reliable_change(variant, found, unresolved) <= tolerance
        and (not outcome.is_slower if variant.kind == "without" else outcome.saved > LOST)
    ]
    return [variant for variant, _ in sorted(able, key=lambda pair: -saving_per_change(pair[1]))]


def combine_variants(
    original: Original, candidates: Sequence[Variant]
) -> tuple[dict, list[tuple[Outcome, bool]]]:
    """Combine variants greedily; return the tables of the last scene, and all attempts.

    Of two changes to the same part the later one wins if it saves more or drops a term. An
    attempt is a run, and whether it was taken.
    """
    chosen: dict[str, Variant] = {}
    data, seconds, attempts = original.data, original.full["cpu_seconds"], []
    for variant in candidates:
        before = chosen.get(variant.slot)
        if before and before.kind == "without":
            continue
        trial = {**chosen, variant.slot: variant}
        simpler = original.data
        for one in trial.values():
            simpler = one.apply(simpler)
        names = " + ".join(one.name for one in trial.values())
        outcome = original.run_one(names, simpler)
        most = (1 + LOST if variant.kind == "without" or not before else 1 - LOST) * seconds
        most += NOISE if variant.kind == "without" else 0.0
        fits = outcome.change <= original.tolerance and outcome.seconds <= most
        attempts.append((outcome, fits))
        if fits:
            chosen, data, seconds = trial, simpler, outcome.seconds
    return data, attempts
