"""fecloth: a continuum cloth solver on Gmsh meshes with Green-strain membranes.

SI units throughout; stiffness and stress of a fabric are per width [N/m]. See the README for the
symbol table, and `System`, `march` and `run` for where to start.
"""

from . import stability, verify
from .adaptive import Adaptive
from .auto import Auto
from .bdf2 import BDF2
from .bendingtensor import bending_tensor, strip_rigidity
from .cloth import Cloth
from .collect import Result, run
from .energy_momentum import EnergyMomentum
from .equilibrium import EquilibriumFailed, equilibrium
from .errors import (
    FeclothError,
    FeclothWarning,
    IndefiniteMatrix,
    InputError,
    MeshError,
    SceneError,
    SolveFailed,
    StepFailed,
)
from .explicit import CentralDifference, ForwardEuler, SymplecticEuler
from .fabric import Fabric
from .fused import many_steps
from .integrators import BackwardEuler, ImplicitMidpoint, LinearlyImplicitEuler
from .lattice import plane_moduli
from .march import march
from .newmark import GeneralizedAlpha, Newmark
from .observe import Probe
from .output import Frames, fields, read_frame, write_vtk
from .pins import Pin, Slide
from .record import Ledger
from .settle import solver_for
from .solver import Newton
from .stability import critical_dt
from .system import State, System
from .terms import (
    BaraffWitkin,
    BendingDamping,
    Drag,
    Gas,
    Gravity,
    HingeBending,
    MassDamping,
    NeoHookean,
    PointForce,
    Pressure,
    QuadraticBending,
    Springs,
    StrainRateDamping,
    StVK,
    TensionField,
    TensorCondition,
    Tether,
    UserForce,
    Wind,
)
from .terms.hinge import hinge_angles
from .terms.membrane_law import MembraneLaw
from .terms.user_condition import Condition

__version__ = "0.1.0"

__all__ = [
    "BDF2",
    "Adaptive",
    "Auto",
    "BackwardEuler",
    "BaraffWitkin",
    "BendingDamping",
    "CentralDifference",
    "Cloth",
    "Condition",
    "Drag",
    "EnergyMomentum",
    "EquilibriumFailed",
    "Fabric",
    "FeclothError",
    "FeclothWarning",
    "ForwardEuler",
    "Frames",
    "Gas",
    "GeneralizedAlpha",
    "Gravity",
    "HingeBending",
    "ImplicitMidpoint",
    "IndefiniteMatrix",
    "InputError",
    "Ledger",
    "LinearlyImplicitEuler",
    "MassDamping",
    "MembraneLaw",
    "MeshError",
    "NeoHookean",
    "Newmark",
    "Newton",
    "Pin",
    "PointForce",
    "Pressure",
    "Probe",
    "QuadraticBending",
    "Result",
    "SceneError",
    "Slide",
    "SolveFailed",
    "Springs",
    "StVK",
    "State",
    "StepFailed",
    "StrainRateDamping",
    "SymplecticEuler",
    "System",
    "TensionField",
    "TensorCondition",
    "Tether",
    "UserForce",
    "Wind",
    "bending_tensor",
    "critical_dt",
    "equilibrium",
    "fields",
    "hinge_angles",
    "many_steps",
    "march",
    "plane_moduli",
    "read_frame",
    "run",
    "solver_for",
    "stability",
    "strip_rigidity",
    "verify",
    "write_vtk",
]
