"""The compiled loops of a membrane law: every law in the Green strain runs through these.

A law is a compiled function ``law(E, c) -> (W, S, ℂ)`` of the Green strain E = (E11, E22, E12)
and the constants c of the triangle, in the Voigt order (11, 22, 12) with the engineering shear
2 E12:

    W    energy per reference area [J/m²]
    S    second Piola–Kirchhoff stress resultant ∂W/∂E = (S11, S22, S12) [N/m]
    ℂ    tangent moduli ∂S/∂E = (C11, C22, C66, C12, C16, C26) [N/m]

The loops are templates, which `Kernels` compiles with a law and a kind of strain:

    kind of strain   strain                               loops
    POINTWISE        E = (FᵀF − I)/2                      `pointwise_loops`
    RESTED           E less a strain at rest              `pointwise_loops`
    RATE             Ė = sym(FᵀḞ)                         `pointwise_loops`
    REGGE            E_h less a strain at rest            `regge_loops`
    REGGE_RATE       Ė_h                                  `regge_loops`
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from types import ModuleType
from typing import Any, Self

from fecloth.compiled.jit import specialise
from fecloth.terms.loops import pointwise_loops, regge_loops
from fecloth.terms.loops.green_strain import gradient
from fecloth.terms.loops.pointwise_loops import no_gradient


@dataclass(frozen=True, eq=False)
class KindOfStrain:
    """A kind of strain.

    Attributes
    ----------
    loops
        The module with its templates.
    functions
        The compiled functions that take the place of calls in a template, by their names there.
    """

    loops: ModuleType
    functions: dict[str, Callable[..., Any]]


POINTWISE = KindOfStrain(
    pointwise_loops, {"rate_gradient": no_gradient, "strain": pointwise_loops.green}
)
RESTED = KindOfStrain(
    pointwise_loops, {"rate_gradient": no_gradient, "strain": pointwise_loops.rested}
)
RATE = KindOfStrain(pointwise_loops, {"rate_gradient": gradient, "strain": pointwise_loops.rate})
REGGE = KindOfStrain(regge_loops, {"strain": regge_loops.rested})
REGGE_RATE = KindOfStrain(regge_loops, {"strain": regge_loops.rate})


def entry_point(template: str, law: str = "law") -> cached_property[Any]:
    """A template of this name, compiled with the law that `Kernels` has in the field `law`."""
    return cached_property(lambda kernels: kernels.make(template, law=getattr(kernels, law)))


def of_kind(kind: KindOfStrain) -> cached_property[Any]:
    """The `Kernels` of the same law with another kind of strain."""
    return cached_property(lambda kernels: replace(kernels, kind=kind))


@dataclass(frozen=True, eq=False)
class Kernels:
    """The entry points of a law with a kind of strain, made and compiled at their first use.

    Attributes
    ----------
    law
        The compiled function, see the module.
    definite_law
        The same law with ℂ positive semi-definite, for the definite tangent.
    is_quadratic
        Whether W is quadratic in E. Then the stress of the mean of two strains does the work of
        the energy between them.
    kind
        The kind of strain.
    """

    law: Callable[..., Any]
    definite_law: Callable[..., Any]
    is_quadratic: bool
    kind: KindOfStrain = POINTWISE

    energy = entry_point("energy")
    add_force = entry_point("add_force")
    add_tangent = entry_point("add_tangent")
    add_definite_tangent = entry_point("add_definite_tangent", "definite_law")
    add_mixed_tangent = entry_point("add_mixed_tangent")
    add_stress = entry_point("add_stress")
    add_moduli = entry_point("add_moduli", "definite_law")

    pointwise = of_kind(POINTWISE)
    rate = of_kind(RATE)
    regge = of_kind(REGGE)
    regge_rate = of_kind(REGGE_RATE)

    @cached_property
    def add_strain(self) -> Callable[..., None]:
        """The strain alone, for any law."""
        return self.make("add_strain")

    @cached_property
    def rested(self) -> Self:
        """The entry points with a strain at rest, which E_h has anyway."""
        if self.kind is REGGE:
            return self
        return replace(self, kind=RESTED)

    def make(self, template: str, **law: Callable[..., Any]) -> Callable[..., Any]:
        """Compile the template of this name with the kind of strain, and with a law."""
        return specialise(getattr(self.kind.loops, template), **self.kind.functions, **law)


def kernels(
    law: Callable[..., Any],
    definite_law: Callable[..., Any] | None = None,
    is_quadratic: bool = False,
) -> Kernels:
    """The entry points of a law.

    Without `definite_law` the ℂ of the law must be positive semi-definite everywhere.
    """
    return Kernels(law, definite_law or law, is_quadratic)
