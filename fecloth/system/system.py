"""Cloth + fabric + terms + pins: the assembled operators, without any notion of a time step."""

import copy
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np
import scipy.sparse as sparse
from scipy.sparse.linalg import splu

from fecloth import validation
from fecloth.compiled.team import Team
from fecloth.errors import InputError, brief
from fecloth.fabric.fabric import Fabric
from fecloth.fabric.panel import Panel, WatchedPanel
from fecloth.linalg.block_matrix import (
    BlockMatrix,
    BlockPattern,
    MatrixLayout,
    add_mass,
    find_entries,
)
from fecloth.linalg.protocol import LinearSolver
from fecloth.linalg.reductions import NodeSums
from fecloth.mesh.cloth import Cloth
from fecloth.quantities.arguments import checks_arguments
from fecloth.quantities.sameness import same
from fecloth.system import reuse
from fecloth.system.clamps import find_clamps
from fecloth.system.constraints import Constraints, MatrixProjection
from fecloth.system.followers import NO_FOLLOWERS
from fecloth.system.pieces import Piece, movable_pieces
from fecloth.system.pins import Pin
from fecloth.system.reaction_limits import ReactionLimits
from fecloth.system.state import State, make_state
from fecloth.terms import protocol
from fecloth.terms.step_difference import StepDifference
from fecloth.terms.traits import traits_of

History = tuple[Any, ...]  # a record, or None, for each term


@dataclass(frozen=True, eq=False)
class Arguments:
    """The arguments of a `System` by their names, which explains them; `mass` is never None."""

    cloth: Cloth
    fabric: Fabric | Mapping[str, Fabric]
    terms: tuple
    pins: tuple[Pin | str, ...]
    mass: str
    grain: float | Mapping[str, float]
    start: State | None
    threads: int | str
    seams: tuple = ()


@checks_arguments
class System:
    """The force balance M a = f(x, v, t) of one cloth.

    A system does not change; `replace` makes another one, with other pins for example.

    Raises `InputError` for a `start` of another cloth, a clamped pin without a term that holds
    normals, a term that cannot be bound or does not know the cloth's element, or a pin that
    names no node.

    Parameters
    ----------
    cloth, fabric
        Reference mesh and constants; {"body": a, "hem": b} gives each named region its fabric.
    terms
        Descriptions such as ``StVK(), Gravity()``; nothing is added to them.
    pins
        `Pin` and `Slide` objects, or names of node sets to hold fixed.
    mass
        "lumped" or "consistent", see `Cloth.mass`; default: lumped for P1 and consistent for P2.
        Explicit methods need a lumped one, which costs P2 two of its four orders of frequencies.
    grain
        Angle of the warp from the X axis [rad], for all or by region.
    start
        State at which the run starts; clamped pins hold its normals, and a ``rest="start"``
        means its angles. Default: `rest`.
    threads
        Threads that share the loops of forces, tangents, solvers and explicit steps: a number,
        or "auto", the default, for all cores wherever they are faster than one. The results
        are the same to the last bit.
    seams
        `Seam` objects: edges that are sewn to others.

    Examples
    --------
    >>> import fecloth as fc
    >>> cloth = fc.Cloth.rectangle(1.0, 1.0, h=0.5, pattern="right")
    >>> fabric = fc.Fabric(areal_density=0.2, tensile_stiffness=1000.0)
    >>> system = fc.System(cloth, fabric, terms=[fc.StVK(), fc.Gravity()], pins=["left"])
    >>> system.force(system.rest()).shape, system.stiffness(system.rest()).shape
    ((9, 3), (27, 27))
    """

    # All sums over nodes go through it.
    sums: ClassVar[NodeSums] = NodeSums()
    # Whether this process has the matrix of the whole cloth.
    is_whole: ClassVar[bool] = True

    def __init__(
        self,
        cloth,
        fabric,
        terms,
        pins=(),
        mass=None,
        grain=0.0,
        start=None,
        *,
        threads="auto",
        seams=(),
    ):
        validation.instance(
            "cloth", cloth, Cloth, "Cloth.rectangle(1.0, 1.0, h=0.05), before the fabric", "System"
        )
        terms = _check_list(terms, "terms", "StVK()", protocol.is_description)
        pins = _check_list(pins, "pins", 'Pin("left")', lambda pin: isinstance(pin, Pin | str))
        seams = _check_list(seams, "seams", 'Seam("left", "right")', lambda s: hasattr(s, "sew"))
        for seam in seams[:1]:
            cloth, terms = seam.complete(seams, cloth, terms)
        mass = cloth.usual_mass if mass is None else mass
        _check_elements(terms, cloth.element)
        if start is not None and not (isinstance(start, State) and len(start.x) == len(cloth.X)):
            allowed = f"must be a State of {len(cloth.X)} nodes, or None"
            remedy = "Make it by system.state(x, v) of a system on this cloth."
            raise InputError(f"start = {brief(start)}", allowed, "System", remedy)
        self._arguments = Arguments(cloth, fabric, terms, pins, mass, grain, start, threads, seams)
        base = reuse.base.get()
        if base is not None:
            self._take_equal_parts(base)
        # here, so that an error is raised where the system is made
        _ = self.team, self.scalar_mass, self.layout, self.bound, self.constraints

    # --- what it was made of ------------------------------------------------------------------

    @property
    def cloth(self) -> Cloth:
        """The reference mesh."""
        return self._arguments.cloth

    @property
    def fabric(self) -> Fabric | Mapping[str, Fabric]:
        """The fabric, or the fabric of each named region."""
        return self._arguments.fabric

    @property
    def terms(self) -> tuple:
        """The terms as they were given; `bound` are these on the cloth."""
        return self._arguments.terms

    @property
    def pins(self) -> tuple[Pin | str, ...]:
        """The pins and slides as they were given; `constraints` are these on the cloth."""
        return self._arguments.pins

    @property
    def mass_kind(self) -> str:
        """The argument `mass`, "lumped" or "consistent"; the attribute `mass` is the matrix."""
        return self._arguments.mass

    @property
    def grain(self) -> float | Mapping[str, float]:
        """Angle of the warp from the X axis [rad], for all or by region."""
        return self._arguments.grain

    @property
    def start(self) -> State | None:
        """The state at which the run starts; None for `rest`."""
        return self._arguments.start

    @property
    def threads(self) -> int | str:
        """The number of threads that was asked for, or "auto"; `team` are the threads."""
        return self._arguments.threads

    @property
    def seams(self) -> tuple:
        """The seams as they were given."""
        return self._arguments.seams

    def replace(self, **changes: Any) -> Self:
        """A system with other arguments, as ``system.replace(pins=["left"])``.

        All other arguments stay. Raises what `System` raises.
        """
        return type(self)(**{**vars(self._arguments), **changes})

    @cached_property
    def releases(self) -> tuple[float, ...]:
        """The times at which pins let go, in order [s]."""
        times = {pin.until for pin in self.pins if isinstance(pin, Pin) and pin.until is not None}
        return tuple(sorted(times))

    def after(self, t: float) -> "System":
        """The system from the time t [s] on, without the pins that have let go by then.

        It is the system itself before the first of them, and the same object for all times
        between two. All that has not changed is shared; pins keep their names.
        """
        system: System = self
        while system.releases and system.releases[0] <= t:
            system = system._released
        return system

    @cached_property
    def _released(self) -> "System":
        """The system after the first of its `releases`."""
        left = [
            replace(Pin(pin) if isinstance(pin, str) else pin, name=name)
            for name, pin in zip(self.constraints.groups, self.pins, strict=True)
            if isinstance(pin, str) or pin.until != self.releases[0]
        ]
        with reuse.reusing(self):
            return self.replace(pins=left)

    def _take_equal_parts(self, base: "System") -> None:
        """Take from another system all that is the same to the last bit.

        This is the mesh, the pattern of the matrix, the mass and each bound term whose
        description is the same and whose inputs are. Nothing is taken if the mesh, its regions,
        the warp directions, the kind of mass, the threads, the number of the terms or their
        stencils differ.
        """
        given = self._arguments
        names = ("cloth", "mass", "grain", "threads", "seams")
        are_alike = all(
            same(getattr(given, name), getattr(base._arguments, name)) for name in names
        )
        have_as_many_terms = len(self.terms) == len(base.terms)
        if not (are_alike and have_as_many_terms and self.is_whole and base.is_whole):
            return
        self._arguments = replace(given, cloth=base.cloth)
        self.team = base.team
        panel = self.panel
        has_same_regions = same(panel.region, base.panel.region)
        if not (has_same_regions and same(self.layout.stencils, base.layout.stencils)):
            return
        self.layout = base.layout
        if same(panel.density, base.panel.density):
            self.scalar_mass = base.scalar_mass
            self.nodal_mass = base.nodal_mass
        self.bound = tuple(
            own_bound
            if same(term, own) and watched.gave_same(panel, _read_later(term))
            else protocol.bound(term, panel, self.layout.slots)
            for term, own, own_bound, watched in zip(
                self.terms, base.terms, base.bound, base.watched_panels, strict=True
            )
        )

    @cached_property
    def watched_panels(self) -> tuple[WatchedPanel, ...]:
        """For each term a panel that has noted what the term reads of it when it is bound."""
        panels = tuple(WatchedPanel.of(self.panel) for _ in self.terms)
        for term, panel in zip(self.terms, panels, strict=True):
            protocol.bound(term, panel, self.layout.slots)
        return panels

    # --- what is bound, once ------------------------------------------------------------------

    @cached_property
    def team(self) -> Team:
        """The threads that share the loops, of each system its own."""
        return Team(self.threads)

    @property
    def counted(self) -> Callable[[np.ndarray], np.ndarray] | None:
        """`Panel.counted`: None, as all elements of a whole cloth count."""
        return None

    @cached_property
    def panel(self) -> Panel:
        """The cloth cut from its fabrics, with all that the terms are bound to.

        Raises `InputError` for a clamped pin without a term that holds normals.
        """
        panel = Panel.cut(self.cloth, self.fabric, self.grain)
        start = self.rest() if self.start is None else self.start
        clamps = find_clamps(self.constraints, self.cloth, start)
        if clamps and not any(traits_of(term).holds_normals for term in self.terms):
            raise InputError(
                "a pin with clamp = true",
                "needs a bending term that holds normals",
                "System",
                "Add PlateBending, on a fabric with bending_rigidity, or pin without a clamp.",
            )
        return replace(
            panel,
            start=self.start.x if self.start else None,
            clamps=clamps,
            mass=self.mass_kind,
            team=self.team,
            counted=self.counted,
        )

    @cached_property
    def scalar_mass(self) -> sparse.csr_matrix:
        """(n, n) mass matrix of one component [kg]: Tᵀ M T, see `Followers`."""
        mass = self.cloth.mass(self.mass_kind, self.panel.density)
        return self.constraints.followers.gathered(mass)

    def mass_times(self, v: np.ndarray) -> np.ndarray:
        """M v, (n, 3); the lumped mass needs no sparse product."""
        if self.mass_kind == "lumped":
            return self.mass_rows * v
        return self.scalar_mass @ v

    @cached_property
    def mass_rows(self) -> np.ndarray:
        """(n, 3) the nodal mass of each component [kg]: a product of whole arrays is fast."""
        return np.repeat(self.nodal_mass[:, None], 3, axis=1)

    @cached_property
    def nodal_mass(self) -> np.ndarray:
        """(n,) row sums of the mass [kg]; zero at the corners of P2 if it is consistent.

        Nodes that follow others have none: it is with their leaders.
        """
        return self.constraints.followers.gathered(self.panel.nodal_mass)

    @cached_property
    def inverse_mass(self) -> np.ndarray:
        """(n,) 1/m [1/kg], and 0 for nodes that follow others."""
        m = self.nodal_mass
        return np.divide(1.0, m, out=np.zeros(len(m)), where=m != 0)

    @cached_property
    def total_mass(self) -> float:
        """Of the whole cloth [kg]."""
        return self.sums.total(float(self.nodal_mass.sum()))

    @cached_property
    def diagonal_mass(self) -> np.ndarray:
        """(n,) the lumped masses > 0 [kg], for norms and estimates with any mass.

        Nodes that follow others keep theirs, too.
        """
        mass = self.cloth.diagonal_mass(self.panel.density)
        total = self.constraints.followers.gathered(mass)
        return np.where(total > 0, total, mass)

    @cached_property
    def layout(self) -> MatrixLayout:
        """The terms' stencils, and where their blocks lie in the matrix."""
        stencils = [protocol.stencil(term, self.cloth) for term in self.terms]
        if self.mass_kind == "consistent":
            stencils.append(self.cloth.stencil)
        coupled = tuple(stencil for stencil in stencils if stencil is not None)
        return MatrixLayout(len(self.cloth.X), self.constraints.followers.stencils(coupled))

    @property
    def pattern(self) -> BlockPattern:
        """Union of the terms' stencils."""
        return self.layout.pattern

    @cached_property
    def bound(self) -> tuple:
        """The terms, bound to the cloth."""
        return tuple(protocol.bound(term, self.panel, self.layout.slots) for term in self.terms)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """A name for each term: its class's, numbered where it stands twice."""
        plain = [term.name for term in self.bound]
        seen: dict[str, int] = {}
        names = []
        for name in plain:
            seen[name] = seen.get(name, 0) + 1
            names.append(name if plain.count(name) == 1 else f"{name}.{seen[name]}")
        return tuple(names)

    @property
    def named(self) -> Iterator[tuple[str, Any]]:
        """The terms, bound to the cloth, each with its name."""
        return zip(self.names, self.bound, strict=True)

    @cached_property
    def constraints(self) -> Constraints:
        """The pins and slides on the cloth, and the nodes that follow others along seams."""
        constraints = Constraints.bind(self.pins, self.cloth)
        for seam in self.seams[:1]:
            constraints = seam.sew(self.seams, self.cloth, constraints)
        return constraints

    @cached_property
    def movable_pieces(self) -> tuple[Piece, ...]:
        """The connected pieces that can move as a whole: free, on moving pins, or sliding."""
        return movable_pieces(self.cloth, self.layout.stencils, self.constraints)

    @cached_property
    def reaction_limits(self) -> ReactionLimits:
        """For `force_size`."""
        return ReactionLimits.find(
            self.cloth,
            self.constraints,
            lambda: self.assemble(BlockMatrix.zeros(self.pattern), self.rest(), wx=1.0),
        )

    @cached_property
    def projection(self) -> MatrixProjection:
        """The projection of matrices onto the free directions."""
        return MatrixProjection.bind(self.constraints, self.pattern)

    @cached_property
    def mass_slots(self) -> np.ndarray:
        """The number of the block of each entry of `scalar_mass`."""
        return find_entries(self.scalar_mass, self.pattern.slots)

    def with_bound(self, bound: Iterable) -> Self:
        """A copy with other bound terms, such as terms over a step; all else is shared."""
        _ = self.reaction_limits  # which the copy shares
        other = copy.copy(self)
        other.bound = tuple(bound)  # in place of what the cached property would bind
        return other

    def loose(self) -> Self:
        """The system with forces where they act, also on nodes that follow others."""
        if not self.seams:
            return self
        other = copy.copy(self)
        other.constraints = replace(self.constraints, followers=NO_FOLLOWERS)
        return other

    def over_step(
        self, step: StepDifference, history: History | None = None, rates: bool = True
    ) -> Self:
        """Return the system over a step, with the terms as their `over_step` gives them.

        `history` are the records of the terms at the begin of the step. Without `rates`, as for
        a method that has no difference for rates over the step, all terms stay as they are but
        terms with a record, and over an increment of the loads also contact. The result is the
        system itself if no term depends on the step.
        """
        if history is None and not rates and not step.increment:
            return self
        records = history or (None,) * len(self.bound)
        bound = []
        for term, record in zip(self.bound, records, strict=True):
            is_contact = step.increment and term.limits_direction
            if rates or record is not None or is_contact:
                own_step = step if record is None else replace(step, history=record)
                term = term.over_step(own_step)
            bound.append(term)
        return self._with_changed(bound, "over_step(step)")

    # --- the history of terms -----------------------------------------------------------------

    def start_history(self, state: State) -> History | None:
        """Return the records that terms keep before the first step; None without any.

        There is one for each term, in their order, or None for a term without a record. A record
        that the state has is taken if it is of the class of the term's own new record.
        """
        records = tuple(term.start_history(state.x, state.t) for term in self.bound)
        # a state of another system may have records of other terms
        if state.history and len(state.history) == len(records):
            records = tuple(
                kept if type(kept) is type(new) else new
                for kept, new in zip(state.history, records, strict=True)
            )
        if all(record is None for record in records):
            return None
        return records

    def with_history(self, history: History | None) -> Self:
        """The system between two steps, whose terms act with their records.

        It is the system itself without a history, or if no term depends on its record there.
        """
        if history is None:
            return self
        changed = [
            term if record is None else term.with_history(record)
            for term, record in zip(self.bound, history, strict=True)
        ]
        return self._with_changed(changed, "with_history(record)")

    def with_exact_tangents(self) -> Self:
        """The system over a step, with the exact tangents of all terms."""
        return self.with_bound(term.with_exact_tangent() for term in self.bound)

    def commit(self, state: State, history: History | None) -> History | None:
        """Return the records at the end of a step, for its new `state`; None without a history.

        This is called on the system over that step. `history` are the records at its begin.
        Raises `InputError` for a term that had a record and gives none.
        """
        if history is None:
            return None
        records = tuple(
            None if before is None else term.commit(state.x, state.t)
            for term, before in zip(self.bound, history, strict=True)
        )
        for name, before, after in zip(self.names, history, records, strict=True):
            if before is not None and after is None:
                what = f"{name}.over_step(step).commit(x, t) = None"
                raise InputError(what, "must be the record of the term after the step", "System")
        return records

    def _with_changed(self, changed: Sequence[protocol.BoundTerm], call: str) -> Self:
        """A copy with these terms, or the system itself if they are its own.

        `call` is the function of the terms that gave them, for the `InputError` about another
        object than a bound term.
        """
        for old, new in zip(self.bound, changed, strict=True):
            protocol.check_derived(new, f"{old.name}.{call}")
        if all(new is old for new, old in zip(changed, self.bound, strict=True)):
            return self
        return self.with_bound(changed)

    # --- states -------------------------------------------------------------------------------

    def rest(self) -> State:
        """x = (X, 0), v = 0, t = 0."""
        X = self.cloth.X
        x = np.column_stack([X, np.zeros(len(X))])
        return State(0.0, x, np.zeros_like(x))

    def state(self, x, v=None, t: float = 0.0) -> State:
        """A state from positions (n, 3) [m] and velocities (n, 3) [m/s], zero by default."""
        return make_state(len(self.cloth.X), x, v, t)

    # --- operators ----------------------------------------------------------------------------

    def force(self, state: State) -> np.ndarray:
        """(n, 3) sum of all terms' forces [N]; the reactions of pins are not among them.

        The forces on nodes that follow others act on their leaders.
        """
        f = np.zeros_like(state.x)
        for term in self.bound:
            term.add_force(state.x, state.v, state.t, f)
        return self.constraints.followers.gather(f)

    def force_size(self, f: np.ndarray) -> float:
        """‖f‖ [N] with the reactions of the pins, without forces among what they hold."""
        return float(self.sums.norm(self.reaction_limits.apply(f)))

    def energies(self, state: State) -> dict[str, float]:
        """{"kinetic": J, term name: J, …} of the terms that have an energy."""
        kinetic = 0.5 * self.sums.dot(state.v, self.mass_times(state.v))
        potentials = {
            name: self.sums.total(term.energy(state.x, state.t))
            for name, term in self.named
            if term.has_energy
        }
        return {"kinetic": kinetic, **potentials}

    def assemble(
        self, J: BlockMatrix, state: State, wx=0.0, wv=0.0, wa=0.0, definite=False
    ) -> BlockMatrix:
        """J = wa M + wv D + wx K at a state, in place; `definite` makes each term's part so."""
        J.values.fill(0.0)
        return self.add_tangents(J, state, wx, wv, wa, definite)

    def add_tangents(
        self,
        J: BlockMatrix,
        state: State,
        wx=0.0,
        wv=0.0,
        wa=0.0,
        definite=False,
        kept: bool | None = None,
    ) -> BlockMatrix:
        """J += wa M + wv D + wx K at a state, in place.

        With `kept` it is the part of the terms that keep their tangent, or of all others.
        """
        if wa != 0.0:
            self.add_mass(J, wa)
        for term in self.bound:
            if kept is not None and term.keeps_tangent != kept:
                continue
            if wx != 0.0 or (wv != 0.0 and term.velocity_dependent):
                term.add_tangent(state.x, state.v, state.t, wx, wv, J, definite)
        return J

    def add_mass(self, J: BlockMatrix, weight: float) -> None:
        """J += weight M, in place.

        With a lumped mass J may have been projected before: the result is the projected sum.
        """
        add_mass(self.mass_slots, self.scalar_mass.data, weight, J.values)

    def dense(self, state: State) -> list[tuple[float, np.ndarray]]:
        """(c, u (n, 3)) of the parts c u uᵀ of K that couple all nodes, outside the matrix."""
        parts = [term.dense(state.x, state.t) for term in self.bound]
        return [part for part in parts if part is not None]

    def coupling(self, state: State, wx=0.0, wv=0.0, definite=False) -> sparse.spmatrix | None:
        """(3n, 3n) part of wv D + wx K outside the pattern; None without any."""
        coupled = [
            term.coupling(state.x, state.v, state.t, wx, wv, definite) for term in self.bound
        ]
        parts = [part for part in coupled if part is not None]
        if parts:
            return sum(parts[1:], start=parts[0])
        return None

    def couple(self, J: BlockMatrix, state: State, wx=0.0, wv=0.0, definite=False) -> BlockMatrix:
        """J plus the projected `coupling`; J itself if there is none. J was projected before."""
        part = self.coupling(state, wx, wv, definite)
        if part is None:
            return J
        return J.plus(self.constraints.project_matrix(part))

    def project(self, J: BlockMatrix) -> BlockMatrix:
        """P Tᵀ J T P + (I − P) s, in place: the block of a pinned node becomes a multiple of I."""
        self.projection.apply(J)
        return J

    def shared_solver(
        self, choice: str, symmetric: bool
    ) -> tuple[LinearSolver, BlockMatrix, str] | None:
        """The linear solver of a system that several processes share; None on one process."""
        return None

    def usage(self) -> dict[str, object]:
        """What summary.json says of the processes that share the system; nothing of one."""
        return {}

    def stiffness(self, state: State) -> sparse.csr_matrix:
        """K = −∂f/∂x over all nodes, (3n, 3n) [N/m], without what `dense` gives."""
        K = self.assemble(BlockMatrix.zeros(self.pattern), state, wx=1.0)
        part = self.coupling(state, wx=1.0)
        return (K if part is None else K.plus(part)).to_scipy().tocsr()

    def damping(self, state: State) -> sparse.csr_matrix:
        """D = −∂f/∂v over all nodes, (3n, 3n) [N s/m]."""
        return self.assemble(BlockMatrix.zeros(self.pattern), state, wv=1.0).to_scipy().tocsr()

    @cached_property
    def mass(self) -> sparse.csr_matrix:
        """M over all nodes, (3n, 3n) [kg]."""
        return sparse.kron(self.scalar_mass, sparse.identity(3), format="csr")

    @cached_property
    def free(self) -> np.ndarray:
        """The dofs 3 i + c that no pin holds; refused where a slide is along no axis."""
        return self.constraints.free(len(self.cloth.X))

    @cached_property
    def admissible(self) -> sparse.csc_matrix:
        """(3n, f) basis Z of the motions that pins, slides and seams allow.

        ZᵀKZ, ZᵀDZ and ZᵀMZ are the operators on the f degrees of freedom that are left. Without
        slides its columns are unit vectors, along `free`.
        """
        return self.constraints.admissible(len(self.cloth.X))

    @cached_property
    def free_mass(self) -> sparse.csc_matrix:
        """(f, f) ZᵀMZ [kg], with Z of `admissible`."""
        Z = self.admissible
        return (Z.T @ self.mass @ Z).tocsc()

    @cached_property
    def factor_of_mass(self) -> Any:
        """The factor of `free_mass`: its `solve` is b ↦ mass⁻¹ b. Copies over a step share it."""
        return splu(self.free_mass)

    @property
    def symmetric(self) -> bool:
        """Whether every term's tangent is symmetric."""
        return all(term.symmetric for term in self.bound)

    def __repr__(self) -> str:
        terms = ", ".join(self.names) or "no terms"
        held = len(self.constraints.nodes)
        return f"<System of {len(self.cloth.X)} nodes, {held} held: {terms}>"


def _read_later(term: Any) -> Collection[str]:
    """Return the attributes of its panel that a term may still read when it is bound.

    The terms of fecloth read nothing then of fabrics, start and clamps that they have not read
    while they were bound. Of the term of a user this is not known.
    """
    if type(term).__module__.startswith("fecloth."):
        return ()
    return WatchedPanel.WATCHED


def _check_elements(terms, element: str) -> None:
    """Raise `InputError` for a term that does not know the cloth's element, "P1" or "P2"."""
    for term in terms:
        known = traits_of(term).elements
        if element not in known:
            name = type(term).__name__
            what = f"{name} on element {element}"
            allowed = f"must be on {' or '.join(known)}"
            remedy = f"Leave {name} out, or make the cloth with element = {known[0]!r}."
            raise InputError(what, allowed, "System", remedy)


def _check_list(values, name: str, example: str, is_allowed: Callable[[object], bool]) -> tuple:
    """Return the values of an argument that is a list, as a tuple.

    Raises `InputError` if it is no list, or if a value is not allowed; a class in place of an
    object never is. `name` is the argument, in the plural, and `example` an allowed value.
    """
    where = f"System({name}=...)"
    allowed = f"must be a list, as in [{example}]"
    if isinstance(values, str) or not isinstance(values, Iterable):
        raise InputError(f"{name} = {values!r}", allowed, where)
    values = tuple(values)
    for value in values:
        if isinstance(value, type) or not is_allowed(value):
            allowed = f"must be such as {example}"
            if name == "terms":
                allowed += " with a method `bind`"
            raise InputError(f"{name[:-1]} {value!r}", allowed, where)
    return values
