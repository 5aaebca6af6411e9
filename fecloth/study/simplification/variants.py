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
# s, a step of backward Euler in which inertia is negligible: it lasts a day, a motion seconds.
LONG_STEP = 1e5
LARGER_STEPS = (2, 4)  # factors of dt and rtol
LARGER_TRIANGLES = (1.5, 2.0)  # factors of h
WIDER_GAP = 2.0  # factor of the gap of contact
FINER = 0.5  # factor of h and dt; its square of rtol
# CPU time that a run may take, over the time of the full scene: a slower variant saves nothing.
PATIENCE = 3.0


@dataclass(frozen=True)
class Variant:
    """A change of a scene, and what it is.

    Attributes
    ----------
    name
        Name in the tables.
    kind
        Kind of the change.
    by
        Its factor, or the type of the term that is left out or takes another's place.
    slot
        The part that changes; the reduced scene has at most one change of each part.
    apply
        The edit of the tables of the scene.
    is_check
        True for a refinement, which shows errors and is not taken.
    size
        h, dt or rtol of the scene, where the variant multiplies it by `by`; else 0.
    """

    name: str
    kind: str
    by: Any
    slot: str
    apply: Edit
    is_check: bool = False
    size: float = 0.0

    @property
    def patience(self) -> float:
        """Largest CPU time, as a multiple of the full scene's.

        Half of dt takes twice the steps; half of h four times the triangles, and up to twice the
        steps.
        """
        if not self.is_check:
            return PATIENCE
        if self.kind == "mesh":
            return PATIENCE / FINER**3
        return PATIENCE / FINER


def changes_of(variants: Iterable[Variant]) -> Change:
    """Return the change by several variants."""
    return Change(edits=tuple(variant.apply for variant in variants))


def put(cloth: Mapping | None = None, **tables: object) -> Edit:
    """Return the edit that sets values of [cloth] and replaces other tables by name.

    None in place of a table removes it.
    """

    def edit(data: Data) -> Data:
        return data | {"cloth": data["cloth"] | (cloth or {})} | tables

    return edit


def list_variants(
    data: Data, interest: Interest, traits: Mapping[str, TermTraits] = TRAITS
) -> list[Variant]:
    """Return all variants of a scene: of its terms, of its mesh, and of its time or load steps.

    `data` are the tables of the scene. A motion whose end alone is of interest also has static
    variants. `traits` are the traits of the terms by their types.
    """
    element = data["cloth"].get("element", "P1")
    variants: list[Variant] = []
    for term in data.get("terms", []):
        variants += variants_of_term(term, element, traits[term["type"]])
    variants += [*variants_of_mesh(data), *variants_of_time(data)]
    if interest.at_end_only and "time" in data:
        variants += _variants_of_rest(data)
    return variants


def _variants_of_rest(data: Data) -> Iterator[Variant]:
    """Yield static scenes in place of a motion whose end alone counts.

    Its end is no equilibrium of its own where pins move or where contact has friction.
    """
    has_moving_pins = any(pin.get("motion") or pin.get("rotate") for pin in data.get("pins", []))
    has_friction = any(term.get("friction") for term in data.get("terms", []))
    if not (has_moving_pins or has_friction):
        yield Variant("equilibrium", "static", None, "time", equilibrium_of(data))
    yield Variant("one long step", "static", None, "time", long_step_of(data))


def variants_of_term(term: Data, element: str, traits: TermTraits) -> Iterator[Variant]:
    """Yield the variants of a term: without it, with cheaper values, and with a cheaper term.

    `term` is its table, and `element` the element of the mesh.
    """
    name = term["type"]
    slot = f"term {term}"
    # pins can be clamped only where a term holds the normals at them
    unclamps = traits.holds_normals
    yield Variant(f"without {name}", "without", name, slot, replace_term(term, None, unclamps))
    for words, key, value in _cheaper_values(term, element):
        yield Variant(words, key, name, slot, replace_term(term, term | {key: value}))
    # the replacement would take only its type: a bent rest shape would be lost
    has_flat_rest = traits.kind != "bending" or term.get("rest", "flat") in ("flat", None)
    if has_flat_rest and element == "P1":
        for other in traits.cheaper:
            replaced = replace_term(term, {"type": other}, unclamps)
            yield Variant(f"{other} for {name}", "cheaper", other, slot, replaced)


def _cheaper_values(term: Data, element: str) -> Iterator[tuple[str, str, object]]:
    """Yield cheaper values of a term: in words, its key, and the value."""
    name = term["type"]
    if term.get("friction"):
        yield f"no friction of {name}", "friction", 0.0
    if "gap" in term:
        yield f"gap × {WIDER_GAP:g} of {name}", "gap", WIDER_GAP * term["gap"]
    if element == "P2" and term.get("strain") == "interpolated":
        yield f"pointwise strain of {name}", "strain", "pointwise"


def replace_term(term: Data, other: Data | None, unclamps: bool = False) -> Edit:
    """Return the edit that replaces a term by the table `other`, or removes it if that is None.

    The edit also removes the entries of [expect] for the columns of the term, which the run no
    longer has. If it `unclamps`, it removes the clamps of all pins.
    """

    def edit(data: Data) -> Data:
        if unclamps:
            data = data | {"pins": [pin | {"clamp": False} for pin in data.get("pins", [])]}
        terms = [other if own == term else own for own in data["terms"]]
        columns = {head + term["type"] for head in ("", "dissipated:", "work:")}
        expect = data.get("expect", {})
        kept = {column: value for column, value in expect.items() if column not in columns}
        return data | {"terms": [own for own in terms if own], "expect": kept}

    return edit


def variants_of_mesh(data: Data) -> Iterator[Variant]:
    """Yield scenes with other triangles: a smaller h as a check, larger ones, and P1 for P2.

    A mesh without h in [cloth] has no other h.
    """
    cloth = data["cloth"]
    if "h" in cloth:
        h = cloth["h"]
        for factor in (FINER, *LARGER_TRIANGLES):
            yield Variant(
                name=f"h × {factor:g}",
                kind="mesh",
                by=factor,
                slot="mesh",
                apply=put({"h": h * factor}),
                is_check=factor < 1,
                size=h,
            )
    if cloth.get("element") == "P2":
        yield Variant("P1 for P2", "P1", None, "element", put({"element": "P1"}, mass="lumped"))


def variants_of_time(data: Data) -> Iterator[Variant]:
    """Yield scenes with other steps: another dt or rtol, or explicit steps.

    A smaller dt or rtol is a check. Explicit steps at their stability limit have neither. A
    static scene has the variants of its load steps.
    """
    if "time" not in data:
        yield from _variants_of_load_steps(data)
        return
    time = data["time"]
    key = "rtol" if time["dt"] == "auto" else "dt"
    is_explicit = method_name(data) in EXPLICIT
    is_at_limit = key == "rtol" and is_explicit and not {"rtol", "atol"} & set(time)
    if not is_at_limit:
        finer = FINER if key == "dt" else FINER**2
        for factor in (finer, *LARGER_STEPS):
            if key == "dt" and number_of_steps(time, factor) == number_of_steps(time, 1):
                continue  # the same number of steps, as where there is only one
            yield Variant(
                name=f"{key} × {factor:g}",
                kind=key,
                by=factor,
                slot="time",
                apply=multiply_step(data, key, factor),
                is_check=factor < 1,
                size=time.get(key, Adaptive.rtol),
            )
    if not is_explicit and method_name(data) != "auto":
        yield Variant("explicit", "explicit", None, "time", explicit_steps_of(data))


def _variants_of_load_steps(data: Data) -> Iterator[Variant]:
    """Yield an equilibrium with one load step, unless its friction follows the loads."""
    static = data["equilibrium"]
    has_friction = any(term["type"] == "BendingFriction" for term in data.get("terms", []))
    if static.get("load_steps", 1) > 1 and not has_friction:
        edit = put(equilibrium=static | {"load_steps": 1})
        yield Variant("one load step", "load steps", None, "time", edit)


def number_of_steps(time: Data, factor: float) -> int:
    """Return the number of steps with dt times a factor."""
    steps = (time["t_end"] - time.get("t_start", 0.0)) / (factor * time["dt"])
    return math.ceil(steps - 1e-9)  # 1e-9 is round-off


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
    """Return the edit to the equilibrium, in place of a motion that comes to rest.

    What belongs to a motion is left out; so is [expect], because it may name times.
    """
    start = {key: value for key, value in data.get("start", {}).items() if key != "velocity"}
    static = {"equilibrium": {"load_steps": 1}, "start": start, "output": {"frames": 1}}
    return put(time=None, solver=None, expect={}, **static)


def long_step_of(data: Data) -> Edit:
    """Return the edit to one step of backward Euler, so long that ρ Δx/dt² is negligible.

    Newton's method needs a clamped tangent, because it starts far from the end. [expect] is
    dropped, because it may name times before the end.
    """
    end = data["time"]["t_end"]
    start = end - LONG_STEP
    time = {"method": "backward_euler", "dt": LONG_STEP, "t_start": start, "t_end": end}
    solver = {**data.get("solver", {}), "tolerance": 1e-9, "definiteness": "clamp"}
    return put(time=time, solver=solver, output={"every_steps": 1}, expect={})


def method_name(data: Data) -> str:
    """Return the name of the method, which may be a text or a table."""
    method = data["time"]["method"]
    if isinstance(method, str):
        return method
    return method["type"]
