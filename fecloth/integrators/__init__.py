"""Time integrators: each is the rule that takes one step.

A method of your own needs the names that this package exports; `integrators.protocol` says
what it must offer.
"""

from typing import Any

from fecloth.integrators.bdf2 import BDF2
from fecloth.integrators.energy_momentum import EnergyMomentum
from fecloth.integrators.explicit import CentralDifference, ForwardEuler, SymplecticEuler
from fecloth.integrators.linearly_implicit_euler import LinearlyImplicitEuler
from fecloth.integrators.newmark import GeneralizedAlpha, Newmark, WithMemory
from fecloth.integrators.one_stage import BackwardEuler, ImplicitMidpoint, StageMethod
from fecloth.integrators.protocol import MethodTraits
from fecloth.integrators.step import Step, prescribed_end, set_prescribed
from fecloth.nonlinear.stage import Stage
from fecloth.quantities.arguments import checks_arguments
from fecloth.terms.records import remembered

__all__ = [
    "EXPLICIT",
    "METHODS",
    "MethodTraits",
    "Stage",
    "StageMethod",
    "Step",
    "WithMemory",
    "prescribed_end",
    "remembered",
    "set_prescribed",
]

METHODS: dict[str, Any] = {
    "backward_euler": BackwardEuler,
    "bdf2": BDF2,
    "implicit_midpoint": ImplicitMidpoint,
    "generalized_alpha": GeneralizedAlpha,
    "energy_momentum": EnergyMomentum,
    "linearly_implicit_euler": LinearlyImplicitEuler,
    "newmark": Newmark,
}

EXPLICIT: dict[str, Any] = {
    "symplectic_euler": SymplecticEuler,
    "central_difference": CentralDifference,
    "forward_euler": ForwardEuler,
}

for _method in (METHODS | EXPLICIT).values():
    checks_arguments(_method)


def studied_by(study: str) -> tuple[str, ...]:
    """Return the names of the methods that a study runs if it is not told which."""
    methods = (METHODS | EXPLICIT).items()
    return tuple(name for name, method in methods if study in method().traits.studied)
