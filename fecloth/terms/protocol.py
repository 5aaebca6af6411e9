"""What a term offers: the description that a user writes, its traits, and the bound term.

A term is one contribution to the force f(x, v, t) of the cloth. It comes in two objects: a
frozen description with the user's parameters (`Term`), and what `bind` makes of it for one
mesh (`BoundTerm`). Neither depends on the time step, the solver or other terms.
studies/examples/term.py is a term in 30 lines.

`TermTraits` on the class of the description say what the term is: all that the rest of fecloth
knows of it. A description without traits is a term of no kind.

`BoundTerm` has all abilities of a bound term, which do nothing. The bound term of your own term
derives from it and writes the abilities that it has.

Arrays: n is the number of nodes; x (n, 3) [m] are positions, v (n, 3) [m/s] velocities, t [s]
the time. They must not be changed, but for the one named as the result.
"""

from collections.abc import Callable, Sequence
from operator import attrgetter
from typing import Any, Protocol

import numpy as np
import scipy.sparse as sparse

from fecloth.compiled.calls import Calls
from fecloth.errors import InputError, brief, with_article
from fecloth.fabric.panel import Panel
from fecloth.linalg.block_matrix import BlockMatrix
from fecloth.mesh.cloth import Cloth
from fecloth.terms.step_difference import StepDifference

FLAGS = ("symmetric", "has_energy", "dissipative", "velocity_dependent")
ALWAYS = ("name", *FLAGS, "add_force", "add_tangent")
At = tuple[np.ndarray, float]  # positions (n, 3) [m] and time [s]


class Term(Protocol):
    """What a user writes: a frozen dataclass with the parameters of the term.

    It may have `traits`, its `TermTraits`, as a class attribute. Three of them may stand
    alone: the attributes `elements`, `holds_normals` and, for `space_error`, `no_space_error`.
    """

    def stencil(self, cloth: Cloth) -> np.ndarray | None:
        """(m, k) integers: the nodes that each of m elements couples, or None for no coupling."""

    def bind(self, panel: Panel, slots: Callable[[np.ndarray], np.ndarray]) -> "BoundTerm":
        """Make the bound term for a mesh.

        Raises `InputError` for parameters that do not fit the mesh.

        Parameters
        ----------
        panel
            The cloth with its fabrics: ``panel.cloth`` is the mesh, ``panel.density`` the mass
            per area, ``panel.gradients`` the gradients of the shape functions in warp and weft.
        slots
            ``slots(stencil)`` (m, k, k): the block of the matrix for each pair of nodes of a
            stencil, an index into ``J.values``. Call it once, here or at the first tangent: runs
            of explicit methods then make no matrix.
        """


def overrides(name: str) -> Any:
    """Whether a bound term has its own function of that name, as a property."""
    return property(lambda term: has_own(term, name))


class BoundTerm:
    """A term for one mesh; it must not change after it was made.

    A term must have `name`, `symmetric`, `has_energy`, `add_force` and `add_tangent`; `energy`
    if it has one, and `power` if it is dissipative. All else does nothing here.

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
    damps_linearly
        True for a force −C v with a matrix C that does not change, and its power v · C v.
    load
        True for a force from outside, which the load steps of `equilibrium` scale.
    stores_strain
        False for a term whose energy is not the energy of a strain: the error in space leaves it
        out.
    needs_path
        True where an equilibrium depends on the way there, as with friction.
    lags
        True where a part of the force over an `Increment` of the loads belongs to the positions
        `place` of that increment: it is solved again, with the solution as its place.
    load_steps
        The least number of load steps in which an equilibrium follows the way.
    needs_end
        Why only methods that solve for the forces at the end of a step may be used:
        `BackwardEuler` and `BDF2`. The others refuse the term with these words; "" for none.
    needs_difference
        True for a term that methods must refuse which have no difference for rates over the
        step.
    conserves
        True where −f · d is the change of the energy in a motion d, for the force f at its
        mean, as it is for energies quadratic in x; of what `over_step` gives, for its force at
        the mean. `EnergyMomentum` corrects the other forces
        (`fecloth.terms.discrete_gradient`).
    objective
        True where no rigid motion of the cloth changes the energy.
    steady_air
        (3,) the velocity [m/s] of the air where it is constant, of a drag in moving air.
    restitution
        Part of the speed that an impact leaves, of contact.
    """

    __slots__ = ()

    name: Any  # each may be an attribute, a field or a property
    symmetric: Any
    has_energy: Any
    dissipative: Any = False
    velocity_dependent: Any = False
    damps_linearly: Any = False
    load: Any = False
    stores_strain: Any = True
    needs_path: Any = False
    lags: Any = False
    load_steps: Any = 1
    restitution: Any = 0.0
    needs_end: Any = ""
    needs_difference: Any = False
    conserves: Any = False
    objective: Any = False
    steady_air: Any = None

    # --- force and tangent ------------------------------------------------------------------------

    def add_force(self, x: np.ndarray, v: np.ndarray, t: float, f: np.ndarray) -> None:
        """f += the force (n, 3) [N], in place."""
        raise NotImplementedError

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
        raise NotImplementedError

    def force_calls(self, x: np.ndarray, v: np.ndarray, t: float, f: np.ndarray) -> Calls | None:
        """The kernels that make up `add_force`, in order, each with its arguments.

        Explicit steps then need no Python between them. They are called again and again while
        x, v and f change in place, and may have work arrays of their own. None where the force
        depends on t or needs Python. The bits must be the same as by `add_force`. A
        `SharedCall`, as `SharedLoop` makes it, is for several threads; one of them makes all
        other calls. A class that overrides `add_force` must override this too; else it is not
        asked.
        """
        return None

    def coupling(
        self, x: np.ndarray, v: np.ndarray, t: float, wx: float, wv: float, definite: bool
    ) -> sparse.spmatrix | None:
        """(3n, 3n) part of wx K + wv D that `add_tangent` leaves out; None if nothing is coupled.

        It is for nodes outside the fixed pattern, as contact between triangles couples them. Its
        pattern may change from call to call. `definite` is as in `add_tangent`.
        """
        return None

    def dense(self, x: np.ndarray, t: float) -> tuple[float, np.ndarray] | None:
        """c [N/m] and u (n, 3) of a part c u uᵀ of K that `add_tangent` leaves out, as of a gas."""
        return None

    # --- energy, power and stress -----------------------------------------------------------------

    def energy(self, x: np.ndarray, t: float) -> float:
        """Potential energy [J]; its column of the ledger, and what Newton's line search lowers.

        As `power` and `supply` it is the sum over the nodes and elements that the term holds;
        ``System.sums.total`` makes it that over the whole cloth.
        """
        return 0.0

    def power(self, x: np.ndarray, v: np.ndarray, t: float) -> float:
        """Dissipated power [W], −f · v of the damping part; ≥ 0 for damping."""
        return 0.0

    def supply(self, x: np.ndarray, v: np.ndarray, t: float) -> float:
        """Power f · v [W] of a load without an energy: its work gets a column of the ledger.

        With an energy that `conserves`, the ledger adds what changes that energy with t alone.
        """
        return 0.0

    def work_of_clamps(self, old: At, new: At, stages: Sequence[At]) -> float:
        """Work [J] that moves the normals of clamps over a step from `old` to `new`."""
        return 0.0

    def add_stress(self, x: np.ndarray, out: np.ndarray) -> None:
        """out (triangles, 4) += S₁₁, S₂₂, S₁₂ [N/m] and energy per area [J/m²] of a membrane."""

    def cells(self, x: np.ndarray, t: float) -> dict[str, np.ndarray]:
        """Arrays (triangles, …) that frames show, by their names; asked of `with_history`."""
        return {}

    def strain_error(self, x: np.ndarray, t: float) -> np.ndarray:
        """(triangles,) energy [J] of the recovered strain minus the strain of the mesh.

        A system in which another term has an energy, and is no load, has no estimate of its
        error in space.
        """
        raise NotImplementedError

    def beyond(self, x: np.ndarray, t: float) -> float:
        """Area [m²] at rest of where a strain is beyond what was measured; a run warns of it."""
        return 0.0

    # --- over a step ------------------------------------------------------------------------------

    def over_step(self, step: StepDifference) -> "BoundTerm":
        """The term over this step, or the term itself where it does not depend on the step.

        `BackwardEuler`, `BDF2` and `EnergyMomentum` ask for it; the other methods call the
        term itself, unless it keeps a history. Where ``step.at_mean`` is False, x is the end
        of the step. An `energy` of what is returned is then its potential over the step,
        −∂energy/∂x its force, so that the step can minimise. Where it is True, x is the mean
        of both ends, and the force, where it `conserves`, does the work of the energy.
        """
        return self

    def dissipation(self, x: np.ndarray) -> float:
        """Energy [J] dissipated in the step that ends at x: the ledger's column of the term.

        It is asked of what `over_step` returned; without it the column is the `power`.
        """
        return 0.0

    def work(self, x: np.ndarray) -> float:
        """Work [J] on the cloth of a term that `supplies`, in the step that ends at x.

        It is asked of what `over_step` returned; without it the work is the mean `supply`.
        """
        return 0.0

    def allows(self, x: np.ndarray, t: float) -> bool:
        """Whether a contact has nothing inside or crossed at the positions x (n, 3)."""
        return True

    def leaps(self, old: Any, x: np.ndarray, t: float) -> bool:
        """Whether a point went through an obstacle by its straight way from the `State` old to x.

        Newton's iteration may find a way around it that no cloth takes in one step.
        """
        return False

    def way(self, t: float) -> Any:
        """What limits the first guess of the step that ends at t (`contact.guess.Way`), or None.

        It is asked of what `over_step` returned.
        """
        return None

    def start_history(self, x: np.ndarray, t: float) -> Any:
        """The record of a term with history at the start of a run; None for a term without.

        It is a frozen dataclass of arrays, marked with `remembered`, so that restart files
        have it. ``step.history`` of `over_step` is the record at the begin of the step;
        without one a step begins as the first one does. A term with history by itself, whose
        `energy` and force are asked before a run, acts as with the record of this function
        there.
        """
        return None

    def with_history(self, record: Any) -> "BoundTerm":
        """The term with its record, between two steps: its energy is what it stores then.

        Methods that need the force at the begin of a step, and the ledger, ask for it. The term
        itself is right where it then acts without the record, as friction of contact does.
        """
        return self

    def commit(self, x: np.ndarray, t: float) -> Any:
        """The record after the step that ends at x, asked of what `over_step` returned."""
        return None

    # --- contact ----------------------------------------------------------------------------------

    def limit(self, x: np.ndarray, s: np.ndarray, t: float) -> float:
        """The largest α in [0, 1] for which the term allows the way from x to x + α s.

        Both are (n, 3) [m]; the term allows x. The line searches of steps and of `equilibrium`
        ask for it. The energy of such a term is +∞, and its force is NaN, where the cloth may
        not be.
        """
        return 1.0

    def check_start(self, x: np.ndarray, t: float, where: str) -> None:
        """Raise `InputError` for positions (n, 3) that the term does not allow."""

    def least_distance(self, x: np.ndarray, t: float) -> float:
        """The least distance [m] of the cloth at x (n, 3) from what it must not enter.

        It is a column of what is observed, with the sum of the force as the reaction.
        """
        raise NotImplementedError

    def mean_distance(self, x: np.ndarray, t: float) -> float | None:
        """The mean distance [m] of what touches an obstacle, NaN if nothing does."""
        return None

    def push(self, x: np.ndarray, t: float) -> np.ndarray | None:
        """(n, 3) force of contact on the nodes without friction [N], to be drawn."""
        return None

    def slip(self, x: np.ndarray, v: np.ndarray, t: float) -> np.ndarray | None:
        """(n, 3) velocity [m/s] along an obstacle and relative to it, of nodes that touch."""
        return None

    def surface(
        self, t: float, place: np.ndarray, reach: float
    ) -> tuple[np.ndarray, np.ndarray] | None:
        """Points (p, 3) and triangles (q, 3); of an endless obstacle within `reach` of a place."""
        return None

    # --- where it is, and what it takes -----------------------------------------------------------

    def here(self) -> "BoundTerm":
        """The term as it is bound to the part of the cloth that this process has."""
        return self

    def nbytes(self, explicit: bool) -> int:
        """Bytes of the arrays of its own; for `explicit` methods without arrays of the tangent."""
        return 0

    # --- which of these it has of its own ---------------------------------------------------------

    supplies = overrides("supply")  # its work is a column of the ledger
    has_stress = overrides("add_stress")  # it is a membrane with a stress
    has_curves = overrides("beyond")  # it tells where a strain is beyond its curves
    recovers_strain = overrides("strain_error")  # it can estimate its error in space
    dissipates_over_step = overrides("dissipation")  # over a step, it says what it dissipated
    works_over_step = overrides("work")  # over a step, it says what work it did
    limits_direction = overrides("limit")
    couples_nodes = overrides("coupling")  # outside the fixed pattern
    keeps_distance = overrides("least_distance")  # it is contact that tells its distance


def has_own(term: BoundTerm, name: str) -> bool:
    """Whether a bound term has its own function in place of the function of `BoundTerm`."""
    own = getattr(term, name)
    return getattr(own, "__func__", own) is not vars(BoundTerm)[name]


def taken_from(path: str) -> Any:
    """The property or function ``self.<path>`` of an object within a bound term, as its own."""
    return property(attrgetter(path))


def element_nodes(term: Any, cloth: Cloth) -> np.ndarray:
    """The `stencil` of a term that couples the nodes of each element of the mesh."""
    return cloth.stencil


def uncoupled(term: Any, cloth: Cloth) -> None:
    """The `stencil` of a term that couples no nodes."""


def is_description(value: object) -> bool:
    """Whether a value, or a class, may be the description of a term."""
    return hasattr(value, "bind")


def stencil(term: Term, cloth: Cloth) -> np.ndarray | None:
    """The nodes (m, k) that a term couples, or None."""
    # Raises `InputError` for another shape, other numbers than whole ones, and unknown nodes.
    nodes = term.stencil(cloth)
    name = type(term).__name__
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
    """The bound term of a description, checked.

    Raises `InputError` if it does not derive from `BoundTerm`, or lacks an attribute or a
    function that a bound term must have.
    """
    call = f"{type(term).__name__}.bind(panel, slots)"
    made = check_derived(term.bind(panel, slots), call)
    wanted = list(ALWAYS)
    if getattr(made, "has_energy", False):
        wanted.append("energy")
    if made.dissipative:
        wanted.append("power")
    if missing := [name for name in wanted if _lacks(made, name)]:
        what = f"{call} gives {with_article(type(made).__name__)}"
        remedy = "help(fecloth.terms.protocol.BoundTerm) says what each is."
        raise InputError(what, f"must have {', '.join(missing)}", "System", remedy)
    return made


def check_derived(made: object, call: str) -> BoundTerm:
    """What a function of a term made, if its class derives from `BoundTerm`.

    `call` is the function with its arguments, for the `InputError` about any other object.
    """
    if isinstance(made, BoundTerm):
        return made
    kind = type(made)
    raise InputError(
        f"{call} gives {with_article(kind.__name__)}",
        "must be an object of a class that derives from fecloth.BoundTerm",
        "System",
        f"Write `class {_suggest_name(kind)}(fc.BoundTerm):`.",
    )


def _suggest_name(kind: type) -> str:
    """The name of a user's class, or another in place of the name of a class of Python itself."""
    return "MyBound" if kind.__module__ == "builtins" else kind.__name__


def _lacks(made: BoundTerm, name: str) -> bool:
    """Whether a bound term has no attribute of a name, or only the function of `BoundTerm`."""
    is_function = callable(vars(BoundTerm).get(name))
    return not hasattr(made, name) or (is_function and not has_own(made, name))
