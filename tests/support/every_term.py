"""One object of each kind of term, for what must hold for all of them."""

import numpy as np

import fecloth as fc
from fecloth.terms.traits import traits_of

FABRIC = fc.Fabric(0.2, 1000.0, 0.3, bending_rigidity=1.0, bending_hysteresis=1e-3)
PLATE = fc.PlateBending()


def longer(y):
    return np.linalg.norm(y[:, 1] - y[:, 0], axis=1) - 0.1


NEIGHBOURS = np.column_stack([np.arange(9), np.arange(1, 10)])  # in the numbering of the nodes
TERMS = {
    "StVK": fc.StVK(),
    "pointwise": fc.StVK(strain="pointwise"),
    "NeoHookean": fc.NeoHookean(),
    "TensionField": fc.TensionField(),
    "TensorCondition": fc.TensorCondition(100.0),
    "MembraneTable": fc.MembraneTable([(1.1, 100.0), (1.2, 300.0)]),
    "BaraffWitkin": fc.BaraffWitkin(),
    "structural": fc.Springs(damping=1e-3),
    "van_gelder": fc.Springs("van_gelder", damping=1e-3),
    "biquadratic": fc.Springs("biquadratic", damping=1e-3),
    "HingeBending": fc.HingeBending(),
    "QuadraticBending": fc.QuadraticBending(),
    "PlateBending": PLATE,
    "BendingFriction": fc.BendingFriction(),
    "hinge damping": fc.BendingDamping(0.1),
    "plate damping": fc.BendingDamping(0.1, law=PLATE),
    "StrainRateDamping": fc.StrainRateDamping(0.01),
    "exact damping": fc.StrainRateDamping(0.01, tangent="exact", rate="velocity"),
    "MassDamping": fc.MassDamping(3.0),
    "Tether": fc.Tether("boundary", (0, 0, 1), 200.0, 0.5),
    "Condition": fc.Condition(longer, NEIGHBOURS, 300.0, 0.05),
    "UserForce": fc.UserForce(("-50 * x", "0", "-20 * z - 3 * vz")),
    "Drag": fc.Drag(2.0, 0.1, law="linear"),
    "Wind": fc.Wind((3.0, 1.0, 2.0), 2.0, tangent="exact"),
    "formulas": fc.Wind(("1 + x*t", "y", "z"), 0.3, 0.1),
    "Pressure": fc.Pressure(500.0),
    "exact Pressure": fc.Pressure(500.0, tangent="exact"),
    "Gravity": fc.Gravity(),
    "EdgeForce": fc.EdgeForce("boundary", normal=500.0, tangent=1.0, follow=True),
    "PointForce": fc.PointForce([0], (0, 0, 1)),
}


def terms_on(element):
    """The terms that such elements may have, by name."""
    return {name: term for name, term in TERMS.items() if element in traits_of(term).elements}
