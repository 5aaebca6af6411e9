"""Quantities observed at every step: probes, displacement, sag, area, reactions, contact."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
import scipy.sparse as sparse

from fecloth.compiled.jit import kernel
from fecloth.errors import InputError
from fecloth.linalg.reductions import weighted_sum
from fecloth.mesh.cloth import Cloth
from fecloth.mesh.peak import Peak
from fecloth.mesh.selection import Where
from fecloth.mesh.surface import Enclosure
from fecloth.quantities.arguments import checks_arguments
from fecloth.simulation.on_request import Measure, bind_measure
from fecloth.system.state import State
from fecloth.system.system import System
from fecloth.terms.kinematics import extreme_stretches
from fecloth.terms.loops.green_strain import gradient

# Columns of the shape, which a run has where they are asked for.
SHAPE_COLUMNS = frozenset({"volume", "least_stretch", "largest_stretch"})
# Names, and beginnings of names, of columns that a run may have anyway.
TAKEN = (
    "mean_displacement",
    "sag",
    "area",
    "volume",
    "least_stretch",
    "largest_stretch",
    "drape_coefficient",
    "folds",
)
PREFIXES = ("reaction:", "least_distance:", "line_force:", "distance of ", "stress.")


def reactions(system: System, old: State, step) -> dict[str, np.ndarray]:
    """Return the force (3,) [N] with which each pin group holds the cloth over a step.

    It is the sum of M Δv/dt − f over the nodes of the group, where f is the mean force over the
    step from `old`. A step that has its own acceleration `a` (BDF2) also has the force for which
    it solved: both are used, so that its reactions belong to the end of the step. Only
    constrained directions count: a slide has no reaction along its line or plane.
    """
    if not system.constraints.groups:
        return {}
    if step.a is None:
        acceleration = (step.state.v - old.v) / (step.state.t - old.t)
        force = step.mean_force(system)
    else:
        acceleration = step.a
        force = step.solved_force
    return _held_forces(system, system.mass_times(acceleration) - force)


def _held_forces(system: System, residual: np.ndarray) -> dict[str, np.ndarray]:
    """Return the sum (3,) of the residual (n, 3) that each pin group holds; changes `residual`.

    With the held directions H = I − P of a pin, and the sum of H over the pins of a node, the
    part of a pin is H (Σ H)⁺ times the residual: of a node that several pins hold alike each
    has an equal part, and a plane has what is across it.
    """
    constraints = system.constraints
    residual[constraints.nodes] = constraints.held_part(residual)
    directions = {name: np.eye(3) - pin.projector for name, (pin, _) in constraints.groups.items()}
    counts = np.zeros(len(residual), int)  # of pins, by node
    for _, nodes in constraints.groups.values():
        counts[nodes] += 1
    meet = np.flatnonzero(counts > 1)
    if len(meet):
        total = np.zeros((len(meet), 3, 3))
        for name, (_, nodes) in constraints.groups.items():
            total[np.isin(meet, nodes)] += directions[name]
        parts = np.linalg.pinv(total, rcond=1e-9, hermitian=True)
        residual[meet] = np.einsum("kij,kj->ki", parts, residual[meet])
    return {
        name: directions[name] @ residual[nodes].sum(axis=0)
        for name, (_, nodes) in constraints.groups.items()
    }


def contact_rows(system: System, acting: System | None, state: State) -> dict[str, float]:
    """Return the reaction [N] and the least distance [m] of each obstacle at a state.

    The reaction is the force with which the obstacle holds the cloth, friction included, as the
    reaction of a pin; the force on the obstacle is its opposite. It is taken from the `acting`
    system, whose terms are bound over a step (`Step.over`), and NaN without one.
    """
    row: dict[str, float] = {}
    terms = zip(system.names, system.bound, (acting or system).bound, strict=True)
    for name, term, acting_term in terms:
        if not term.keeps_distance:
            continue
        reaction = np.full(3, np.nan)
        if acting:
            force = np.zeros_like(state.x)
            acting_term.add_force(state.x, state.v, state.t, force)
            reaction = force.sum(axis=0)
        row |= _components(f"reaction:{name}", reaction)
        row[f"least_distance:{name}"] = term.least_distance(state.x, state.t)
    return row


@checks_arguments
@dataclass(frozen=True)
class Probe:
    """The path of a named node set (its mean), of nodes, or of a material point (X, Y).

    Parameters
    ----------
    name
        Column name.
    where
        A node set's name, node indices or a predicate: the mean position of these nodes.
    point
        Material coordinates (X, Y) [m]; give this or `where`.

    Raises
    ------
    InputError
        If both or none of `where` and `point` are given, or `where` has numbers that are no
        indices.
    """

    name: str
    where: Where | None = None
    point: tuple[float, float] | None = None

    def __post_init__(self):
        if (self.where is None) == (self.point is None):
            raise InputError(f"probe {self.name!r}", "needs either `where` or `point`", "Probe")
        indices = self.where if isinstance(self.where, tuple | list) else ()
        if any(isinstance(index, float) for index in indices):
            allowed = "must be a node set's name, node indices, or a predicate on X"
            remedy = f"A place is point = {self.where}."
            raise InputError(f"where = {self.where}", allowed, f"probe {self.name!r}", remedy)

    def weights(self, cloth: Cloth):
        """Return the (1, n) matrix from nodal positions to the probe's."""
        if self.where is None:
            return cloth.interpolator(np.array([self.point]))
        nodes = cloth.nodes(self.where)
        weights = np.full(len(nodes), 1.0 / len(nodes))
        rows = np.zeros(len(nodes), int)
        return sparse.csr_matrix((weights, (rows, nodes)), shape=(1, len(cloth.X)))


@dataclass(frozen=True, eq=False)
class Observer:
    """The quantities recorded at every step, bound to a system and its start.

    They are the places of the probes, the mean displacement, the sag, the area, the reactions of
    pins and obstacles, and the least distances from obstacles. The sag is the greatest fall of
    a point since the start, whatever shape the cloth starts in [m]; see `Peak`.

    Attributes
    ----------
    system, start
        What moves, and its state before the first step.
    probes
        Nodes and weights of each probe, by its name.
    peak
        Finds the largest value on the cloth.
    shape
        The closed surface of the cloth, if the largest and the least principal stretch and the
        enclosed volume are recorded too; else None.
    measures
        What computes the columns that were asked for by name, such as "folds", by this name:
        see `on_request`.
    """

    system: System
    start: State
    probes: Mapping[str, tuple[np.ndarray, np.ndarray]]
    peak: Peak
    shape: Enclosure | None = None
    measures: Mapping[str, Measure] = field(default_factory=dict)

    @classmethod
    def bind(cls, system: System, start: State, probes=(), shape: bool = False) -> "Observer":
        """Return the observer of probes, which are `Probe`s and names of columns on request.

        Raises `InputError` for what is neither, for two probes of one name, and for a name that
        a column of a run has.
        """
        cloth = system.cloth
        matrices = {probe.name: probe.weights(cloth) for probe in _distinct(probes)}
        weights = {name: (matrix.indices, matrix.data) for name, matrix in matrices.items()}
        requested = dict.fromkeys(name for name in probes if isinstance(name, str))
        measures = {name: bind_measure(name, system, matrices) for name in requested}
        enclosure = None
        if shape:
            enclosure = Enclosure.from_triangles(cloth.cells, len(cloth.X))
        return cls(system, start, weights, Peak.on(cloth), enclosure, measures)

    def of(self, system: System, start: State) -> Self:
        """Return the observer of the same columns for another system on the same cloth."""
        measures = self.measures
        if system is not self.system:  # they depend on the fabric, the pins and the terms
            measures = {name: bind_measure(name, system, self.probes) for name in measures}
        return replace(self, system=system, start=start, measures=measures)

    def row(self, old: State | None, step, system: System | None = None) -> dict[str, float]:
        """Return the columns after a step, with the reactions over it.

        `system` has taken the step; by default it is the system of the start. A pin that has let
        go has the reaction 0. Without a step they are the columns at the start, where reactions
        are NaN.
        """
        if old is None or step is None:
            return self._row(self.start, {}, None)
        system = system or self.system
        none = dict.fromkeys(self.system.constraints.groups, np.zeros(3))
        return self._row(step.state, none | reactions(system, old, step), step.over or system)

    def row_at_rest(self, state: State) -> dict[str, float]:
        """Return the row of a state that rests: its pins hold its forces."""
        forces = _held_forces(self.system, -self.system.force(state))
        return self._row(state, forces, self.system)

    def _row(self, state: State, forces: Mapping, acting: System | None) -> dict[str, float]:
        """Return the columns at a state; `forces` (3,) are the reactions of the pin groups."""
        mass = self.system.nodal_mass
        displacement = state.x - self.start.x
        row = {"t": state.t}
        for name, (nodes, weights) in self.probes.items():
            row |= _components(name, weighted_sum(weights, state.x[nodes], np.zeros(3)))
        row |= _components("mean_displacement", self.system.sums.mean(mass, displacement))
        row["sag"] = self.peak.largest(-displacement[:, 2])
        row["area"] = area(self.system.cloth, state.x)
        if self.shape:
            least, largest = extreme_stretches(self.system.cloth, state.x)
            row["volume"] = self.shape.volume(state.x)
            row["least_stretch"] = least
            row["largest_stretch"] = largest
        for name in self.system.constraints.groups:
            row |= _components(f"reaction:{name}", forces.get(name, np.full(3, np.nan)))
        row |= contact_rows(self.system, acting, state)
        row |= self.system.constraints.followers.gaps(state.x)
        for measure in self.measures.values():
            row |= measure(state.x, row)
        return row


def _distinct(probes) -> tuple[Probe, ...]:
    """Return the `Probe`s among the probes, or raise `InputError` for a name that is taken."""
    is_list = not isinstance(probes, Probe | str)
    if not (is_list and all(isinstance(probe, Probe | str) for probe in probes)):
        allowed = "must be a list of Probe(name, where)"
        raise InputError(f"probes = {probes!r}", allowed, "Observer")
    placed = [probe for probe in probes if isinstance(probe, Probe)]
    names = [probe.name for probe in placed]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"probe {name!r} appears twice", "needs a unique name", "Observer")
        if name in TAKEN or name.startswith(PREFIXES):
            allowed = "is the name of a column of every run"
            raise InputError(f"probe {name!r}", allowed, "Observer")
    return tuple(placed)


def area(cloth: Cloth, x: np.ndarray) -> float:
    """Return the deformed area Σ w √det(FᵀF) [m²], of P2 at the 6 points of the energy."""
    return _area(*cloth.shape, cloth.stencil, cloth.gradients, cloth.weights, x)


@kernel
def _area(K, Q, nodes, G, w, x):
    """Σ w |F₁ × F₂|."""
    total = 0.0
    for e in range(len(nodes)):
        for q in range(len(Q)):
            F11, F21, F31, F12, F22, F32 = gradient(K, nodes, G, e, q, x)
            n1 = F21 * F32 - F31 * F22
            n2 = F31 * F12 - F11 * F32
            n3 = F11 * F22 - F21 * F12
            total += w[e, q] * math.sqrt(n1 * n1 + n2 * n2 + n3 * n3)
    return total


def _components(name, vector):
    """Return the columns name.x, name.y and name.z of a vector (3,)."""
    return {f"{name}.{axis}": float(value) for axis, value in zip("xyz", vector, strict=True)}
