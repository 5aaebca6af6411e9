"""One term of each kind on a cloth, for tests that hold for all of them."""

import numpy as np

import fecloth as fc


def longer(y):
    return np.linalg.norm(y[:, 1] - y[:, 0], axis=1) - 0.1


def chain(cloth):
    """A user's condition between neighbours in the numbering of the nodes."""
    nodes = np.arange(len(cloth.X))
    return fc.Condition(longer, np.column_stack([nodes[:-1], nodes[1:]]), 300.0, 0.05)


TERMS = {
    "StVK": lambda c: fc.StVK(),
    "NeoHookean": lambda c: fc.NeoHookean(),
    "TensionField": lambda c: fc.TensionField(),
    "TensorCondition": lambda c: fc.TensorCondition(100.0),
    "MembraneTable": lambda c: fc.MembraneTable(warp=[(1.1, 100.0), (1.2, 300.0)]),
    "BaraffWitkin": lambda c: fc.BaraffWitkin(),
    "structural": lambda c: fc.Springs(damping=1e-3),
    "van_gelder": lambda c: fc.Springs(kind="van_gelder", damping=1e-3),
    "biquadratic": lambda c: fc.Springs(kind="biquadratic", damping=1e-3),
    "HingeBending": lambda c: fc.HingeBending(),
    "QuadraticBending": lambda c: fc.QuadraticBending(),
    "PlateBending": lambda c: fc.PlateBending(),
    "BendingFriction": lambda c: fc.BendingFriction(),
    "BendingDamping": lambda c: fc.BendingDamping(0.1),
    "StrainRateDamping": lambda c: fc.StrainRateDamping(0.01),
    "MassDamping": lambda c: fc.MassDamping(3.0),
    "Tether": lambda c: fc.Tether(np.arange(0, len(c.X), 3), (0, 0, 1), 200.0, 0.5),
    "Condition": chain,
    "UserForce": lambda c: fc.UserForce(("-50 * x", "0", "-20 * z - 3 * vz")),
    "Drag": lambda c: fc.Drag(2.0, law="linear"),
    "Wind": lambda c: fc.Wind((3.0, 1.0, 2.0), 2.0, tangent="exact"),
    "Pressure": lambda c: fc.Pressure(500.0),
    "exact Pressure": lambda c: fc.Pressure(500.0, tangent="exact"),
    "Gravity": lambda c: fc.Gravity(),
    "EdgeForce": lambda c: fc.EdgeForce("boundary", normal=500.0, follow=True),
    "PointForce": lambda c: fc.PointForce([0], (0, 0, 1)),
}
