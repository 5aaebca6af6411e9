"""Drag in moving air: uniform wind, a field of position and time, or gusts."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from fecloth import validation
from fecloth.errors import InputError, is_number
from fecloth.fabric.panel import Panel
from fecloth.quantities.units import LENGTH, SPEED
from fecloth.terms.loads import air_velocity
from fecloth.terms.loads.air_velocity import Uniform
from fecloth.terms.loads.drag import BoundDrag, Coefficient, bind_drag, check_drag
from fecloth.terms.protocol import element_nodes
from fecloth.terms.traits import DRAG

GUST_INTENSITY_LIMIT = 2.0
"""Largest turbulence intensity that `Wind` takes.

Behind bluff bodies the intensity reaches 1; the limit is twice that, and refuses percent.
"""


@dataclass(frozen=True)
class Wind:
    """`Drag` in moving air: the same force, with the velocity of the cloth relative to the air.

        F = −A (k_n |w_n|ᵖ⁻¹ w_n n + k_t |w_t|ᵖ⁻¹ w_t),   w = v̄ − u(x, t)

    u is the velocity of the air at the centroids of the triangles. On a cloth that is inclined
    to the wind the force along the normal n gives both drag and lift.

    Use `Wind` instead of a `Drag` and not with it, or the drag is counted twice. The power Σ F
    · v̄ = Σ F · w + Σ F · u has a dissipated part, ``dissipated:Wind`` in the energy ledger,
    and the work of the wind, ``work:Wind``.

    Source: `Drag` with w = v̄ − u(x, t); gusts after Kraichnan (1970), Diffusion by a random
    velocity field, Physics of Fluids 13, 22–31 (`fecloth.terms.loads.air_velocity.Gusts`).

    Valid where `Drag` is, if the cloth does not change the motion of the air: no wake, no
    shielding of one part by another, no flutter that the motion of the air causes.

    Parameters
    ----------
    velocity
        u: three numbers [m/s], formulas of x, y, z [m] and t [s] as text, or a function
        ``u(x, t)`` of all centroids (m, 3) that returns (m, 3), or (3,) for uniform wind. The
        exact tangent computes ∂u/∂x by central differences over 2e-5 m.
    normal, tangential
        k_n and k_t as of `Drag`, >= 0. Linear: [Pa s/m]. Quadratic: [Pa s²/m²], equal to ½ ρ C:
        `normal` is 0.7 for a square plate and 1.2 for a long plate.
    law
        "quadratic" or "linear".
    tangent
        "symmetric" or "exact", see `Drag`.
    gusts
        Turbulence intensity, 0 … 2: the standard deviation of each component over the mean
        speed. With gusts `velocity` must be three numbers. The field is described in
        `fecloth.terms.loads.air_velocity.Gusts`.
    gust_length
        Length of the gusts [m].
    seed
        Seed of the random waves. Equal seeds give equal gusts.

    Examples
    --------
    >>> import fecloth as fc
    >>> breeze = fc.Wind((5.0, 0.0, 0.0), normal=0.7, tangential=0.01, gusts=0.2, seed=3)
    >>> shear = fc.Wind(("2 * z", 0, 0), normal=0.7)
    """

    velocity: Annotated[
        tuple[float | str, float | str, float | str] | Callable[[np.ndarray, float], np.ndarray],
        SPEED,
    ]
    normal: Coefficient
    tangential: Coefficient = 0.0
    law: str = "quadratic"
    tangent: str = "symmetric"
    gusts: float = 0.0
    gust_length: Annotated[float, LENGTH] = 1.0
    seed: int = 0

    traits = DRAG

    def __post_init__(self):
        """Raise `InputError` for a parameter that is not allowed."""
        check_drag(self)
        air_velocity.velocity_field(self.velocity, "Wind")
        if not (is_number(self.gusts) and 0 <= self.gusts <= GUST_INTENSITY_LIMIT):
            limit = f"{GUST_INTENSITY_LIMIT:g}"
            allowed = f"must be in 0 … {limit}: the standard deviation over the mean speed"
            remedy = "In the open air it is 0.1 to 0.3."
            raise InputError(f"gusts = {self.gusts!r}", allowed, "Wind", remedy)
        validation.positive("gust_length", self.gust_length, "m", "Wind")
        if not (is_number(self.seed) and 0 <= self.seed < 2**32):
            raise InputError(f"seed = {self.seed!r}", "must be in 0 … 2³² − 1", "Wind")
        u = self.velocity
        if self.gusts and (callable(u) or any(isinstance(part, str) for part in u)):
            allowed = "velocity must be three numbers"
            remedy = "Add fecloth.terms.loads.air_velocity.Gusts to your own function."
            raise InputError("gusts of a wind that is not uniform", allowed, "Wind", remedy)

    stencil = element_nodes

    def bind(self, panel: Panel, slots) -> BoundDrag:
        """Return the drag on a panel, in gusts or in the field of the `velocity`."""
        if self.gusts:
            # Three numbers, as `__post_init__` has checked.
            x, y, z = map(float, self.velocity)  # type: ignore[arg-type]  # not a function
            gusts = air_velocity.Gusts(
                mean=(x, y, z), intensity=self.gusts, length=self.gust_length, seed=self.seed
            )
            return bind_drag(self, gusts, panel, slots, BoundWind)
        wind = air_velocity.velocity_field(self.velocity, "Wind")
        return bind_drag(self, wind, panel, slots, BoundWind)


@dataclass(frozen=True, eq=False)
class BoundWind(BoundDrag):
    """`Wind` on a cloth: a drag in moving air, which does work on the cloth."""

    name = "Wind"
    load = True

    @property
    def steady_air(self) -> np.ndarray | None:
        """(3,) the velocity of the air where it is constant [m/s], else None."""
        if isinstance(self.wind, Uniform) and self.wind.value.is_constant:
            return self.wind.value(0.0)
        return None

    def supply(self, x, v, t) -> float:
        """Power Σ F · u of the wind [W]."""
        return self.powers(x, v, t)[1]
