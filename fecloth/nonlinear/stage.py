"""The stage of an implicit step: x, v and a as affine maps of one unknown q."""

from dataclasses import dataclass, replace

import numpy as np

from fecloth.errors import InputError
from fecloth.system.state import State
from fecloth.system.system import System
from fecloth.terms.step_difference import StepDifference


@dataclass(frozen=True, eq=False)
class Stage:
    """The maps from the unknown q (n, 3) of a step to the state in which the forces balance.

        x = x̃ + wx q,   v = ṽ + wv q,   a = ã + wa q,   M a = f(x, v, t)

    So Newton's matrix is J = wa M + wv D + wx K for every method. The fields `x`, `v` and `a`
    are x̃, ṽ and ã, the values at q = 0. A `StageMethod` then takes as its new state

        x₁ = x_end + w_end q,   v₁ = v₀ + dt a

    Attributes
    ----------
    t
        Time at which the forces balance [s].
    x
        (n, 3) x̃ [m].
    v
        (n, 3) ṽ [m/s].
    a
        (n, 3) ã [m/s²].
    wx
        Weight of q in x.
    wv
        Weight of q in v.
    wa
        Weight of q in a.
    x_end
        (n, 3) position at the end of the step for q = 0 [m].
    w_end
        The weight of q there.
    """

    t: float
    x: np.ndarray
    v: np.ndarray
    a: np.ndarray
    wx: float
    wv: float
    wa: float
    x_end: np.ndarray
    w_end: float

    def at(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """x, v, a of an unknown q (n, 3)."""
        return self.x + self.wx * q, self.v + self.wv * q, self.a + self.wa * q

    def difference(self, state: State, dt: float) -> StepDifference:
        """The rate over a step from `state` that is the stage's own velocity for y = x.

        v = (x − (x̃ − h ṽ))/h with h = wx/wv.
        """
        h = self.wx / self.wv
        return StepDifference(state.x, dt, h, ((1.0, self.x - h * self.v),), t=state.t)


def hold_stage(system: System, stage: Stage, at: State, a: np.ndarray) -> Stage:
    """Return the stage with its held directions at x and v of `at` and at the acceleration a."""
    hold = system.constraints.hold
    x = hold(stage.x, at.x)
    v = hold(stage.v, at.v)
    a = hold(stage.a, a)
    return replace(stage, x=x, v=v, a=a)


def prescribed(system: System, stage: Stage, state: State, dt: float, end: State) -> Stage:
    """Return the stage with its held directions at the prescribed `end` of the step.

    In the held directions the unknown is known: q̂ = (end.x − x_end)/w_end. It moves into x̃, ṽ
    and x_end, so that q is 0 there. The held acceleration is the change of the prescribed
    velocity over the step from `state`, which takes dt [s]. Raise `InputError` for a stage with
    arrays of another shape than the positions, as a method by a user may make it.
    """
    for name in ("x", "v", "a", "x_end"):
        shape = np.shape(getattr(stage, name, 0.0))
        if shape != state.x.shape:
            what = f"stage.{name} of shape {shape}"
            raise InputError(what, f"must be {state.x.shape}", "step")
    constraints = system.constraints
    if not len(constraints.without_own[0]):
        return stage
    held_q = constraints.correction((end.x - stage.x_end) / stage.w_end)
    added_a = constraints.correction((end.v - state.v) / dt - stage.a)
    return replace(
        stage,
        x=stage.x + stage.wx * held_q,
        v=stage.v + stage.wv * held_q,
        a=stage.a + added_a,
        x_end=stage.x_end + stage.w_end * held_q,
    )
