"""Simpler problems as values by name: without a term, or with a cheaper one in its place."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from fecloth.study.problem import StudyProblem
from fecloth.terms.traits import TermTraits, traits_of

WIDER_GAP = 2.0  # factor of the gap of contact


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
    its term, as "terms.2". Numbers of terms are those of the problem also when some are left out,
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
