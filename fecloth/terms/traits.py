"""What a term is, said on the class of its description."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from fecloth.errors import InputError, brief

KINDS = ("", "membrane", "bending", "damping", "drag", "load", "contact")


@dataclass(frozen=True)
class TermTraits:
    """What a term is, for warnings, studies, error estimates and several processes.

    Parameters
    ----------
    kind
        "membrane" (resists stretch, as springs do), "bending", "damping", "drag" (of the air),
        "load", "contact", or "" for none of these.
    elements
        The elements that it supports, of "P1" and "P2".
    exclusive
        Whether it stands for all of its kind, so that two of them count twice.
    several_places
        Whether it may stand several times among the terms, with other parameters.
    shared
        Whether several processes can share it.
    cheaper
        The names of terms that may stand in its place on P1, at less cost.
    by_pattern
        Whether its stiffness depends on the pattern of the mesh, so that no refinement converges.
    holds_normals
        Whether clamped pins may hold the normals of the cloth by it.
    space_error
        Why `space_error` has no estimate with it, after its name; "" if it has one.

    Raises
    ------
    InputError
        For another kind.
    """

    kind: str = ""
    elements: tuple[str, ...] = ("P1",)
    exclusive: bool = False
    several_places: bool = True
    shared: bool = False
    cheaper: tuple[str, ...] = ()
    by_pattern: bool = False
    holds_normals: bool = False
    space_error: str = ""

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            allowed = f"must be one of {', '.join(map(repr, KINDS))}"
            raise InputError(f"kind = {self.kind!r}", allowed, "TermTraits")


def traits_of(term: Any) -> TermTraits:
    """The traits of a description or of its class; without them, what its attributes say.

    Raises
    ------
    InputError
        For `traits` that are no `TermTraits`.
    """
    traits = getattr(term, "traits", None)
    if traits is None:
        return TermTraits(
            elements=getattr(term, "elements", ("P1",)),
            holds_normals=getattr(term, "holds_normals", False),
            space_error=getattr(term, "no_space_error", ""),
        )
    if not isinstance(traits, TermTraits):
        name = (term if isinstance(term, type) else type(term)).__name__
        raise InputError(f"{name}.traits = {brief(traits)}", "must be a TermTraits(kind=...)", name)
    return traits
