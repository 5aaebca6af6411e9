"""Time integrators: each is the rule that takes one step.

A method of your own needs the names that this package exports; `integrators.protocol` says what it
must offer.
"""

from fecloth.integrators.bdf2 import BDF2
from fecloth.integrators.energy_momentum import EnergyMomentum
from fecloth.integrators.explicit import CentralDifference, ForwardEuler, SymplecticEuler
from fecloth.integrators.generalized_alpha import GeneralizedAlpha
from fecloth.integrators.linearly_implicit_euler import LinearlyImplicitEuler
from fecloth.integrators.newmark import Newmark
from fecloth.integrators.one_stage import BackwardEuler, ImplicitMidpoint, StageMethod
from fecloth.integrators.protocol import MethodTraits
from fecloth.integrators.step import Step, prescribed_end, set_prescribed
from fecloth.nonlinear.stage import Stage
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

METHODS = {
    "backward_euler": BackwardEuler,
    "linearly_implicit_euler": LinearlyImplicitEuler,
    "implicit_midpoint": ImplicitMidpoint,
    "energy_momentum": EnergyMomentum,
    "newmark": Newmark,
    "generalized_alpha": GeneralizedAlpha,
    "bdf2": BDF2,
}

EXPLICIT = {
    "forward_euler": ForwardEuler,
    "symplectic_euler": SymplecticEuler,
    "central_difference": CentralDifference,
}
