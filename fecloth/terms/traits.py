"""What a term is, said on the class of its description."""

from collections.abc import Iterable
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any

from fecloth.errors import InputError, brief

KINDS = ("", "membrane", "bending", "damping", "drag", "load", "contact")
BOTH = ("P1", "P2")
DAMPED = ("", "air", "strain", "bending", "motion")
PLAIN = {  # traits that a description may have as attributes of its own, and their names there
    "elements": "elements",
    "holds_normals": "holds_normals",
    "space_error": "no_space_error",
}


@dataclass(frozen=True)
class TermTraits:
    """What a term is, for warnings, studies, error estimates and several processes.

    Raises `InputError` for an unknown kind, for unknown elements, and for an unknown `damps`.

    Parameters
    ----------
    kind
        "membrane" (resists stretch, as springs do), "bending", "damping", "drag" (of the air),
        "load", "contact", or "" for none of these.
    elements
        The elements that it supports, of "P1" and "P2".
    exclusive
        Whether a cloth should have one term of the kind: two terms count the same force twice.
    several_places
        Whether the terms may have it several times, if it is not exclusive.
    shared
        Whether several processes can share it.
    reach
        Number of rings of triangles around a node on which its force and its error there depend.
    cheaper
        The names of terms that may replace it on P1, at less cost.
    as_fabric
        Whether a membrane has the stiffness of the fabric.
    by_pattern
        Whether its bending rigidity depends on the pattern of the mesh, also of a fine mesh.
    holds_normals
        Whether clamped pins can hold the normals of the cloth with it.
    damps
        What a term damps: "motion", with a `rate` c [1/s]; "strain" or "bending", with a `time`
        τ [s]; "air", with the fields of `Drag`; or "" for any other term, whose influence
        studies do not predict.
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
        for name, allowed_values in (("kind", KINDS), ("damps", DAMPED)):
            value = getattr(self, name)
            if value not in allowed_values:
                allowed = f"must be one of {', '.join(map(repr, allowed_values))}"
                raise InputError(f"{name} = {value!r}", allowed, "TermTraits")
        if tuple(self.elements) not in (("P1",), ("P2",), BOTH, BOTH[::-1]):
            allowed = 'must be ("P1",), ("P2",) or ("P1", "P2")'
            raise InputError(f"elements = {self.elements!r}", allowed, "TermTraits")


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
    """Return the traits of a description, or of the class of a description.

    They are its attribute `traits`, or the default traits. Three traits may also be attributes
    of their own (`PLAIN`), which then count. Raises `InputError` for `traits` that are no
    `TermTraits`.
    """
    traits = getattr(term, "traits", TermTraits())
    if not isinstance(traits, TermTraits):
        term_class = type(term)
        if isinstance(term, type):
            term_class = term
        what = f"{term_class.__name__}.traits = {brief(traits)}"
        raise InputError(what, "must be a TermTraits(kind=...)", term_class.__name__)
    own_traits = {
        trait: getattr(term, attribute)
        for trait, attribute in PLAIN.items()
        if hasattr(term, attribute)
    }
    if own_traits:
        return replace(traits, **own_traits)
    return traits


def parameters_of(term: Any) -> dict[str, Any]:
    """The parameters of a description by their names; none if it is no dataclass."""
    if is_dataclass(term):
        return {field.name: getattr(term, field.name) for field in fields(term)}
    return {}


def has_kind(terms: Iterable[Any], kind: str) -> bool:
    """Whether a term of a kind is among the descriptions or classes."""
    return any(traits_of(term).kind == kind for term in terms)
