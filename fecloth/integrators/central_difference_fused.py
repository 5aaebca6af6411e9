"""Many steps of central differences in one compiled call: StVK, constant loads, fixed pins.

Threads share the work by nodes: each owns a range of them, and computes every triangle that
touches it. The triangles along the seams between the ranges are computed twice (2 % of 8,000,
0.4 % of 200,000 on two threads, as nodes and triangles are numbered along a narrow band), so no
thread writes data that another one reads within a step. Nothing is added up afterwards, threads
synchronise once a step, and the forces of a node are summed in the order of a single thread, to
the same bits.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from fecloth import validation
from fecloth.compiled.jit import Array, Zeros, inner, kernel
from fecloth.compiled.team import Team, number_of_threads
from fecloth.compiled.thread_meeting import meet
from fecloth.errors import InputError, StepFailed
from fecloth.mesh.cloth import Cloth
from fecloth.system.arguments import check_system
from fecloth.system.state import State
from fecloth.system.system import System
from fecloth.terms.custom.force import BoundUserForce, FormulaForce
from fecloth.terms.loads.gravity import BoundGravity
from fecloth.terms.loads.point_force import BoundPointForce
from fecloth.terms.loops.membrane import BoundMembrane
from fecloth.terms.membranes import stvk

add_force = stvk.KERNELS.add_force
TERMS = (
    'the terms must be one StVK (on P2 with strain = "pointwise"), and constant loads: Gravity, '
    "PointForce, UserForce of numbers"
)


def many_steps(system: System, state: State, dt: float, steps: int, threads: int = 1) -> State:
    """Take many steps of `CentralDifference`; return the last state, equal to round-off.

    The leapfrog v½ ← v½ + dt M⁻¹ f(x), x ← x + dt v½ between two half kicks: one pass over the
    triangles and one over the nodes a step, nothing allocated, no Python between steps. A call
    ends where v belongs to x, so the next one goes on as if there had been no end.

    Source: as for `CentralDifference`.

    Parameters
    ----------
    system, state
        What moves, and its start: x (n, 3) [m], v (n, 3) [m/s].
    dt, steps
        Step [s], the same for all, and their number.
    threads
        Of the processor that share the work; the result is the same to the last bit. Two idle
        cores take 0.51 to 0.58 of the time of one from 8,000 to 200,000 triangles
        (studies/benchmarks/kernels.py). Cores that other processes keep busy take longer than
        one, as the threads wait for each other in each step.

    Raises
    ------
    InputError
        For terms besides one StVK and constant loads, a consistent mass, moved pins, or a wrong
        number of threads.
    StepFailed
        If the end is not finite, as beyond the limit on dt (see `critical_dt`); its `state` is
        the start, the only state stored.

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
    check_system(system, state, "many_steps")
    _check(system, dt, steps, threads)
    elastic = _membrane(system)
    constraints, cloth = system.constraints, system.cloth
    still = np.zeros_like(state.v)
    x, v = state.x.copy(), constraints.hold(state.v, still)
    material = cloth.stencil, elastic.panel.gradients, cloth.weights, elastic.constants
    held = constraints.nodes, np.ascontiguousarray(constraints.projectors)
    fixed = *cloth.shape, *material, *held, 1.0 / system.nodal_mass, _load(system, state)
    parts = shares(cloth, constraints.nodes, number_of_threads(threads))
    if len(parts) == 1:
        leapfrog(*fixed, float(dt), steps, parts[0], x, v, still)
    else:
        turns, work = np.stack([x, x]), np.zeros((len(parts), *x.shape))
        meeting, data = np.zeros(1, np.int64), (*fixed, float(dt), steps, parts, turns, v, work)
        Team(len(parts)).run(lambda p: shared_leapfrog(*data, meeting, p), meeting)
        x = turns[0].copy()
    if not (np.isfinite(x).all() and np.isfinite(v).all()):
        raise StepFailed(
            f"{steps} steps of dt = {dt:g} s from t = {state.t:g} s end at values that are not "
            "finite. Take a dt below that of critical_dt.",
            state=state,
        )
    return State(state.t + steps * dt, x, v)


def _check(system: System, dt: float, steps: int, threads: int) -> None:
    if system.mass_kind != "lumped":
        raise _refused(f"mass = {system.mass_kind!r}", "must be 'lumped'")
    groups = system.constraints.groups.items()
    moved = [name for name, (pin, _) in groups if pin.moves]
    if moved:
        raise _refused(f"pin {moved[0]!r} is moved", "pins and slides must be fixed")
    if not (isinstance(steps, int) and steps >= 1):
        raise InputError(f"steps = {steps!r}", "must be a whole number >= 1", "many_steps")
    validation.number("dt", dt, 0.0, "many_steps")
    number_of_threads(threads, "many_steps")


def _membrane(system: System) -> BoundMembrane:
    """The one StVK membrane."""
    elastic: list[BoundMembrane] = []
    for name, term in zip(system.names, system.bound, strict=True):
        if getattr(term, "kernels", None) is stvk.KERNELS:
            elastic.append(term)
        elif not _is_constant(term):
            raise _refused(f"term {name}", TERMS)
    if len(elastic) != 1:
        raise _refused(f"{len(elastic)} StVK terms", TERMS)
    return elastic[0]


def _is_constant(term: object) -> bool:
    """Return whether a term is a load that is the same at any x, v and t."""
    if isinstance(term, BoundPointForce):
        parts = term.force.parts
    elif isinstance(term, BoundUserForce) and isinstance(term.function, FormulaForce):
        parts = term.function.parts
    else:
        return isinstance(term, BoundGravity)
    return not callable(parts) and all(isinstance(part, float) for part in parts)


def _load(system: System, state: State) -> np.ndarray:
    """The sum of the constant loads (n, 3) [N]."""
    load = np.zeros_like(state.x)
    for term in system.bound:
        if _is_constant(term):
            term.add_force(state.x, state.v, state.t, load)
    return load


def _refused(what: str, allowed: str) -> InputError:
    return InputError(what, allowed, "many_steps", "Use march with CentralDifference().")


def shares(cloth: Cloth, held: np.ndarray, threads: int) -> np.ndarray:
    """Return the (p, 8) work of p ≤ `threads` parts, as four ranges [begin, end) each.

    Its triangles, the nodes that these touch, the nodes that it owns and moves, and the entries
    in the ascending nodes `held` that are its own. Every node has one owner, whose triangles are
    all those around it (and, on a mesh that is not numbered along a band, many others).

    Examples
    --------
    >>> from fecloth import Cloth
    >>> cloth = Cloth.rectangle(1.0, 1.0, h=0.125, pattern="right")
    >>> shares(cloth, cloth.nodes("corners"), 2)[:, :6]
    array([[  0,  71,   0,  49,   0,  40],
           [ 55, 128,  31,  81,  40,  81]])
    """
    corners = np.ascontiguousarray(cloth.stencil.T)  # 30 times faster than along rows of three
    low, high = corners.min(axis=0), corners.max(axis=0)
    cuts = np.unique(np.arange(threads + 1) * len(cloth.X) // threads)
    rows = []
    for begin, end in pairwise(cuts):
        touching = np.flatnonzero((high >= begin) & (low < end))
        first, last = touching[0], touching[-1] + 1
        nodes = low[first:last].min(), high[first:last].max() + 1
        rows.append((first, last, *nodes, begin, end, *np.searchsorted(held, [begin, end])))
    return np.array(rows, dtype=np.int64)


@inner
def kick_and_drift(
    K: Zeros,
    Q: Zeros,
    nodes: Array,
    G: Array,
    w: Array,
    c: Array,
    at: Array,
    P: Array,
    inverse_mass: Array,
    load: Array,
    kick: float,
    drift: float,
    part: Array,
    x: Array,
    y: Array,
    v: Array,
    f: Array,
) -> None:
    """v += kick M⁻¹ P f(x), y = x + drift v on the nodes of a part; f is work space."""
    first, last, low, high, begin, end = part[0], part[1], part[2], part[3], part[4], part[5]
    for i in range(low, high):
        for k in range(3):
            f[i, k] = load[i, k]
    own = slice(first, last)
    add_force(K, Q, nodes[own], G[own], w[own], c[own], x, f)
    for n in range(part[6], part[7]):
        i = at[n]
        f1, f2, f3 = f[i, 0], f[i, 1], f[i, 2]
        for k in range(3):
            f[i, k] = P[n, k, 0] * f1 + P[n, k, 1] * f2 + P[n, k, 2] * f3
    for i in range(begin, end):
        for k in range(3):
            v[i, k] += kick * inverse_mass[i] * f[i, k]
            y[i, k] = x[i, k] + drift * v[i, k]


@inner
def weights(step: int, steps: int, dt: float) -> tuple[float, float]:
    """(kick, drift) [s] of v and x: a half kick first and last, and no drift after the last."""
    kick = dt if 0 < step < steps else 0.5 * dt
    return kick, (dt if step < steps else 0.0)


@kernel
def leapfrog(
    K: Zeros,
    Q: Zeros,
    nodes: Array,
    G: Array,
    w: Array,
    c: Array,
    at: Array,
    P: Array,
    inverse_mass: Array,
    load: Array,
    dt: float,
    steps: int,
    part: Array,
    x: Array,
    v: Array,
    f: Array,
) -> None:
    """Take the steps in place: with a single part the new x may overwrite the old one."""
    fixed = K, Q, nodes, G, w, c, at, P, inverse_mass, load
    for step in range(steps + 1):
        kick, drift = weights(step, steps, dt)
        kick_and_drift(*fixed, kick, drift, part, x, x, v, f)


@kernel
def shared_leapfrog(
    K: Zeros,
    Q: Zeros,
    nodes: Array,
    G: Array,
    w: Array,
    c: Array,
    at: Array,
    P: Array,
    inverse_mass: Array,
    load: Array,
    dt: float,
    steps: int,
    parts: Array,
    x: Array,
    v: Array,
    f: Array,
    meeting: Array,
    p: int,
) -> None:
    """The same for thread p, with its own f; the two x take turns, and are equal at the end."""
    fixed, round_ = (K, Q, nodes, G, w, c, at, P, inverse_mass, load), 1
    for step in range(steps + 1):
        kick, drift = weights(step, steps, dt)
        old, new = x[step % 2], x[(step + 1) % 2]
        kick_and_drift(*fixed, kick, drift, parts[p], old, new, v, f[p])
        round_ = meet(meeting, len(parts), round_)
