"""The generalised-α method."""

from __future__ import annotations

from dataclasses import dataclass

from fecloth.errors import InputError, is_number
from fecloth.integrators.newmark import AccelerationMethod
from fecloth.integrators.protocol import ALL_STUDIES, MethodTraits


@dataclass(frozen=True)
class GeneralizedAlpha(AccelerationMethod):
    """M a_m = f(x_f, v_f): α_m = (2ρ − 1)/(ρ + 1), α_f = ρ/(ρ + 1), with ρ = ρ∞.

    Second order by γ = ½ − α_m + α_f, and A-stable with β = (1 − α_m + α_f)²/4. A mode keeps ρ∞
    of its amplitude a step as ω dt → ∞; with ρ∞ = ½ it loses 1e-2 at ω dt = 1 and 1.4e-4 at 0.3,
    with ρ∞ = 1 nothing at any. Keeps linear momentum, not angular, nor energy: on nonlinear
    problems it can grow at steps that do not resolve the fast modes (it did on a sheet that swings
    down, dt = 10 ms, far more for ρ∞ = 0.8 than for ½), where BDF2 and backward Euler lose it.
    Source: Chung and Hulbert (1993), A Time Integration Algorithm for Structural Dynamics With
    Improved Numerical Dissipation: The Generalized-α Method, J. Appl. Mech. 60.

    Parameters
    ----------
    rho_inf
        In [0, 1].
    """

    rho_inf: float = 0.5

    def __post_init__(self) -> None:
        if not (is_number(self.rho_inf) and 0 <= self.rho_inf <= 1):
            raise InputError(
                f"rho_inf = {self.rho_inf!r}", "must lie in [0, 1]", "GeneralizedAlpha"
            )

    @property
    def parameters(self) -> tuple[float, float, float, float]:
        alpha_m = (2 * self.rho_inf - 1) / (self.rho_inf + 1)
        alpha_f = self.rho_inf / (self.rho_inf + 1)
        lag = alpha_f - alpha_m
        return alpha_m, alpha_f, 0.25 * (1 + lag) ** 2, 0.5 + lag

    @property
    def traits(self) -> MethodTraits:  # type: ignore[override]  # constant in the base, here computed
        """Error constant β − ½ (α_f − α_m) − 1/6: a is that of a time (α_f − α_m) dt before."""
        alpha_m, alpha_f, beta, _ = self.parameters
        lag = alpha_f - alpha_m
        return MethodTraits(
            order=2,
            error_constant=beta - 0.5 * lag - 1 / 6,
            drift=(2, 1 / 12 + 3 / 8 * lag**2),
            at_infinity=self.rho_inf,
            gains=self.rho_inf > 0,
            studied=ALL_STUDIES,
        )
