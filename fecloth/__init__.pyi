"""The public names of fecloth and the modules that define them."""

from . import stability, study, verify
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
from .fabric.fabric import Fabric
from .homogenisation import bending_tensor, plane_moduli, strip_rigidity
from .integrators.bdf2 import BDF2
from .integrators.energy_momentum import EnergyMomentum
from .integrators.explicit import CentralDifference, ForwardEuler, SymplecticEuler
from .integrators.linearly_implicit_euler import LinearlyImplicitEuler
from .integrators.many_steps import many_steps
from .integrators.newmark import GeneralizedAlpha, Newmark, WithMemory
from .integrators.one_stage import BackwardEuler, ImplicitMidpoint, StageMethod
from .integrators.protocol import MethodTraits
from .mesh.cloth import Cloth
from .mesh.grading import Grading
from .nonlinear.options import Newton
from .nonlinear.stage import Stage
from .nonlinear.static_equation import EquilibriumFailed
from .output.frame_arrays import fields
from .output.frames import Frames, read_frame, write_vtk
from .quantities.rotation import Rotation
from .runs.outcome import SceneResult
from .runs.run_scene import run_scene
from .scene.scene import load_scene
from .simulation.answer import Answer
from .simulation.doubts.doubt import Doubt, DoubtKind
from .simulation.energy_ledger import Ledger
from .simulation.equilibrium import Equilibrium, equilibrium
from .simulation.error_control import Adaptive
from .simulation.march import march
from .simulation.method_choice import Auto
from .simulation.probes import Probe
from .simulation.resolve import solver_for
from .simulation.run import Result, run
from .stability.critical_step import critical_dt
from .study.budgeting.budget import budget
from .study.budgeting.result import Budget
from .study.fitting.experiment import Experiment
from .study.fitting.fit import fit
from .study.fitting.result import Fit
from .study.modes import Modes, modes
from .study.sensitivities import sensitivity
from .study.tuning import tune
from .study.tuning_result import Tuned
from .system.lay_down import lay_down
from .system.pins import Pin, Slide
from .system.seams import Seam
from .system.space_error import SpaceError, space_error
from .system.state import State
from .system.system import System
from .terms import (
    BaraffWitkin,
    BendingDamping,
    BendingFriction,
    Drag,
    EdgeForce,
    Gas,
    Gravity,
    HingeBending,
    MassDamping,
    MembraneTable,
    MeshObstacle,
    NeoHookean,
    Obstacle,
    PlateBending,
    PointForce,
    Pressure,
    QuadraticBending,
    SelfContact,
    Springs,
    StrainRateDamping,
    StVK,
    TensionField,
    TensorCondition,
    Tether,
    UserForce,
    Wind,
)
from .terms.bending.hinge import hinge_angles
from .terms.bending.seam import SeamBending
from .terms.contact import shapes
from .terms.custom.condition import Condition
from .terms.custom.membrane_law import MembraneLaw
from .terms.loops.green_strain import contract
from .terms.protocol import BoundTerm
from .terms.traits import TermTraits
from .view.export import export

__version__: str

__all__ = [
    "BDF2",
    "Adaptive",
    "Answer",
    "Auto",
    "BackwardEuler",
    "BaraffWitkin",
    "BendingDamping",
    "BendingFriction",
    "BoundTerm",
    "Budget",
    "CentralDifference",
    "Cloth",
    "Condition",
    "Doubt",
    "DoubtKind",
    "Drag",
    "EdgeForce",
    "EnergyMomentum",
    "Equilibrium",
    "EquilibriumFailed",
    "Experiment",
    "Fabric",
    "FeclothError",
    "FeclothWarning",
    "Fit",
    "ForwardEuler",
    "Frames",
    "Gas",
    "GeneralizedAlpha",
    "Grading",
    "Gravity",
    "HingeBending",
    "ImplicitMidpoint",
    "IndefiniteMatrix",
    "InputError",
    "Ledger",
    "LinearlyImplicitEuler",
    "MassDamping",
    "MembraneLaw",
    "MembraneTable",
    "MeshError",
    "MeshObstacle",
    "MethodTraits",
    "Modes",
    "NeoHookean",
    "Newmark",
    "Newton",
    "Obstacle",
    "Pin",
    "PlateBending",
    "PointForce",
    "Pressure",
    "Probe",
    "QuadraticBending",
    "Result",
    "Rotation",
    "SceneError",
    "SceneResult",
    "Seam",
    "SeamBending",
    "SelfContact",
    "Slide",
    "SolveFailed",
    "SpaceError",
    "Springs",
    "StVK",
    "Stage",
    "StageMethod",
    "State",
    "StepFailed",
    "StrainRateDamping",
    "SymplecticEuler",
    "System",
    "TensionField",
    "TensorCondition",
    "TermTraits",
    "Tether",
    "Tuned",
    "UserForce",
    "Wind",
    "WithMemory",
    "bending_tensor",
    "budget",
    "contract",
    "critical_dt",
    "equilibrium",
    "export",
    "fields",
    "fit",
    "hinge_angles",
    "lay_down",
    "load_scene",
    "many_steps",
    "march",
    "modes",
    "plane_moduli",
    "read_frame",
    "run",
    "run_scene",
    "sensitivity",
    "shapes",
    "solver_for",
    "space_error",
    "stability",
    "strip_rigidity",
    "study",
    "tune",
    "verify",
    "write_vtk",
]
