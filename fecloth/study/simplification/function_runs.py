"""Runs of a user's function, and of the same with other terms, meshes and steps."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

from fecloth import terms
from fecloth.errors import is_number
from fecloth.mesh.cloth import Cloth
from fecloth.study.levels import FIRST
from fecloth.study.measured_runs import setup_of_importable
from fecloth.study.setups import Setup
from fecloth.study.simplification.runs import Original, measure_fastest
from fecloth.study.simplification.variants import Data, Variant
from fecloth.study.status import attempt
from fecloth.terms.traits import parameters_of, traits_of

KINDS = ("without", "cheaper", "strain", "mesh", "dt")  # of its variants


def run_function_variant(
    variant: str,
    path: str,
    name: str,
    digest: str,
    settings: dict,
    dt: float | None,
    t_end: float | None,
    probes: list,
    terms: list,
    recorded: list,
    modes: int,
    repeats: int,
    most: float | None = None,
) -> dict:
    """Run what the function of a file returns with other terms; return the row of its fastest run.

    `terms` are as `FunctionOriginal.data` has them; the other arguments are those of `run_function`
    and `run_variant`.
    """
    setup = setup_of_importable(path, name, settings, dt, t_end, probes, None)
    return measure_fastest(with_terms(setup, terms), recorded, modes, repeats, most)


def with_terms(setup: Setup, terms: Sequence[Mapping]) -> Setup:
    """Return the setup with some of its terms, or others in their place.

    The clamps of pins go with the last term that holds normals.
    """
    old = setup.system
    new = tuple(_make(term, old.terms) for term in terms)
    holds = any(traits_of(term).holds_normals for term in new)
    pins = old.pins if holds else tuple(_unclamped(pin) for pin in old.pins)
    return replace(setup, system=replace(old, terms=new, pins=pins))


def _make(term: Mapping, own: Sequence) -> Any:
    if "number" not in term:
        return getattr(terms, term["type"])()
    kept = own[term["number"]]
    strain = term.get("strain")
    return kept if strain == parameters_of(kept).get("strain") else replace(kept, strain=strain)


def _unclamped(pin: Any) -> Any:
    return replace(pin, clamp=False) if getattr(pin, "clamp", False) else pin


class FunctionOriginal(Original):
    """A user's function to simplify: the terms of its system, and its h and dt."""

    runner = staticmethod(run_function_variant)
    reduced_file = "reduced.txt"

    @cached_property
    def data(self) -> Data:
        """What can change, in the form of a scene's tables."""
        first, h, dt = self.problem.first, self.problem.h, self.problem.dt
        cloth: Data = {"element": first.cloth.element} | ({} if h is None else {"h": h})
        terms = [_describe(term, i) for i, term in enumerate(first.system.terms)]
        data: Data = {"cloth": cloth, "terms": terms, "output": {}}
        if first.is_static:
            return data | {"equilibrium": {}}
        if dt is None:  # the method chooses its steps
            return data | {"time": {"dt": "auto", "method": "auto"}}
        return data | {"time": {"dt": dt, "t_end": self.problem.t_end, "method": "auto"}}

    def list_variants(self) -> list[Variant]:
        """List the variants of terms, mesh and steps; the method is the function's own."""
        return [one for one in super().list_variants() if one.kind in KINDS]

    def text(self, data: Data) -> str:
        """Return the names of the terms, h and dt."""
        lines = [f"terms: {', '.join(term['type'] for term in data['terms']) or 'none'}"]
        lines += [f"strain of {t['type']}: {t['strain']}" for t in data["terms"] if "strain" in t]
        sizes = {"h": data["cloth"].get("h"), "dt": data.get("time", {}).get("dt")}
        lines += [f"{name} = {size:g}" for name, size in sizes.items() if is_number(size)]
        return "\n".join(lines) + "\n"

    def reread(self, data: Data) -> Data:
        """Return the same tables: they are no scene."""
        return data

    def mesh(self, row: Mapping) -> Cloth:
        """Return the cloth of a run."""
        given = (row[key] for key in ("path", "name", "settings", "dt", "t_end", "probes"))
        return setup_of_importable(*given).cloth

    def case_of(self, data: Data) -> dict[str, Any]:
        """Return what `run_function_variant` needs of the tables."""
        case = self.problem.reference(FIRST)
        settings, dt = dict(case["settings"]), case["dt"]
        if "h" in data["cloth"]:
            settings["h"] = data["cloth"]["h"]
        if dt is not None:
            span = self.problem.t_end
            settings["dt"] = dt = span / math.ceil(span / data["time"]["dt"] - 1e-9)
        return case | {"settings": settings, "dt": dt, "terms": data["terms"]}

    def _rows(self, cases: list[dict], fresh: bool) -> list[dict]:
        if self.problem.is_importable:
            return super()._rows(cases, fresh)
        limit = self.runs.time_limit
        return [{**case, **attempt(self.runner, case, limit)} for case in cases]


def _describe(term: Any, number: int) -> Data:
    """Return what variants need to know of a term."""
    found: Data = {"type": type(term).__name__, "number": number}
    given = parameters_of(term)
    if isinstance(given.get("strain"), str):
        found["strain"] = term.strain
    if "rest" in given:
        found["rest"] = term.rest if isinstance(term.rest, str) else "given"
    return found
