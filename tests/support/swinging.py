"""A sheet that swings down from its left edge, for tests of what shows it."""

import fecloth as fc


def swinging(element="P1", h=0.15, dt=0.05, t_end=0.4):
    """The system and its states."""
    cloth = fc.Cloth.rectangle(1.0, 0.6, h=h, element=element)
    system = fc.System(cloth, fc.Fabric(0.2, 500.0), [fc.StVK(), fc.Gravity()], pins=["left"])
    steps = fc.march(system, fc.BackwardEuler(), system.rest(), dt=dt, t_end=t_end)
    return system, [system.rest(), *(state for state, _ in steps)]
