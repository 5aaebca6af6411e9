"""Energy–momentum: the midpoint rule with forces that depend on both ends of the step."""

from dataclasses import dataclass, replace
from functools import cached_property

from fecloth import validation
from fecloth.integrators.one_stage import ImplicitMidpoint, StageMethod
from fecloth.integrators.protocol import MethodTraits
from fecloth.integrators.step import Begin, Step
from fecloth.linalg import select
from fecloth.nonlinear.context import FactorReuse, SolverContext
from fecloth.nonlinear.newton import NewtonFailed
from fecloth.system.state import State
from fecloth.system.system import History, System
from fecloth.terms.discrete_gradient import DiscreteGradient
from fecloth.terms.protocol import BoundTerm
from fecloth.terms.step_difference import StepDifference

# Iterations with the symmetric tangent, after which the exact tangent is taken. They cost as much
# as 24 exact ones, since each takes a fifth of the time.
MOST_SYMMETRIC_ITERATIONS = 120


@dataclass(frozen=True)
class EnergyMomentum(StageMethod):
    """M (v₁ − v₀)/dt = f̄(x₀, x₁), x₁ = x₀ + dt (v₀ + v₁)/2; unknown q = v₁ − v₀.

    f̄ is a discrete gradient, −f̄ · (x₁ − x₀) = U(x₁) − U(x₀), term by term. With d = x₁ − x₀,
    f at the mean position, and u = M d without its rigid part,

        f̄ = f − (N / u·d) u,   N = U(x₁) − U(x₀) + f · d

    For f, membranes take the stress of the averaged Green strain, and hinges the averaged angle.
    N is zero for membranes quadratic in E, and by other lengths at rest for springs and
    `BaraffWitkin`: only these have an exact tangent. Damping and loads without an energy act at
    the mean position, velocity and time. The details are in `fecloth.terms.discrete_gradient`.

    Second order, A-stable, no damping of linear modes of any frequency. Keeps the energy, and
    linear and angular momentum where no load is fixed in space, to the Newton tolerance, at
    any step. What a step does not resolve is wrong nevertheless, in phase and shape, and is
    not damped away: where a cloth crumples at long steps, Newton takes 2 to 7 times the CPU
    time of `BackwardEuler`, or fails (`hanging` in studies/evidence/newton_catalogue).

    Source: Simo and Tarnow (1992), The Discrete Energy–Momentum Method, ZAMP 43; Gonzalez
    (1996), Time Integration and Discrete Hamiltonian Systems, J. Nonlinear Sci. 6.

    Parameters
    ----------
    tangent
        "exact": not symmetric, needs a direct solver. "symmetric": for any solver, but not for
        steps that turn the cloth by half a radian. "auto": symmetric, and exact in a step that
        does not converge in 120 iterations.
    """

    tangent: str = "auto"

    def __post_init__(self) -> None:
        tangents = ("auto", "symmetric", "exact")
        validation.one_of("tangent", self.tangent, tangents, "EnergyMomentum")

    @cached_property
    def traits(self) -> MethodTraits:  # type: ignore[override]  # a constant of the base class
        """A-stable; its matrix is symmetric if the tangents of the forces between states are."""
        midpoint = ImplicitMidpoint.traits
        symmetric = self.tangent != "exact"
        return replace(midpoint, symmetric=symmetric, gains=False, studied=("stability",))

    stage = ImplicitMidpoint.stage

    def _take(self, begin: Begin, solver: SolverContext) -> Step:
        """Take one step with the tangent that `tangent` says.

        With "auto" it is the symmetric tangent, or the exact one if Newton's iteration does not
        converge in `MOST_SYMMETRIC_ITERATIONS`, or if the solver takes matrices that are not
        symmetric. Newton's iteration has no estimate of the step's error, by which it might end
        early: the balance of energy needs a small residual. Raises `NewtonFailed` if the exact
        tangent fails too.
        """
        solver = replace(solver, step_error=None)
        options = solver.options
        is_clamped = options.definiteness == "clamp"  # a clamped tangent is always symmetric
        if self.tangent != "auto" or is_clamped:
            return super()._take(begin, solver)
        if solver.matrix_solver()[0].symmetric:
            most_iterations = min(MOST_SYMMETRIC_ITERATIONS, options.max_iterations)
            limited = replace(options, max_iterations=most_iterations)
            try:
                return super()._take(begin, replace(solver, options=limited))
            except NewtonFailed:
                linear = select.direct(symmetric=False)  # the exact tangent is not symmetric
                solver = replace(solver, linear=linear, factor_reuse=FactorReuse())
        return replace(self, tangent="exact")._take(begin, solver)

    def difference(self, state: State, dt: float) -> StepDifference:
        """The mean rate, (y(x) − y(x₀))/(dt/2) at the mean x of both ends."""
        past = ((1.0, state.x),)
        symmetric = self.traits.symmetric
        return StepDifference(
            state.x, dt, dt / 2, past, at_mean=True, symmetric=symmetric, t=state.t
        )

    def over_step(
        self, system: System, state: State, dt: float, history: History | None = None
    ) -> System:
        """Return the system over a step from `state`, with a discrete gradient for each energy.

        Its forces at the mean position x do exactly the work −ΔU of the energies from x₀ to
        x₁ = 2x − x₀. Terms without an energy, and terms that conserve it anyway, stay.
        """
        over = system.over_step(self.difference(state, dt), history)
        mass = system.diagonal_mass
        t = state.t + 0.5 * dt

        def conserve(term: BoundTerm, acting: BoundTerm, record: object) -> BoundTerm:
            if acting.conserves or not term.has_energy:
                return acting
            # of a term with a history, only `acting` counts the heat of the step as energy
            with_energy = term if record is None else acting
            return DiscreteGradient(with_energy, acting, state.x, mass, t)

        records = history or (None,) * len(system.bound)
        return system.with_bound(map(conserve, system.bound, over.bound, records))
