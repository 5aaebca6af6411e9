"""Simpler problems as values by name: cheaper terms or none, larger sizes, simpler steps."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from fecloth.simulation.quantity import Quantity
from fecloth.study.problem import StudyProblem
from fecloth.terms.traits import TermTraits, traits_of

# Factors of sizes: the first shows the error of the problem itself, the others may be cheaper.
FACTORS = {"h": (0.5, 1.5, 2.0), "dt": (0.5, 2.0, 4.0), "rtol": (0.25, 2.0, 4.0)}
WIDER_GAP = 2.0  # factor of the gap of contact
# Values of a scene that is the equilibrium to which its motion comes.
AT_REST = {
    "time": None,
    "solver": None,
    "equilibrium": {"load_steps": 1},
    "start.velocity": None,
    "output": {"frames": 1},
    "expect": None,  # which may name times
}


@dataclass(frozen=True)
class Variant:
    """Another problem, by the values that it has in place of the problem's own.

    Attributes
    ----------
    name
        Name in tables.
    slot
        The part of the problem that changes. Variants of different slots can be combined: the
        values of all of them hold together.
    values
        Its values by name, for `StudyProblem.at`.
    kind
        What changes: a size ("h", "dt" or "rtol"), "without" or "cheaper" for a term, a key of
        a term or of the scene.
    by
        The factor of a size or of a gap; the type of the term that is left out, or of the term
        that takes its place; else None.
    size
        The problem's own h [m], dt [s] or rtol [1/s], where it is multiplied by `by`; else 0.
    """

    name: str
    slot: str
    values: Mapping[str, Any]
    kind: str
    by: Any = None
    size: float = 0.0

    @property
    def is_check(self) -> bool:
        """Whether it refines a size, which shows the error of the problem itself."""
        return self.size > 0 and self.by < 1


@dataclass(frozen=True)
class TermVariant(Variant):
    """A problem in which a term is left out, cheaper, or replaced.

    Attributes
    ----------
    leaves_out_membrane
        Whether the term that is left out is a membrane, without which a cloth has no stretch.
    """

    leaves_out_membrane: bool = False


def simpler_terms(problem: StudyProblem) -> list[TermVariant]:
    """List the variants of all terms of a problem: without each, and with what is cheaper.

    Cheaper is a term of the same kind that its traits name, no friction, a wider gap, and on P2
    the strain at points in place of the interpolated strain. The slot of a variant is the key of
    its term, as "terms.2". A term keeps its number in the problem when other terms are left out,
    so that variants of different terms can be combined.
    """
    terms = problem.first.system.terms
    traits = {type(term).__name__: traits_of(term) for term in terms}
    variants = list[TermVariant]()
    for number, table in enumerate(problem.tables.get("terms", ())):
        variants += _variants_of_term(problem, number, table, traits[table["type"]])
    return variants


def _variants_of_term(
    problem: StudyProblem, number: int, table: Mapping, traits: TermTraits
) -> Iterator[TermVariant]:
    """Yield the variants of a term, which has this number and table."""
    name = table["type"]
    slot = f"terms.{number}"
    element = problem.tables["cloth"].get("element", "P1")
    gone = dict[str, Any]()  # what cannot stay without the term
    if problem.tables.get("expect"):  # which may name its columns
        gone["expect"] = None
    if traits.holds_normals:  # pins can be clamped only where a term holds the normals at them
        for i, pin in enumerate(problem.tables.get("pins", ())):
            if pin.get("clamp"):
                gone[f"pins.{i}.clamp"] = False
    yield TermVariant(
        name=f"without {name}",
        slot=slot,
        values={slot: None, **gone},
        kind="without",
        by=name,
        leaves_out_membrane=traits.kind == "membrane",
    )
    if table.get("friction"):
        values = {slot: {**table, "friction": 0.0}}
        yield TermVariant(f"no friction of {name}", slot, values, kind="friction")
    if table.get("gap"):
        values = {slot: {**table, "gap": WIDER_GAP * table["gap"]}}
        yield TermVariant(f"gap × {WIDER_GAP:g} of {name}", slot, values, "gap", WIDER_GAP)
    if element == "P2" and table.get("strain") == "interpolated":
        values = {slot: {**table, "strain": "pointwise"}}
        yield TermVariant(f"pointwise strain of {name}", slot, values, kind="strain")
    # Only the type is replaced: a bent rest shape would be lost.
    is_flat = traits.kind != "bending" or table.get("rest", "flat") in ("flat", None)
    if element == "P1" and is_flat:
        for other in traits.cheaper:
            values = {slot: {"type": other}, **gone}
            yield TermVariant(f"{other} for {name}", slot, values, "cheaper", other)


def list_variants(problem: StudyProblem, quantities: Sequence[Quantity]) -> list[Variant]:
    """List all variants: of the terms, of the sizes, and of the steps, as the quantities allow."""
    return [*simpler_terms(problem), *other_sizes(problem), *simpler_steps(problem, quantities)]


def other_sizes(problem: StudyProblem) -> Iterator[Variant]:
    """Yield the problem with other triangles and steps: a finer size as a check, and larger ones.

    A size that the problem does not have is left out, and so are steps longer than the run.
    """
    sizes = {"h": problem.h, "dt": problem.dt, "rtol": problem.rtol}
    for kind, size in sizes.items():
        longest = problem.span if kind == "dt" and problem.span else math.inf
        for factor in FACTORS[kind]:
            if size and size * factor <= longest * (1 + 1e-9):  # 1e-9 is round-off
                slot = "mesh" if kind == "h" else "time"
                values = problem.finer_values(**{kind: 1 / factor})
                yield Variant(f"{kind} × {factor:g}", slot, values, kind, factor, size)


def simpler_steps(problem: StudyProblem, quantities: Sequence[Quantity]) -> Iterator[Variant]:
    """Yield the problem with a simpler element or method.

    These are linear triangles, explicit steps, and a single load step, unless the equilibrium
    depends on how the loads grow. A motion of which only the end counts also becomes an
    equilibrium, unless its pins move or its contact has friction: then its end depends on the
    motion. The element and the method of a function are its own.
    """
    source = problem.source
    tables = problem.tables
    if "element" in source.keys and tables["cloth"].get("element") == "P2":
        yield Variant("P1 for P2", "element", source.values_of({"element": "P1"}), "element")
    if problem.is_static:
        follows_loads = any(bound.load_steps > 1 for bound in problem.first.system.bound)
        if tables["equilibrium"].get("load_steps", 1) > 1 and not follows_loads:
            yield Variant("one load step", "time", {"equilibrium.load_steps": 1}, "load steps")
        return
    if "method" not in tables["time"]:
        return
    if not problem.is_explicit and source.method != "auto":
        values = source.values_of({"method": "central_difference"})
        yield Variant("explicit", "time", values, "method")
    has_moving_pins = any(pin.get("motion") or pin.get("rotate") for pin in tables.get("pins", ()))
    has_friction = any(term.get("friction") for term in tables.get("terms", ()))
    counts_end_only = all(q.how == "value" and q.at is None for q in quantities)
    if counts_end_only and not (has_moving_pins or has_friction):
        yield Variant("equilibrium", "time", AT_REST, "equilibrium")
