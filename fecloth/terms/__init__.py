"""Contributions to the force balance, one file per family.

A user writes a frozen description with the parameters of the term. Its docstring gives the
formula, then a paragraph that begins with "Source:" and one that begins with "Valid".
`terms.protocol` says what the description and the bound term offer. `TRAITS` says what kind of term
each is, by its name.

Often less code is enough: `Condition` is for an energy ½ k C² of some nodes, `UserForce` for a
force on each node by itself, and `MembraneLaw` for a membrane. studies/examples has a term and
a law.
"""

from fecloth.quantities.arguments import checks_arguments
from fecloth.terms.bending.friction import BendingFriction
from fecloth.terms.bending.hinge import HingeBending, QuadraticBending
from fecloth.terms.bending.plate import PlateBending
from fecloth.terms.contact.obstacle import MeshObstacle, Obstacle
from fecloth.terms.contact.triangle_contact import SelfContact
from fecloth.terms.custom.force import UserForce
from fecloth.terms.damping.bending import BendingDamping
from fecloth.terms.damping.mass import MassDamping
from fecloth.terms.damping.strain_rate import StrainRateDamping
from fecloth.terms.loads.drag import Drag
from fecloth.terms.loads.edge_force import EdgeForce
from fecloth.terms.loads.gas import Gas
from fecloth.terms.loads.gravity import Gravity, PointForce
from fecloth.terms.loads.pressure import Pressure
from fecloth.terms.loads.wind import Wind
from fecloth.terms.membranes.baraff_witkin import BaraffWitkin
from fecloth.terms.membranes.neo_hookean import NeoHookean
from fecloth.terms.membranes.stvk import StVK, TensorCondition
from fecloth.terms.membranes.table import MembraneTable
from fecloth.terms.membranes.tension_field import TensionField
from fecloth.terms.springs.springs import Springs
from fecloth.terms.springs.tether import Tether
from fecloth.terms.traits import traits_of

__all__ = sorted(name for name, value in globals().items() if isinstance(value, type))

for _name in __all__:  # lengths, forces, ... may be texts such as "5 mm", as in scenes
    checks_arguments(globals()[_name])

TRAITS = {_name: traits_of(globals()[_name]) for _name in __all__}
