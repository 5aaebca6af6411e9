"""Simpler scenes to try, each a change of the tables of a scene."""

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from fecloth.integrators import EXPLICIT
from fecloth.scene.probe_tables import Interest
from fecloth.simulation.error_control import Adaptive
from fecloth.study.change import Change, Edit
from fecloth.terms import TRAITS
from fecloth.terms.traits import TermTraits

Data = dict
LONG = 1e5  # s, a step of backward Euler in which inertia is negligible
LARGER = (2, 4)  # times dt, rtol
COARSER = (1.5, 2.0)  # times h
WIDER = 2.0  # times the gap of contact
FINER = 0.5  # times h, dt; for rtol twice that power
PATIENCE = 3.0  # times the seconds of the full scene; a slower variant saves nothing


@dataclass(frozen=True)
class Variant:
    """A change of a scene, and what it is."""

    name: str  # in the tables
    kind: str  # of the change
    by: Any  # its factor, or the type of the term that is left out or stands in another's place
    slot: str  # the part that changes; the reduced scene has at most one change of each part
    apply: Edit  # of the tables of the scene
    is_check: bool = False  # True for a refinement, which shows errors and is not taken
    size: float = 0.0  # h, dt or rtol of the scene, where the variant multiplies it by `by`

    @property
    def patience(self) -> float:
        """Largest CPU time, as a multiple of the full scene's."""
        if not self.is_check:
            return PATIENCE
        return 20.0 if self.kind == "mesh" else 6.0


def changes_of(variants: Iterable[Variant]) -> Change:
    return Change(edits=tuple(variant.apply for variant in variants))


def put(cloth: Mapping | None = None, **tables: object) -> Edit:
    """Return the edit that sets values of [cloth] and replaces other tables; None removes one."""

    def edit(data: Data) -> Data:
        return data | {"cloth": data["cloth"] | (cloth or {})} | tables

    return edit


def list_variants(
    data: Data, interest: Interest, traits: Mapping[str, TermTraits] = TRAITS
) -> list[Variant]:
    """List all variants of a scene, terms first; `traits` says what its terms are."""
    element = data["cloth"].get("element", "P1")
    terms = data.get("terms", [])
    variants = [v for term in terms for v in variants_of_term(term, element, traits[term["type"]])]
    variants += [*variants_of_mesh(data), *variants_of_time(data)]
    if interest.at_end_only and "time" in data:
        moved = any(pin.get("motion") or pin.get("rotate") for pin in data.get("pins", []))
        if not (moved or any(term.get("friction") for term in terms)):
            variants.append(Variant("equilibrium", "static", None, "time", equilibrium_of(data)))
        variants.append(Variant("one long step", "static", None, "time", long_step_of(data)))
    return variants


def variants_of_term(term: Data, element: str, traits: TermTraits) -> Iterator[Variant]:
    """Yield the scene without a term, and with a cheaper one in its place: as smooth contact."""
    name = term["type"]
    slot = f"term {term}"
    unclamps = traits.holds_normals
    yield Variant(f"without {name}", "without", name, slot, replace_term(term, None, unclamps))
    others: list[tuple[str, str, object]] = []
    if term.get("friction"):
        others.append((f"no friction of {name}", "friction", 0.0))
    if "gap" in term:
        others.append((f"gap × {WIDER:g} of {name}", "gap", WIDER * term["gap"]))
    if element == "P2" and term.get("strain") == "interpolated":
        others.append((f"pointwise strain of {name}", "strain", "pointwise"))
    for words, kind, value in others:
        yield Variant(words, kind, name, slot, replace_term(term, term | {kind: value}))
    is_flat = traits.kind != "bending" or term.get("rest", "flat") in ("flat", None)
    if is_flat and element == "P1":
        for other in traits.cheaper:
            replaced = replace_term(term, {"type": other}, unclamps)
            yield Variant(f"{other} for {name}", "cheaper", other, slot, replaced)


def replace_term(term: Data, other: Data | None, unclamps: bool = False) -> Edit:
    """Return the edit that replaces a term by `other`, or removes it if that is None.

    It also removes the entries of [expect] for its columns, and clamps of pins if it
    `unclamps`.
    """

    def edit(data: Data) -> Data:
        if unclamps:
            data = data | {"pins": [pin | {"clamp": False} for pin in data.get("pins", [])]}
        terms = [other if own == term else own for own in data["terms"]]
        removed = {head + term["type"] for head in ("", "dissipated:", "work:")}
        expect = {key: value for key, value in data.get("expect", {}).items() if key not in removed}
        return data | {"terms": [own for own in terms if own], "expect": expect}

    return edit


def variants_of_mesh(data: Data) -> Iterator[Variant]:
    """Yield scenes with smaller and larger triangles, and with P1 instead of P2."""
    cloth = data["cloth"]
    for factor in (FINER, *COARSER) if "h" in cloth else ():
        edit = put({"h": cloth["h"] * factor})
        is_check = factor < 1
        yield Variant(f"h × {factor:g}", "mesh", factor, "mesh", edit, is_check, cloth["h"])
    if cloth.get("element") == "P2":
        yield Variant("P1 for P2", "P1", None, "element", put({"element": "P1"}, mass="lumped"))


def variants_of_time(data: Data) -> Iterator[Variant]:
    """Yield scenes with other steps or tolerances, and with explicit steps."""
    if "time" not in data:
        static = data["equilibrium"]
        follows = any(term["type"] == "BendingFriction" for term in data.get("terms", []))
        if static.get("load_steps", 1) > 1 and not follows:
            edit = put(equilibrium=static | {"load_steps": 1})
            yield Variant("one load step", "load steps", None, "time", edit)
        return
    time = data["time"]
    key = "rtol" if data["time"]["dt"] == "auto" else "dt"
    explicit = method_name(data) in EXPLICIT
    at_limit = key == "rtol" and explicit and not {"rtol", "atol"} & set(time)
    finer = FINER if key == "dt" else FINER**2
    for factor in () if at_limit else (finer, *LARGER):
        if key == "rtol" or number_of_steps(time, factor) != number_of_steps(time, 1):
            edit = multiply_step(data, key, factor)
            size = time.get(key, Adaptive.rtol)
            yield Variant(f"{key} × {factor:g}", key, factor, "time", edit, factor < 1, size)
    if not explicit and method_name(data) != "auto":
        yield Variant("explicit", "explicit", None, "time", explicit_steps_of(data))


def number_of_steps(time: Data, factor: float) -> int:
    """Return the number of steps with dt times a factor."""
    return math.ceil((time["t_end"] - time.get("t_start", 0.0)) / (factor * time["dt"]) - 1e-9)


def multiply_step(data: Data, key: str, factor: float) -> Edit:
    """Return the edit that multiplies dt or rtol; frames come no more often than steps."""
    size = data["time"].get(key, Adaptive.rtol) * factor
    tables = {"time": data["time"] | {key: size}}
    every = data["output"].get("every")
    if key == "dt" and every and every < size:
        tables["output"] = {"every": size}
    return put(**tables)


def explicit_steps_of(data: Data) -> Edit:
    """Return the edit to central differences at 0.9 of their stability limit."""
    span = {key: data["time"][key] for key in ("t_start", "t_end") if key in data["time"]}
    return put(time={"method": "central_difference", "dt": "auto", **span}, mass="lumped")


def equilibrium_of(data: Data) -> Edit:
    """Return the edit to the equilibrium, in place of a motion that comes to rest."""
    # What belongs to a motion is left out; [expect] is, too, because it may name times.
    start = {key: value for key, value in data.get("start", {}).items() if key != "velocity"}
    static = {"equilibrium": {"load_steps": 1}, "start": start, "output": {"frames": 1}}
    return put(time=None, solver=None, expect={}, **static)


def long_step_of(data: Data) -> Edit:
    """Return the edit to one step of backward Euler, so long that ρ Δx/dt² is negligible.

    Newton's method needs a clamped tangent, because it starts far from the end. [expect] is
    dropped, because it may name times before the end.
    """
    end = data["time"]["t_end"]
    time = {"method": "backward_euler", "dt": LONG, "t_start": end - LONG, "t_end": end}
    solver = {**data.get("solver", {}), "tolerance": 1e-9, "definiteness": "clamp"}
    return put(time=time, solver=solver, output={"every_steps": 1}, expect={})


def method_name(data: Data) -> str:
    method = data["time"]["method"]
    if isinstance(method, str):
        return method
    return method["type"]
