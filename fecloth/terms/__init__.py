"""Contributions to the force balance, one file per family.

What a user writes is a frozen description with its own parameters only. Its docstring gives the
formula, then a paragraph that begins with "Source:" and one with "Valid". The page
studies/laws/laws.md is made of them. Its numbers are in SI; a text such as "5 mm" has a unit, as in
scenes. It offers

    elements                    those it supports, as ("P1", "P2"); left out, P1 alone
    stencil(cloth)              (m, k) nodes that it couples, or None
    bind(panel, slots)          the bound term; ``slots(stencil)`` gives its blocks in the matrix

and the bound term offers, in place and without knowledge of dt, solver or other terms,

    energy(x, t)                              potential [J], if has_energy
    power(x, v, t)                            dissipated power [W], if dissipative
    supply(x, v, t)                           power from outside [W], if it is a load without energy
    add_force(x, v, t, f)                     f += force [N]
    add_tangent(x, v, t, wx, wv, J, definite) J += wx K + wv D, K = −∂f/∂x, D = −∂f/∂v
    dense(x, t)                               c and u of a part c u uᵀ of K outside J, if any
    rate_bounds(mass)                         bounds of the eigenvalues of M⁻¹K and M⁻¹D at rest
    between(start, symmetric)                 the term over a step from positions `start` to
                                              2x − start, for `EnergyMomentum`: a bound term whose
                                              force at x does the work of the energy, and whose
                                              tangent may be asked to be symmetric

with the attributes name, symmetric (of its tangent), has_energy, dissipative and
velocity_dependent, and `load = True` if it acts from outside: equilibrium's load steps scale it.

Shorter than all this are `Condition`, for an energy ½ k C² of some nodes, `UserForce`, for a force
on each node by itself, and `MembraneLaw`, for a membrane. studies/examples has a term and a law.
"""

from fecloth.quantities.unit_fields import reads_units
from fecloth.terms.bending.hinge import BendingDamping, HingeBending
from fecloth.terms.bending.quadratic import QuadraticBending
from fecloth.terms.custom.force import UserForce
from fecloth.terms.damping.mass import MassDamping
from fecloth.terms.damping.strain_rate import StrainRateDamping
from fecloth.terms.loads.drag import Drag
from fecloth.terms.loads.gas import Gas
from fecloth.terms.loads.gravity import Gravity
from fecloth.terms.loads.point_force import PointForce
from fecloth.terms.loads.pressure import Pressure
from fecloth.terms.loads.wind import Wind
from fecloth.terms.membranes.baraff_witkin import BaraffWitkin
from fecloth.terms.membranes.neo_hookean import NeoHookean
from fecloth.terms.membranes.stvk import StVK
from fecloth.terms.membranes.tension_field import TensionField
from fecloth.terms.membranes.tensor_condition import TensorCondition
from fecloth.terms.springs.springs import Springs
from fecloth.terms.springs.tether import Tether

__all__ = [
    "BaraffWitkin",
    "BendingDamping",
    "Drag",
    "Gas",
    "Gravity",
    "HingeBending",
    "MassDamping",
    "NeoHookean",
    "PointForce",
    "Pressure",
    "QuadraticBending",
    "Springs",
    "StVK",
    "StrainRateDamping",
    "TensionField",
    "TensorCondition",
    "Tether",
    "UserForce",
    "Wind",
]

for _name in __all__:  # lengths, forces, ... may be texts such as "5 mm", as in scenes
    reads_units(globals()[_name])
