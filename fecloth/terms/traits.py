"""What a term is, said on the class of its description."""

from collections.abc import Iterable
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any

from fecloth.errors import InputError, brief

KINDS = ("", "membrane", "bending", "damping", "drag", "load", "contact")
BOTH = ("P1", "P2")
DAMPED = ("", "air", "strain", "bending", "motion")
PLAIN = {  # traits that a description may state as plain attributes, and their names there
    "elements": "elements",
    "holds_normals": "holds_normals",
    "space_error": "no_space_error",
}


@dataclass(frozen=True)
class TermTraits:
    """What a term is, for warnings, studies, error estimates and several processes.

    Raises `InputError` for another kind or element, and for what else a damping cannot damp.

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
        Whether it may stand several times among the terms, if it is not exclusive.
    shared
        Whether several processes can share it.
    reach
        How many rings of triangles around a node its force and its error there depend on.
    cheaper
        The names of terms that may stand in its place on P1, at less cost.
    as_fabric
        Whether it is as stiff as the fabric, of a membrane.
    by_pattern
        Whether it bends with a rigidity that depends on the pattern of the mesh, however fine.
    holds_normals
        Whether clamped pins may hold the normals of the cloth by it.
    damps
        By what a term damps, and the numbers that it then has: "motion", with a `rate` c [1/s];
        "strain" or "bending", with a `time` τ [s]; "air", with the fields of `Drag`. "" for any
        other: studies do not predict what it does.
    space_error
        Why `space_error` has no estimate with it, after its name; "" if it has one.
    """

    kind: str = ""
    elements: tuple[str, ...] = ("P1",)
    exclusive: bool = False
    several_places: bool = True
    shared: bool = False
    reach: int = 3
    cheaper: tuple[str, ...] = ()
    as_fabric: bool = False
    by_pattern: bool = False
    holds_normals: bool = False
    damps: str = ""
    space_error: str = ""

    def __post_init__(self) -> None:
        for name, known in (("kind", KINDS), ("damps", DAMPED)):
            value = getattr(self, name)
            if value not in known:
                allowed = f"must be one of {', '.join(map(repr, known))}"
                raise InputError(f"{name} = {value!r}", allowed, "TermTraits")
        if tuple(self.elements) not in (("P1",), ("P2",), BOTH, BOTH[::-1]):
            allowed = 'must be ("P1",), ("P2",) or ("P1", "P2")'
            raise InputError(f"elements = {self.elements!r}", allowed, "TermTraits")


# any law
MEMBRANE = TermTraits("membrane", BOTH, exclusive=True, shared=True, cheaper=("Springs",))
OF_FABRIC = replace(MEMBRANE, as_fabric=True)
BENDING = TermTraits("bending", exclusive=True, shared=True)
OF_MESH = "bends with a rigidity that depends on the mesh"
HINGES = replace(BENDING, by_pattern=True, space_error=OF_MESH)
DRAG = TermTraits("drag", exclusive=True, shared=True, damps="air")
DAMPING = TermTraits("damping", BOTH, several_places=False, shared=True)
LOAD = TermTraits("load", BOTH, shared=True)
CONTACT = TermTraits("contact", BOTH)


def traits_of(term: Any) -> TermTraits:
    """The traits of a description or of its class, with what its plain attributes say."""
    traits = getattr(term, "traits", TermTraits())
    if not isinstance(traits, TermTraits):
        name = (term if isinstance(term, type) else type(term)).__name__
        raise InputError(f"{name}.traits = {brief(traits)}", "must be a TermTraits(kind=...)", name)
    said = {trait: getattr(term, name) for trait, name in PLAIN.items() if hasattr(term, name)}
    return replace(traits, **said) if said else traits


def parameters_of(term: Any) -> dict[str, Any]:
    """The parameters of a description by their names; of one that is no dataclass, none."""
    if is_dataclass(term):
        return {one.name: getattr(term, one.name) for one in fields(term)}
    return {}


def has_kind(terms: Iterable[Any], kind: str) -> bool:
    """Whether a term of a kind is among the descriptions or classes."""
    return any(traits_of(term).kind == kind for term in terms)
