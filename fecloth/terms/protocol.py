"""What a term offers: the description that a user writes, the bound term, optional abilities.

A term is one contribution to the force f(x, v, t) of the cloth. It comes in two objects: a frozen
description with the user's parameters (`Term`), and what `bind` makes of it for one mesh
(`BoundTerm`). Neither depends on the time step, the solver or other terms.
studies/examples/term.py is a term in 30 lines.

The other protocols are abilities that a bound term may have besides. fecloth looks for their
functions by name. Those that say "Reserved" are not called yet: their names and arguments are
fixed, so that a term which has them need not change.

Arrays: n is the number of nodes; x (n, 3) [m] are positions, v (n, 3) [m/s] velocities, t [s] the
time. They must not be changed, but for the one named as the result.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
import scipy.sparse as sparse

from fecloth.compiled.calls import Calls
from fecloth.errors import InputError, brief, with_article
from fecloth.fabric.panel import Panel
from fecloth.linalg.block_matrix import BlockMatrix
from fecloth.mesh.cloth import Cloth
from fecloth.terms.step_difference import StepDifference

ALWAYS = (
    "name",
    "symmetric",
    "has_energy",
    "dissipative",
    "velocity_dependent",
    "add_force",
    "add_tangent",
    "rate_bounds",
)


class Term(Protocol):
    """What a user writes: a frozen dataclass with the parameters of the term.

    It may have an attribute `elements`, the names of the elements that it supports, as
    ``("P1", "P2")``. Without it, the term is for P1 alone. Another is `no_space_error`, a text
    that says, after the name of the term, why `space_error` has no estimate with it.
    """

    def stencil(self, cloth: Cloth) -> np.ndarray | None:
        """(m, k) integers: the nodes that each of m elements couples, or None for no coupling.

        Their blocks become part of the pattern of the matrix. The diagonal always is.
        """
        ...

    def bind(self, panel: Panel, slots: Callable[[np.ndarray], np.ndarray]) -> BoundTerm:
        """Make the bound term for a mesh.

        Parameters
        ----------
        panel
            The cloth with its fabrics: ``panel.cloth`` is the mesh, ``panel.density`` the mass
            per area, ``panel.gradients`` the gradients of the shape functions in warp and weft.
        slots
            ``slots(stencil)`` (m, k, k): the block of the matrix for each pair of nodes of a
            stencil, an index into ``J.values``. Call it once, here or at the first tangent: runs
            of explicit methods then make no matrix.

        Raises
        ------
        InputError
            For parameters that do not fit the mesh.
        """
        ...


class BoundTerm(Protocol):
    """A term for one mesh; it must not change after it was made.

    Attributes
    ----------
    name
        The name of its columns in the energy ledger.
    symmetric
        Whether its tangents K and D are symmetric matrices.
    has_energy
        Whether it has an `energy`; then `add_force` at v = 0 must be −∂energy/∂x.
    dissipative
        Whether it has a dissipated `power`.
    velocity_dependent
        Whether its force depends on v, so that D is not zero.
    load
        Optional; True for a force from outside, which the load steps of `equilibrium` scale.
    no_equilibrium
        Optional; why there is no unique equilibrium with the term, as with friction.
    stores_strain
        Optional; False for a term whose energy is not that of a strain: the error in space leaves
        it out.
    """

    name: str
    symmetric: bool
    has_energy: bool
    dissipative: bool
    velocity_dependent: bool

    def add_force(self, x: np.ndarray, v: np.ndarray, t: float, f: np.ndarray) -> None:
        """f += the force (n, 3) [N], in place."""
        ...

    def add_tangent(
        self,
        x: np.ndarray,
        v: np.ndarray,
        t: float,
        wx: float,
        wv: float,
        J: BlockMatrix,
        definite: bool,
    ) -> None:
        """J += wx K + wv D with K = −∂f/∂x [N/m] and D = −∂f/∂v [N s/m], in place.

        Add to ``J.values`` (blocks, 3, 3) at the slots that `bind` got. With `definite` what is
        added must be symmetric and positive semi-definite: Newton's method asks for that where
        the exact tangent fails.
        """
        ...

    def rate_bounds(self, mass: np.ndarray) -> tuple[float, float]:
        """Upper bounds of the largest eigenvalues of M⁻¹K [1/s²] and M⁻¹D [1/s] at rest.

        `mass` (n,) [kg] are the nodal masses. Bounds by elements suffice; they guide the choice
        of the linear solver and the stable step.
        """
        ...


class Energetic(Protocol):
    """The ability of a term with `has_energy`."""

    def energy(self, x: np.ndarray, t: float) -> float:
        """Potential energy [J]; its column of the ledger, and what Newton's line search lowers.

        As `power` and `supply` it is the sum over the nodes and elements that the term holds;
        ``System.sums.total`` makes it that over the whole cloth.
        """
        ...


class Dissipative(Protocol):
    """The ability of a term with `dissipative`."""

    def power(self, x: np.ndarray, v: np.ndarray, t: float) -> float:
        """Dissipated power [W], −f · v of the damping part; ≥ 0 for damping."""
        ...


class Supplying(Protocol):
    """The ability of a load without an energy: its work gets a column of the ledger."""

    def supply(self, x: np.ndarray, v: np.ndarray, t: float) -> float:
        """Power f · v [W] that the load does on the cloth."""
        ...


class DenseTangent(Protocol):
    """The ability of a term that couples all nodes by one mode, such as the pressure of a gas."""

    def dense(self, x: np.ndarray, t: float) -> tuple[float, np.ndarray]:
        """c [N/m] and u (n, 3) of a part c u uᵀ of K that `add_tangent` leaves out."""
        ...


class Stressed(Protocol):
    """The ability of a membrane: frames show its stress."""

    def add_stress(self, x: np.ndarray, out: np.ndarray) -> None:
        """out (triangles, 4) += S₁₁, S₂₂, S₁₂ [N/m] and the energy per area [J/m²], in place."""
        ...


class Recovered(Protocol):
    """The ability of a membrane or plate to estimate its error in space.

    A system in which another term has an energy, and is no load, has no estimate.
    """

    def strain_error(self, x: np.ndarray, t: float) -> np.ndarray:
        """(triangles,) energy [J] of the recovered strain minus the strain of the mesh."""
        ...


class OverStep(Protocol):
    """The ability to act over a step: the force depends on where the step began.

    `BackwardEuler`, `BDF2` and `EnergyMomentum` ask for it; the other methods call the term itself.
    `EnergyMomentum` needs it of each term with an energy.

    Attributes
    ----------
    needs_difference
        Optional; True for a term that other methods must refuse, because only `BackwardEuler` and
        `BDF2` have a difference for rates over the step.
    """

    def over_step(self, step: StepDifference) -> BoundTerm:
        """The term over this step, or the term itself where it does not depend on the step.

        Where ``step.at_mean`` is False, x is the end of the step. An `energy` of what is returned
        is then its potential over the step, −∂energy/∂x its force, so that the step can minimise.
        Where it is True, x is the mean of both ends, and the force does the work of the energy.
        """
        ...


class DissipatesOverStep(Protocol):
    """The ability of what `over_step` returns, if the term is `dissipative` by itself."""

    def dissipation(self, x: np.ndarray) -> float:
        """Energy [J] dissipated in the step that ends at x: the ledger's column of the term."""
        ...


class LimitsDirection(Protocol):
    """The ability to limit a Newton direction, such as up to a contact.

    The line searches of steps and of `equilibrium` ask for it. The energy of such a term is +∞, and
    its force is NaN, where the cloth may not be.

    Attributes
    ----------
    needs_end
        Why only methods that solve for the forces at the end of a step may be used: `BackwardEuler`
        and `BDF2`. The others refuse the term with these words.
    """

    needs_end: str

    def limit(self, x: np.ndarray, s: np.ndarray, t: float) -> float:
        """The largest α in [0, 1] for which the term allows the way from x to x + α s.

        Both are (n, 3) [m]; the term allows x.
        """
        ...

    def check_start(self, x: np.ndarray, t: float, where: str) -> None:
        """Raise `InputError` for positions (n, 3) that the term does not allow."""
        ...


class KeepsDistance(Protocol):
    """The ability of contact to tell its least distance, a column of what is observed.

    The sum of its force is a column too, as the reaction.
    """

    def least_distance(self, x: np.ndarray, t: float) -> float:
        """The least distance [m] of the cloth at x (n, 3) from what it must not enter."""
        ...


class ShowsContact(Protocol):
    """The ability of contact to be drawn; `slip` and `surface` are those of obstacles alone."""

    def push(self, x: np.ndarray, t: float) -> np.ndarray:
        """(n, 3) force on the nodes without friction [N]."""
        ...

    def slip(self, x: np.ndarray, v: np.ndarray, t: float) -> np.ndarray:
        """(n, 3) velocity [m/s] along the obstacle and relative to it, of nodes that touch."""
        ...

    def surface(self, t: float, place: np.ndarray, reach: float) -> tuple[np.ndarray, np.ndarray]:
        """Points (p, 3) and triangles (q, 3); of an endless obstacle within `reach` of a place."""
        ...


class AdmitsGuess(Protocol):
    """The ability of what `over_step` returns, of a term that limits directions."""

    def admit(self, x: np.ndarray, t: float) -> np.ndarray:
        """Positions (n, 3) near x that are allowed at the end t of the step; x itself if it is."""
        ...


class Coupling(Protocol):
    """The ability to couple nodes outside the fixed pattern, as contact between triangles does."""

    def coupling(
        self, x: np.ndarray, v: np.ndarray, t: float, wx: float, wv: float, definite: bool
    ) -> sparse.spmatrix | None:
        """(3n, 3n) part of wx K + wv D that `add_tangent` leaves out; None if nothing is coupled.

        Its pattern may change from call to call. `definite` is that of `add_tangent`.
        """
        ...


class ElementEnergies(Protocol):
    """Reserved: the ability to tell where the energy is. Nothing calls it yet."""

    def element_energies(self, x: np.ndarray, t: float) -> np.ndarray:
        """(m,) [J] shares of the elements of `stencil`; their sum is `energy`."""
        ...


class CompiledForce(Protocol):
    """The ability to take part in explicit steps without Python between them.

    A class that overrides `add_force` must override `force_calls` too; else it is not asked.
    """

    def force_calls(self, x: np.ndarray, v: np.ndarray, t: float, f: np.ndarray) -> Calls | None:
        """The kernels that make up `add_force`, in order, each with its arguments.

        They are called again and again while x, v and f change in place, and may have work arrays
        of their own. None where the force depends on t or needs Python. The bits must be those of
        `add_force`. A `SharedCall`, as `SharedLoop` makes it, is for several threads; one of them
        makes all other calls.
        """
        ...


def stencil(term: Term, cloth: Cloth) -> np.ndarray | None:
    """The nodes (m, k) that a term couples, or None, checked.

    Raises
    ------
    InputError
        For another shape, what is no whole number, and nodes that the cloth does not have.
    """
    nodes, name = term.stencil(cloth), type(term).__name__
    if nodes is None:
        return None
    if not (isinstance(nodes, np.ndarray) and nodes.ndim == 2 and nodes.dtype.kind in "iu"):
        what = f"stencil(cloth) = {brief(nodes)}"
        if isinstance(nodes, np.ndarray):
            what = f"stencil(cloth) of shape {nodes.shape} and type {nodes.dtype}"
        raise InputError(what, "must be an array (m, k) of nodes, or None", name)
    if nodes.size and not 0 <= nodes.min() <= nodes.max() < len(cloth.X):
        what = f"stencil(cloth) with the nodes {nodes.min()} … {nodes.max()}"
        raise InputError(what, f"must lie in 0 … {len(cloth.X) - 1}", name)
    return nodes


def bound(term: Term, panel: Panel, slots: Callable) -> BoundTerm:
    """The bound term, checked.

    Raises
    ------
    InputError
        If it lacks an attribute or a function that a `BoundTerm` must have.
    """
    made = term.bind(panel, slots)
    wanted = list(ALWAYS)
    wanted += ["energy"] if getattr(made, "has_energy", False) else []
    wanted += ["power"] if getattr(made, "dissipative", False) else []
    if missing := [name for name in wanted if not hasattr(made, name)]:
        what = f"{type(term).__name__}.bind(panel, slots) gives {with_article(type(made).__name__)}"
        remedy = "help(fecloth.terms.protocol.BoundTerm) says what each is."
        raise InputError(what, f"must have {', '.join(missing)}", "System", remedy)
    return made
