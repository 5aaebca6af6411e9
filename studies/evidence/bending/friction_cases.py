"""Strips with friction inside the fabric whose answers are known: loops, release, cantilevers."""

from __future__ import annotations

import warnings
from itertools import pairwise

import numpy as np

import fecloth as fc
from fecloth.nonlinear.increments import LoadIncrement, solve_increment, static_context
from fecloth.terms.bending.sliders import Sliders
from fecloth.terms.step_difference import StepDifference
from studies.bending.meshes import rectangle, square

B = 2e-5  # N m
M = 20.0  # the stiffness m of the sliders
L = 0.2  # m, of the strips that are let go or laid down
SMALL = 1e-3  # κL of the loops
BENT = 5.0  # 1/m, κL = 1, of the strip that is let go; it rests at 1.5/m
SAG = 0.02  # w L³/(8 B) of the cantilever: its deflection over L without friction
SHARE = 0.25  # HB/B of the curvature w L²/(2 B) at its clamp
GRAVITY = 9.81


def fabric(HB: float, **given) -> fc.Fabric:
    values = {"areal_density": 0.1, "tensile_stiffness": 200.0} | given
    return fc.Fabric(**values, bending_rigidity=B, bending_hysteresis=2 * HB)


# --- the law, and loops of strips -----------------------------------------------------------------


def law(HB: float, m: float, path: np.ndarray) -> np.ndarray:
    """The moment [N] of elastic part and slider along a path of curvatures (k,) [1/m]."""
    sliders = Sliders.of_fabric(fabric(HB), m)
    slid, moments = np.zeros((1, 3)), []
    for kappa in path:
        e = np.array([[kappa, 0.0, 0.0]]) - slid
        moments.append(B * kappa + sliders.moment(e)[0, 0])
        slid = slid + e - sliders.left(e)
    return np.array(moments)


def bend(X: np.ndarray, kappa: float) -> np.ndarray:
    """Positions (n, 3) [m] on a cylinder of the curvature κ, without cancellation."""
    (x, y), kappa = X.T, kappa + 1e-12
    return np.column_stack([np.sin(kappa * x) / kappa, y, 2 * np.sin(kappa * x / 2) ** 2 / kappa])


def strip_between_clamps(pattern: str, element: str, HB: float) -> fc.System:
    """A unit square whose ends are clamped to a cylinder of the curvature t."""
    arc = ("sin(t+1e-12)/(t+1e-12)-1", "0", "2*sin(t/2)**2/(t+1e-12)")
    turn = fc.Rotation((1, 0, 0), (0, 1, 0), "-t")
    pins = [
        fc.Pin(lambda X: X[:, 0] < 1e-9, clamp=True),
        fc.Pin(lambda X: X[:, 0] > 1 - 1e-9, clamp=True, rotate=turn, motion=arc),
    ]
    terms = [fc.PlateBending(), fc.BendingFriction(M)]
    return fc.System(square(pattern, 5, element), fabric(HB), terms, pins)


def loop(pattern: str, element: str) -> dict:
    """Relative errors of B and 2HB, from dU/dκ over each step of a closed loop."""
    HB = 0.2 * B * SMALL
    system = strip_between_clamps(pattern, element, HB)
    cloth, (plate, friction) = system.cloth, system.bound
    up = np.linspace(-SMALL, SMALL, 17)
    path = np.concatenate([np.linspace(0, SMALL, 9), up[-2::-1], up[1:]])
    record, moments, d = friction.start_history(system.rest().x, 0.0), [], 1e-3 * SMALL
    for start, kappa in pairwise(path):
        x = bend(cloth.X, start)
        step = StepDifference(x, 1.0, 1.0, (), t=kappa - 1.0, history=record)
        over = friction.over_step(step)
        energies = [
            sum(term.energy(bend(cloth.X, at), at) for term in (plate, over))
            for at in (kappa + d, kappa - d)
        ]
        moments.append((energies[0] - energies[1]) / (2 * d * cloth.area))
        record = over.commit(bend(cloth.X, kappa), kappa)
    down, back = np.array(moments[7:24])[::-1], np.array(moments[23:])
    middle = slice(4, 13)  # |κ| ≤ SMALL/2: all sliders slide
    slope = np.polyfit(up[middle], 0.5 * (down + back)[middle], 1)[0]
    heights = (back - down)[middle]
    return {"B": abs(slope / B - 1), "2HB": float(np.abs(heights / (2 * HB) - 1).max())}


# --- release --------------------------------------------------------------------------------------


def release(pattern: str, element: str, n: int) -> dict:
    """Error of κ = HB/B of a strip that was bent far to a cylinder, and slowly let go.

    The forces that hold it there balance the bending alone: nodes on a cylinder are too close
    together for the membrane, and it would push the strip beyond its rest as it opens.
    """
    HB = 0.3 * B * BENT
    cloth = rectangle(L, 0.3 * L, L / n, pattern, element)
    hold = np.zeros((len(cloth.X), 3))
    load = fc.UserForce(lambda x, v, t: hold, per="node")
    terms = [fc.StVK(), fc.PlateBending(), fc.BendingFriction(M), load]
    system = fc.System(cloth, fabric(HB), terms, [fc.Pin("left", clamp=True)])
    friction, flat, x = system.bound[2], system.rest().x, bend(cloth.X, BENT)
    record = friction.start_history(flat, 0.0)
    step = StepDifference(flat, 1.0, 1.0, ((1.0, flat),), history=record)
    history = (None, None, friction.over_step(step).commit(x, 0.0), None)
    for term in system.with_history(history).bound[1:3]:
        term.add_force(x, 0 * x, 0.0, hold)
    hold *= -1
    context = static_context(system, "auto", 200, "direct")
    for part in np.linspace(1, 0, 21)[1:]:
        increment = LoadIncrement(system, system.state(x), part, 0.05, 0.0, 0.0, history)
        solved, over = solve_increment(increment, 0.0, context)
        x = solved.x
        history = over.commit(system.state(x), history)
    return {"error": mean_curvature(system, x) / (HB / B) - 1}


def mean_curvature(system: fc.System, x: np.ndarray) -> float:
    """κ₁₁ [1/m] over the middle six tenths of the strip."""
    cloth = system.cloth
    kappa, _ = system.bound[1].curvatures(x, 0.0)
    along = cloth.X[cloth.triangles[:, :3]].mean(axis=1)[:, 0] / L
    parts = len(kappa) // len(along)
    weights = np.repeat(cloth.weights.sum(axis=1) * (abs(along - 0.5) < 0.3), parts)
    return float(np.average(kappa[:, 0], weights=weights))


# --- cantilever -----------------------------------------------------------------------------------


def deflections(m: float, share: float = SHARE) -> tuple[np.ndarray, np.ndarray]:
    """Places (k,) [m] and small deflections [m] of a strip laid down; m may be ∞.

    The moment of the weight w is w (L − X)²/2. Where it exceeds HB (1 + 1/m) the curvature is
    (moment − HB)/B, elsewhere the slider sticks: moment/((1 + m) B).
    """
    w = 8 * B * SAG / L**3
    HB = share * w * L**2 / 2
    X = np.linspace(0, L, 20_001)
    moment = w * (L - X) ** 2 / 2
    kappa = np.where(moment > HB * (1 + 1 / m), (moment - HB) / B, moment / ((1 + m) * B))
    slope = np.concatenate([[0], np.cumsum(0.5 * (kappa[1:] + kappa[:-1]) * np.diff(X))])
    return X, np.concatenate([[0], np.cumsum(0.5 * (slope[1:] + slope[:-1]) * np.diff(X))])


def closed_form(share: float = SHARE) -> float:
    """w/(8B) (L² − 2HB/w)² [m], the deflection of the end for m → ∞."""
    return SAG * L * (1 - share) ** 2


def cantilever(
    pattern: str = "right",
    element: str = "P1",
    n: int = 16,
    m: float = M,
    share: float = SHARE,
    friction: str = "laid",
) -> tuple[np.ndarray, np.ndarray]:
    """Places (n,) and deflections (n,) [m] of a strip under its weight."""
    w = 8 * B * SAG / L**3
    cloth = rectangle(L, 0.25 * L, L / n, pattern, element)
    HB = share * w * L**2 / 2
    given = fabric(HB, areal_density=w / GRAVITY, tensile_stiffness=50.0)
    terms = [fc.StVK(), fc.PlateBending(), fc.Gravity()]
    terms += [fc.BendingFriction(m)] if share else []
    system = fc.System(cloth, given, terms, [fc.Pin("left", clamp=True)])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = fc.equilibrium(system, system.rest(), load_steps=20, friction=friction)
    return cloth.X[:, 0], -found.x[:, 2]


def end(places: np.ndarray, heights: np.ndarray) -> float:
    return float(heights[places > L - 1e-9].mean())


def laid(pattern: str, element: str, n: int) -> dict:
    """Error of the deflection of the end, laid down."""
    _, exact = deflections(M)
    return {"error": end(*cantilever(pattern, element, n)) / exact[-1] - 1}
