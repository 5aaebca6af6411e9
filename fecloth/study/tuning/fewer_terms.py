"""Terms that a scene does not need within a part of its tolerance."""

from __future__ import annotations

import tomllib
from dataclasses import replace

import numpy as np

from fecloth.errors import FeclothError
from fecloth.scene.toml_text import to_toml
from fecloth.study.problems import SceneProblem
from fecloth.study.scene_text import scene_of
from fecloth.study.simplification.variants import Variant, variants_of_term
from fecloth.study.tuning.choices import Choice
from fecloth.study.tuning.trials import Bench, Trial
from fecloth.terms import Springs
from fecloth.terms.traits import traits_of

SHARE = 0.25  # of the tolerance, for the terms that are left out or replaced
SAVES = 0.97  # times the seconds: what a change must at most cost to be worth it


def drop_terms(
    bench: Bench, choice: Choice, tolerance: float
) -> tuple[Bench, np.ndarray, list[str], list[Trial]]:
    """Leave out terms, or replace them by cheaper ones, as long as their changes are small.

    Return the reduced problem, (q,) its change of the quantities, the names of the changes and
    all runs; the runs take `choice`. Membranes are replaced, but not left out: in free fall they
    change nothing, and a cloth without one is none.
    """
    assert isinstance(bench.opened, SceneProblem)
    (full,) = bench.run([choice], timed=True)
    nothing = np.zeros(len(bench.quantities))
    if not full.is_ok:
        return bench, nothing, [], [full]
    data, trials, good = tomllib.loads(bench.opened.scene.to_toml()), [full], []
    known = {type(one).__name__: traits_of(one) for one in bench.opened.first.system.terms}
    membranes = {name for name, traits in known.items() if traits.kind == "membrane"}
    variants = [
        variant
        for term in data["terms"]
        for variant in variants_of_term(term, choice.element, known[term["type"]])
    ]
    for variant in variants:
        if variant.kind == "without" and variant.by in membranes - {Springs.__name__}:
            continue
        trial = _run(bench, variant.apply(data), choice)
        if trial is None:
            continue
        trials.append(trial)
        change = bench.distance(full, trial) if trial.is_ok else nothing + np.inf
        if change.max() <= SHARE * tolerance and trial.seconds < SAVES * full.seconds:
            good.append((trial.seconds - full.seconds, variant))
    taken: list[Variant] = []
    total = nothing
    for _, variant in sorted(good, key=lambda pair: pair[0]):
        if variant.slot in {one.slot for one in taken}:
            continue
        trial = _run(bench, variant.apply(data), choice)
        trials += [trial] if trial else []
        change = bench.distance(full, trial) if trial and trial.is_ok else nothing + np.inf
        if change.max() <= SHARE * tolerance:
            data, total = variant.apply(data), change
            taken.append(variant)
    scene = scene_of(to_toml(data), bench.opened.scene.trusts_geo)
    reduced = replace(bench, opened=SceneProblem(scene, bench.opened.name))
    return reduced, total, [one.name for one in taken], trials


def _run(bench: Bench, data: dict, choice: Choice) -> Trial | None:
    """Run the scene of some tables; None if it is refused."""
    assert isinstance(bench.opened, SceneProblem)
    try:
        scene = scene_of(to_toml(data), bench.opened.scene.trusts_geo)
    except FeclothError:
        return None
    changed = replace(bench, opened=SceneProblem(scene, bench.opened.name))
    return changed.run([choice], timed=True)[0]
