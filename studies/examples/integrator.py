"""Two integrators of a user: one defined by its stage, and one composed of another's steps.

`Theta` balances the forces at one point between the old and the new state. Its stage defines it:

    M (v₁ − v₀)/dt = f(x_θ, v_θ),   x₁ = x₀ + dt v_θ,   y_θ = y₀ + θ (y₁ − y₀);   q = v₁ − v₀

`SDIRK2` has two stages, each a backward Euler step over γ dt, γ = 1 − 1/√2. The first gives a slope
y'; the second starts from y₀ + (1 − γ) dt y'. The method is of second order, A- and L-stable, and
has no memory, so that each step may have another size. Its stages are `Theta(1.0)`, because
`BackwardEuler` takes strain rates over its step, which is of first order between stages.
Source: Alexander (1977), Diagonally implicit Runge–Kutta methods for stiff O.D.E.'s, SIAM J.
Numer. Anal. 14, 1006–1021.
"""

import math
from dataclasses import dataclass, replace

import fecloth as fc
from fecloth import integrators


@dataclass(frozen=True)
class Theta(integrators.StageMethod):
    theta: float = 0.6

    @property
    def traits(self):
        return integrators.MethodTraits(order=1, theta=self.theta)  # order 2 only for θ = ½

    def stage(self, state, dt):
        w, s, end = self.theta, self.theta * dt, state.x + dt * state.v
        x = state.x + s * state.v  # and x_θ = x + θ s q, v_θ = v₀ + θ q, a = q/dt, x₁ = end + s q
        return integrators.Stage(state.t + s, x, state.v, 0 * x, w * s, w, 1 / dt, end, s)


@dataclass(frozen=True)
class SDIRK2(integrators.WithMemory):  # the memory serves the energy balance
    gamma = 1 - math.sqrt(0.5)  # error constant: coefficient of z³ in R(z) − exp z
    traits = integrators.MethodTraits(order=2, error_constant=3 * gamma**2 - 2 * gamma**3 - 1 / 6)

    def step(self, system, state, dt, solver, memory=None, history=None):
        euler, h, rest = Theta(1.0), self.gamma * dt, (1 - self.gamma) * dt
        a = euler.step(system, state, h, solver, memory, history)
        x, v = state.x + rest * a.state.v, state.v + rest / h * (a.state.v - state.v)
        end = integrators.prescribed_end(system, state, rest)
        middle = integrators.set_prescribed(system, fc.State(state.t + rest, x, v), end)
        b = euler.step(system, middle, h, solver, a.memory, history)  # what terms remember at y₀
        counts, slope = a.counts.plus(b.counts), (b.state.v - middle.v) / h
        ends = system.with_history(history), state
        return replace(b, balanced_at=b.state, counts=counts, ends=ends, a=slope)


if __name__ == "__main__":
    cloth = fc.Cloth.rectangle(0.4, 0.3, h=0.1, pattern="right")
    damped = [fc.StVK(), fc.StrainRateDamping(1e-3), fc.Gravity()]
    system = fc.System(cloth, fc.Fabric(0.2, 1000.0, 0.3), damped, pins=["boundary"])
    start = system.state(system.rest().x * [1.1, 1.1, 1])
    for method in (Theta(0.5 + 0.1), SDIRK2(), fc.BDF2()):
        orders = fc.verify.check_integrator(system, method, start, t_end=0.01)
        factors = fc.stability.amplification(method, [0.1, 1e6])
        print(f"{method}: order {orders[-1]:.2f}, at ω dt = 0.1 and 1e6 amplified by {factors}")
