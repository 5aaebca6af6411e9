"""Many steps of central differences in one compiled call, for StVK, gravity and fixed pins."""

from __future__ import annotations

import numpy as np

from .compiled import kernel
from .errors import InputError, StepFailed
from .system import State, System
from .terms import membrane, stvk
from .terms.gravity import BoundGravity
from .terms.stvk import law


def many_steps(system: System, state: State, dt: float, steps: int) -> State:
    """The state after so many steps of `CentralDifference`, to round-off.

    The leapfrog v½ ← v½ + dt M⁻¹ f(x), x ← x + dt v½ between two half kicks: one pass over the
    triangles and one over the nodes a step, nothing allocated, no Python between steps.

    Source: as for `CentralDifference`.

    Parameters
    ----------
    system, state
        What moves, and its start: x (n, 3) [m], v (n, 3) [m/s].
    dt, steps
        Step [s], the same for all, and their number.

    Raises
    ------
    InputError
        For terms besides one StVK and Gravity, a consistent mass, or moved pins.
    StepFailed
        If the end is not finite, as beyond the limit on dt (see `critical_dt`); its `state` is
        the start, as no other is kept.

    Examples
    --------
    >>> import fecloth as fc
    >>> cloth = fc.Cloth.rectangle(1.0, 0.5, h=0.25, pattern="right")
    >>> fabric = fc.Fabric(areal_density=0.2, tensile_stiffness=1000.0)
    >>> system = fc.System(cloth, fabric, [fc.StVK(), fc.Gravity()], pins=["left"])
    >>> end = many_steps(system, system.rest(), dt=1e-4, steps=100)
    >>> slow = list(fc.march(system, fc.CentralDifference(), system.rest(), 1e-4, 0.01))[-1][0]
    >>> bool(abs(end.x - slow.x).max() < 1e-14)
    True
    """
    elastic, load = _parts(system)
    constraints, cloth = system.constraints, system.cloth
    if system.mass_kind != "lumped":
        raise _refused(f"mass = {system.mass_kind!r}", "must be 'lumped'")
    moved = [name for name, (pin, _) in constraints.groups.items() if pin.motion is not None]
    if moved:
        raise _refused(f"pin {moved[0]!r} is moved", "pins and slides must be fixed")
    if not (isinstance(steps, int) and steps >= 1):
        raise InputError(f"steps = {steps!r}", "must be a whole number >= 1", "many_steps")
    if not (np.isfinite(dt) and dt > 0):
        raise InputError(f"dt = {dt!r}", "must be finite and > 0 [s]", "many_steps")
    still = np.zeros_like(state.v)
    x, v = state.x.copy(), constraints.hold(state.v, still)
    material = cloth.stencil, elastic.panel.gradients, cloth.weights, elastic.constants
    held = constraints.nodes, np.ascontiguousarray(constraints.projectors)
    inverse = 1.0 / system.nodal_mass
    leapfrog(*cloth.shape, *material, *held, inverse, load, float(dt), steps, x, v, still)
    if not (np.isfinite(x).all() and np.isfinite(v).all()):
        raise StepFailed(
            f"{steps} steps of dt = {dt:g} s from t = {state.t:g} s end at values that are not "
            "finite. Take a dt below that of critical_dt.",
            state=state,
        )
    return State(state.t + steps * dt, x, v)


def _parts(system):
    """The StVK membrane, and the sum of the constant loads (n, 3) [N]."""
    elastic, load = [], np.zeros((len(system.cloth.X), 3))
    for name, term in zip(system.names, system.bound, strict=True):
        if isinstance(term, BoundGravity):
            load += term.weight
        elif getattr(term, "kernels", None) is stvk.KERNELS:
            elastic.append(term)
        else:
            raise _refused(f"term {name}", "the terms must be one StVK, and Gravity")
    if len(elastic) != 1:
        raise _refused(f"{len(elastic)} StVK terms", "the terms must be one StVK, and Gravity")
    return elastic[0], load


def _refused(what, allowed):
    return InputError(what, allowed, "many_steps", "Use march with CentralDifference().")


@kernel
def leapfrog(K, Q, nodes, G, w, c, at, P, inverse_mass, load, dt, steps, x, v, f):
    """v += dt M⁻¹ P f(x), x += dt v, between two half kicks, in place; f is work space."""
    for step in range(steps + 1):
        for i in range(len(f)):
            for k in range(3):
                f[i, k] = load[i, k]
        membrane.add_force(law, K, Q, nodes, G, w, c, x, f)
        for n in range(len(at)):
            i = at[n]
            f1, f2, f3 = f[i, 0], f[i, 1], f[i, 2]
            for k in range(3):
                f[i, k] = P[n, k, 0] * f1 + P[n, k, 1] * f2 + P[n, k, 2] * f3
        kick = dt if 0 < step < steps else 0.5 * dt
        drift = dt if step < steps else 0.0
        for i in range(len(f)):
            for k in range(3):
                v[i, k] += kick * inverse_mass[i] * f[i, k]
                x[i, k] += drift * v[i, k]
