"""The two classes of a term: the description that a user writes, and the bound term.

A term is one contribution to the force f(x, v, t) of the cloth. The description (`Term`) is a
frozen object with the user's parameters. Its function `bind` makes the bound term (`BoundTerm`)
for one mesh. Neither depends on the time step, the solver or other terms.
studies/examples/term.py is a term in 30 lines.

`TermTraits` on the class of the description say what kind of term it is: fecloth knows nothing
else of it. A description without traits is a term of no kind.

`BoundTerm` has all abilities of a bound term, as functions that do nothing. The bound term of
your own term derives from it and writes the abilities that it needs.

Arrays: n is the number of nodes, x (n, 3) are positions [m], v (n, 3) velocities [m/s], and t
is the time [s]. A function must not change its arrays, except the array of its result.
"""

from collections.abc import Callable, Sequence
from operator import attrgetter
from typing import Any, Protocol

import numpy as np
import scipy.sparse as sparse

from fecloth.compiled.calls import Calls, Present
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

    It may have its `TermTraits` as the class attribute `traits`. Three traits may also be class
    attributes of their own: `elements`, `holds_normals`, and `no_space_error` for the trait
    `space_error`.
    """

    def stencil(self, cloth: Cloth) -> np.ndarray | None:
        """(m, k) integers: the nodes that each of m elements couples; None for no coupling."""

    def bind(self, panel: Panel, slots: Callable[[np.ndarray], np.ndarray]) -> "BoundTerm":
        """Make the bound term for a mesh.

        Raises `InputError` for parameters that do not fit the mesh.

        Parameters
        ----------
        panel
            The cloth with its fabrics: ``panel.cloth`` is the mesh, ``panel.density`` the mass
            per area, ``panel.gradients`` the gradients of the shape functions in warp and weft.
        slots
            ``slots(stencil)`` (m, k, k) is the number of the block of the matrix for each pair
            of nodes of a stencil, as an index into ``J.values``. Call it once, here or at the
            first tangent. The first call makes the pattern of the matrix. An explicit method
            needs no tangent: a term that calls it at the first tangent saves this work.
        """


def calls_of(term: "BoundTerm", function: str, calls: str) -> Callable[..., Calls | None] | None:
    """The function `calls` of a term if its calls make up its own `function`, else None.

    A class that overrides `function` alone has inherited the calls of another one. Therefore
    the class that defines `calls` must be the class that defines `function`, or derive from it.
    """
    classes = type(term).__mro__
    of_function = next(kind for kind in classes if function in vars(kind))
    of_calls = next(kind for kind in classes if calls in vars(kind))
    if not issubclass(of_calls, of_function):
        return None
    its_calls: Callable[..., Calls | None] = getattr(term, calls)
    return its_calls


def overrides(name: str) -> Any:
    """A property that says whether a bound term has its own function of that name."""
    return property(lambda term: has_own(term, name))


class BoundTerm:
    """A term for one mesh; it must not change after it was made.

    A term must have `name`, `symmetric`, `has_energy`, `add_force` and `add_tangent`. With
    `has_energy` it must have `energy`, and with `dissipative` it must have `power`. All other
    abilities are optional: the functions of this class do nothing.

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
        False for a term whose energy is not the energy of a strain. The estimate of the error in
        space leaves such a term out.
    needs_path
        True where an equilibrium depends on the way to it, as with friction.
    lags
        True where a part of the force over an `Increment` of the loads depends on the positions
        `place` of that increment. The increment is then solved again, with its solution as the
        new `place`.
    load_steps
        The least number of load steps for an equilibrium that depends on the way to it.
    needs_end
        Why only `BackwardEuler` and `BDF2` may be used, which solve for the forces at the end
        of a step. Other methods refuse the term with these words; "" where all may be used.
    needs_difference
        True for a term that only methods with a difference for rates over the step can use.
    conserves
        True where −f · d is the change of the energy in a motion d. f is the force at the mean
        of both ends: the force of the term, as for an energy quadratic in x, or of the result
        of its `over_step`. `EnergyMomentum` corrects all other forces
        (`fecloth.terms.discrete_gradient`).
    objective
        True where no rigid motion of the cloth changes the energy.
    steady_air
        Velocity (3,) [m/s] of the air, of a drag in air that moves with one constant velocity.
    keeps_tangent
        True where several Newton iterations of a step may share the tangent, because it is
        expensive and changes little within a step.
    """

    __slots__ = ()

    # Each of these may be an attribute, a field or a property.

    name: Any
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
    needs_end: Any = ""
    needs_difference: Any = False
    conserves: Any = False
    objective: Any = False
    steady_air: Any = None
    keeps_tangent: Any = False

    # --- force and tangent --------------------------------------------------------------------

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

        Add to ``J.values`` (blocks, 3, 3) at the slots that `bind` got. With `definite` the sum
        that is added must be symmetric and positive semi-definite: Newton's method asks for it
        where the exact tangent fails.
        """
        raise NotImplementedError

    def force_calls(
        self, x: np.ndarray, v: np.ndarray, t: np.ndarray, f: np.ndarray
    ) -> Calls | None:
        """The kernels that make up `add_force`, in order, each with its arguments.

        Explicit steps then need no Python between the kernels. The kernels are called again and
        again while x, v, the time t (1,) [s] and f change in place, and may have work arrays of
        their own. Return None where the force needs Python. The result must have the same bits
        as `add_force`; where that refuses a value that is not finite, they let it reach f. A
        `SharedCall`, as `SharedLoop` makes it, is made by several threads; one thread makes all
        other calls. A class that overrides `add_force` must override this function, too;
        otherwise it is not called.
        """
        return None

    def supply_calls(
        self, x: np.ndarray, v: np.ndarray, t: np.ndarray, power: np.ndarray
    ) -> Calls | None:
        """The kernels that write `supply` to `power` (1,) [W], as `force_calls`; or None.

        Only a term that dissipates in air without one steady velocity needs them.
        """
        return None

    def tangent_calls(
        self,
        x: np.ndarray,
        v: np.ndarray,
        t: np.ndarray,
        wx: Present,
        wv: Present,
        J: BlockMatrix,
        definite: bool,
    ) -> Calls | None:
        """The kernels that make up `add_tangent`, as `force_calls` has those of `add_force`.

        The weights and the time `t` (1,) change from call to call.
        """
        return None

    def energy_calls(self, x: np.ndarray, t: np.ndarray, sums: np.ndarray) -> Calls | None:
        """The kernels that write parts of `energy` to `sums`, as `force_calls`.

        The energy is the sum of `sums` (`shared_loop.SUM_BLOCKS`,), which hold zeros before.
        """
        return None

    @property
    def step_arrays(self) -> tuple[np.ndarray, ...]:
        """The arrays in which a term over a step differs from the term over another step.

        The calls of a term over one step serve every step, once they are filled with the arrays
        of the term over that step. The term is a dataclass: a copy by ``dataclasses.replace``
        has arrays of its own.
        """
        return ()

    def coupling(
        self, x: np.ndarray, v: np.ndarray, t: float, wx: float, wv: float, definite: bool
    ) -> sparse.spmatrix | None:
        """(3n, 3n) the part of wx K + wv D that `add_tangent` leaves out; None for no part.

        It couples nodes outside the fixed pattern, as contact between triangles does. Its
        pattern may change from call to call. `definite` is as in `add_tangent`.
        """
        return None

    def dense(self, x: np.ndarray, t: float) -> tuple[float, np.ndarray] | None:
        """c [N/m] and u (n, 3) of the part c u uᵀ of K that `add_tangent` leaves out, or None.

        The K of a gas has such a part, which couples all nodes.
        """
        return None

    # --- energy, power and stress -------------------------------------------------------------

    def energy(self, x: np.ndarray, t: float) -> float:
        """Potential energy [J]: a column of the energy ledger, which line searches lower.

        Like `power` and `supply` it is the sum over the nodes and elements that the term holds.
        ``System.sums.total`` makes the sum over the whole cloth from it.
        """
        return 0.0

    def power(self, x: np.ndarray, v: np.ndarray, t: float) -> float:
        """Dissipated power [W], −f · v of the damping part; ≥ 0 for damping."""
        return 0.0

    def supply(self, x: np.ndarray, v: np.ndarray, t: float) -> float:
        """Power f · v [W] of a load without an energy: its work gets a column of the ledger.

        For a term that `conserves`, the ledger adds the change of the energy with t alone.
        """
        return 0.0

    def work_of_clamps(self, old: At, new: At, stages: Sequence[At]) -> float:
        """Work [J] that moves the normals of clamps over a step from `old` to `new`."""
        return 0.0

    def add_stress(self, x: np.ndarray, out: np.ndarray) -> None:
        """out (triangles, 4) += S₁₁, S₂₂, S₁₂ [N/m] and energy per area [J/m²] of a membrane."""

    def stress_of(self, F: np.ndarray, triangles: np.ndarray) -> np.ndarray:
        """S₁₁, S₂₂, S₁₂ (r, 3) [N/m] of a membrane for F (r, 3, 2) along warp and weft.

        The constants are those of the `triangles` (r,).
        """
        raise NotImplementedError

    def cells(self, x: np.ndarray, t: float) -> dict[str, np.ndarray]:
        """Arrays (triangles, …) for frames, by their names.

        It is asked of the result of `with_history`.
        """
        return {}

    def strain_error(self, x: np.ndarray, t: float) -> np.ndarray:
        """(triangles,) energy [J] of the recovered strain minus the strain of the mesh.

        If a term with an energy has no such function and is no load, the system has no estimate
        of its error in space.
        """
        raise NotImplementedError

    def beyond(self, x: np.ndarray, t: float) -> float:
        """Area [m²] at rest where a strain is beyond the measured curve; a run warns of it."""
        return 0.0

    # --- over a step --------------------------------------------------------------------------

    def over_step(self, step: StepDifference) -> "BoundTerm":
        """The term over this step, or the term itself where it does not depend on the step.

        `BackwardEuler`, `BDF2` and `EnergyMomentum` ask for it. Other methods use the term
        itself, unless it keeps a history.

        With ``step.at_mean`` = False, x is the end of the step. The `energy` of the result is
        then the potential of its force over the step, −∂energy/∂x, so that the step can
        minimise. With ``step.at_mean`` = True, x is the mean of both ends. The force of a result
        that `conserves` then does the work of the energy.
        """
        return self

    def dissipation(self, x: np.ndarray) -> float:
        """Energy [J] dissipated in the step that ends at x: the ledger's column of the term.

        It is asked of the result of `over_step`; without it the column comes from the `power`.
        """
        return 0.0

    def work(self, x: np.ndarray) -> float:
        """Work [J] on the cloth of a term that `supplies`, in the step that ends at x.

        It is asked of the result of `over_step`; without it the work is the mean `supply`.
        """
        return 0.0

    def allows(self, x: np.ndarray, t: float) -> bool:
        """Whether nothing is inside an obstacle, or crossed, at the positions x (n, 3)."""
        return True

    def leaps(self, old: Any, x: np.ndarray, t: float) -> bool:
        """Whether a point passes through an obstacle on its straight way from `old` to x.

        `old` is the `State` at the begin of the step, x (n, 3) are the positions at its end.
        Newton's iteration may find a way around it that no cloth takes in one step.
        """
        return False

    def way(self, t: float) -> Any:
        """The `contact.guess.Way` that limits the first guess of the step to t, or None.

        It is asked of the result of `over_step`.
        """
        return None

    def start_history(self, x: np.ndarray, t: float) -> Any:
        """The record of a term with history at the start of a run; None for a term without.

        The record is a frozen dataclass of arrays, marked with `remembered`, so that restart
        files have it. In `over_step`, ``step.history`` is the record at the begin of the step;
        without one the step begins as the first step does. The energy and the force of the term
        itself are asked before a run: there it acts as with the record of this function.
        """
        return None

    def with_history(self, record: Any) -> "BoundTerm":
        """The term with its record, between two steps: its energy is the energy stored there.

        The ledger asks for it, and methods that need the force at the begin of a step.
        """
        return self

    def commit(self, x: np.ndarray, t: float) -> Any:
        """The record after the step that ends at x; asked of the result of `over_step`."""
        return None

    # --- contact ------------------------------------------------------------------------------

    def limit(self, x: np.ndarray, s: np.ndarray, t: float) -> float:
        """The largest α in [0, 1] for which the term allows the way from x to x + α s.

        x and s are (n, 3) [m]; the term allows x. The line searches of steps and of
        `equilibrium` ask for it. At positions that such a term does not allow, its energy is +∞
        and its force is NaN.
        """
        return 1.0

    def check_start(self, x: np.ndarray, t: float, where: str) -> None:
        """Raise `InputError` for positions (n, 3) that the term does not allow."""

    def touches(self, old: Any, new: Any, h: float) -> Any:
        """The `contact.touches.Touches` at the end of a step from the `State` old to new, or None.

        Its force at the end has changed the momentum by h [s] times itself.

        It is asked of the result of `over_step`: impulses then decide how fast they open.
        """
        return None

    def with_exact_tangent(self) -> "BoundTerm":
        """The term over a step with its exact tangent, if it has another one."""
        return self

    def least_distance(self, x: np.ndarray, t: float) -> float:
        """The least distance [m] of the cloth at x (n, 3) from an obstacle.

        It is a column of ``observed.csv``, beside the sum of the force, the reaction.
        """
        raise NotImplementedError

    def mean_distance(self, x: np.ndarray, t: float) -> float | None:
        """The mean distance [m] of the points that touch an obstacle; NaN without any."""
        return None

    def push(self, x: np.ndarray, t: float) -> np.ndarray | None:
        """(n, 3) force of contact on the nodes, without friction [N], for pictures."""
        return None

    def slip(self, x: np.ndarray, v: np.ndarray, t: float) -> np.ndarray | None:
        """(n, 3) velocity [m/s] of the nodes that touch, along and relative to an obstacle."""
        return None

    def surface(
        self, t: float, place: np.ndarray, reach: float
    ) -> tuple[np.ndarray, np.ndarray] | None:
        """Points (p, 3) and triangles (q, 3) of the obstacle at t, for pictures; None without.

        Of an endless obstacle they are the part within `reach` [m] of `place` (3,) [m].
        """
        return None

    # --- processes and memory -----------------------------------------------------------------

    def here(self) -> "BoundTerm":
        """The term as it is bound to the part of the cloth that this process has."""
        return self

    def nbytes(self, explicit: bool) -> int:
        """Bytes of its own arrays; for an `explicit` method without those of the tangent."""
        return 0

    # --- which optional functions it has ------------------------------------------------------

    supplies = overrides("supply")  # its work is a column of the ledger
    has_stress = overrides("add_stress")  # it is a membrane with a stress
    gives_stress = overrides("stress_of")  # it knows the stress of a deformation gradient
    has_curves = overrides("beyond")  # it knows where a strain is beyond its curves
    recovers_strain = overrides("strain_error")  # it can estimate its error in space
    dissipates_over_step = overrides("dissipation")  # over a step, it says what it dissipated
    works_over_step = overrides("work")  # over a step, it says what work it did
    limits_direction = overrides("limit")
    couples_nodes = overrides("coupling")  # outside the fixed pattern
    keeps_distance = overrides("least_distance")  # it is contact that knows its distance


def has_own(term: BoundTerm, name: str) -> bool:
    """Whether a bound term has its own function in place of the function of `BoundTerm`."""
    own = getattr(term, name)
    return getattr(own, "__func__", own) is not vars(BoundTerm)[name]


def taken_from(path: str) -> Any:
    """A property with the value of ``self.<path>``, an attribute of a part of a bound term."""
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
    """Return the nodes (m, k) that a term couples, or None; they are checked.

    Raises `InputError` for anything but an array (m, k) of whole numbers, and for nodes that the
    cloth does not have.
    """
    nodes = term.stencil(cloth)
    name = type(term).__name__
    if nodes is None:
        return None
    is_table_of_nodes = (
        isinstance(nodes, np.ndarray) and nodes.ndim == 2 and nodes.dtype.kind in "iu"
    )
    if not is_table_of_nodes:
        what = f"stencil(cloth) = {brief(nodes)}"
        if isinstance(nodes, np.ndarray):
            what = f"stencil(cloth) of shape {nodes.shape} and type {nodes.dtype}"
        raise InputError(what, "must be an array (m, k) of nodes, or None", name)
    if nodes.size and not 0 <= nodes.min() <= nodes.max() < len(cloth.X):
        what = f"stencil(cloth) with the nodes {nodes.min()} … {nodes.max()}"
        raise InputError(what, f"must lie in 0 … {len(cloth.X) - 1}", name)
    return nodes


def bound(term: Term, panel: Panel, slots: Callable) -> BoundTerm:
    """Bind a term, check the bound term, and return it.

    Raises `InputError` if it does not derive from `BoundTerm`, or lacks an attribute or a
    function that it must have: those in `ALWAYS`, `energy` if it `has_energy`, and `power` if it
    is `dissipative`.
    """
    call = f"{type(term).__name__}.bind(panel, slots)"
    bound_term = check_derived(term.bind(panel, slots), call)
    required_names = list(ALWAYS)
    if getattr(bound_term, "has_energy", False):
        required_names.append("energy")
    if bound_term.dissipative:
        required_names.append("power")
    missing_names = [name for name in required_names if _lacks(bound_term, name)]
    if missing_names:
        what = f"{call} gives {with_article(type(bound_term).__name__)}"
        remedy = "help(fecloth.BoundTerm) says what each is."
        raise InputError(what, f"must have {', '.join(missing_names)}", "System", remedy)
    return bound_term


def check_derived(result: object, call: str) -> BoundTerm:
    """Return the result of a function of a term, if its class derives from `BoundTerm`.

    Raises `InputError` for any other object; `call` names the function with its arguments, such
    as "Gravity.bind(panel, slots)".
    """
    if isinstance(result, BoundTerm):
        return result
    result_class = type(result)
    raise InputError(
        f"{call} gives {with_article(result_class.__name__)}",
        "must be an object of a class that derives from fecloth.BoundTerm",
        "System",
        f"Write `class {_suggest_name(result_class)}(fc.BoundTerm):`.",
    )


def _suggest_name(result_class: type) -> str:
    """Return the name of the class for the line of code that a user must write."""
    # A number, None, …: there is no class of the user yet.
    if result_class.__module__ == "builtins":
        return "MyBound"
    return result_class.__name__


def _lacks(bound_term: BoundTerm, name: str) -> bool:
    """Whether a bound term has no attribute of a name, or only the function of `BoundTerm`."""
    is_function = callable(vars(BoundTerm).get(name))
    return not hasattr(bound_term, name) or (is_function and not has_own(bound_term, name))
