"""Quantities observed at every step: probes, displacement, sag, area, reactions, contact."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sparse

from fecloth.compiled.jit import kernel
from fecloth.errors import InputError
from fecloth.linalg.reductions import weighted_sum
from fecloth.mesh.cloth import Cloth
from fecloth.mesh.selection import Where
from fecloth.mesh.surface import Enclosure
from fecloth.quantities.arguments import checks_arguments
from fecloth.simulation.on_request import Measure, bind_measure
from fecloth.system.state import State
from fecloth.system.system import System
from fecloth.terms.kinematics import extreme_stretches
from fecloth.terms.loops.green_strain import gradient

TAKEN = (
    "mean_displacement",
    *("sag", "area", "volume", "least_stretch", "largest_stretch", "drape_coefficient", "folds"),
)
PREFIXES = ("reaction:", "least_distance:", "line_force:", "distance of ")


def reactions(system: System, old: State, step) -> dict[str, np.ndarray]:
    """Pin group → force (3,) [N] with which it holds the cloth over a step, M Δv/dt − f summed.

    f is the mean force over the step. If the step has its own acceleration `a` and the force
    that it `solved` for, these are used: BDF2's reactions belong to the end of the step. Only
    constrained directions count: a slide has no reaction along its line or plane.
    """
    if not system.constraints.groups:
        return {}
    if step.a is None:
        a = (step.state.v - old.v) / (step.state.t - old.t)
        f = step.mean_force(system)
    else:
        a = step.a
        f = step.solved_force
    return _held_forces(system, system.mass_times(a) - f)


def _held_forces(system: System, residual: np.ndarray) -> dict[str, np.ndarray]:
    """Pin group → sum (3,) of its nodes' residual (n, 3) in the directions that it holds."""
    constraints = system.constraints
    residual[constraints.nodes] = constraints.held_part(residual)
    return {name: residual[nodes].sum(axis=0) for name, (_, nodes) in constraints.groups.items()}


def contact_rows(system: System, acting: System | None, state: State) -> dict[str, float]:
    """Reaction [N] and least distance [m] of each obstacle at a state.

    The reaction is the force with which the obstacle holds the cloth, friction included, as the
    reaction of a pin; the force on the obstacle is its opposite. It is NaN without an `acting`
    system.
    """
    row: dict[str, float] = {}
    terms = zip(system.names, system.bound, (acting or system).bound, strict=True)
    for name, term, over in terms:
        if term.keeps_distance:
            f = np.full_like(state.x, 0.0 if acting else np.nan)
            over.add_force(state.x, state.v, state.t, f)
            row |= _components(f"reaction:{name}", f.sum(axis=0))
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
    """

    name: str
    where: Where | None = None
    point: tuple[float, float] | None = None

    def __post_init__(self):
        if (self.where is None) == (self.point is None):
            raise InputError(f"probe {self.name!r}", "needs either `where` or `point`", "Probe")
        if isinstance(self.where, tuple | list) and any(isinstance(n, float) for n in self.where):
            allowed = "must be a node set's name, node indices, or a predicate on X"
            remedy = f"A place is point = {self.where}."
            raise InputError(f"where = {self.where}", allowed, f"probe {self.name!r}", remedy)

    def weights(self, cloth: Cloth):
        """Return the (1, n) matrix from nodal positions to the probe's."""
        if self.where is None:
            return cloth.interpolator(np.array([self.point]))
        nodes = cloth.nodes(self.where)
        entries = np.full(len(nodes), 1.0 / len(nodes)), (np.zeros(len(nodes), int), nodes)
        return sparse.csr_matrix(entries, shape=(1, len(cloth.X)))


@dataclass(frozen=True, eq=False)
class Observer:
    """The quantities recorded at every step, bound to a system and its start.

    `sag` is the greatest fall of a node since the start, whatever shape the cloth starts in [m].
    With `shape` these are also the largest and least principal stretch and the enclosed volume.
    Names among the probes, such as "folds", are columns on request: see `on_request`.
    """

    system: System
    start: State
    probes: Mapping[str, tuple[np.ndarray, np.ndarray]]  # nodes and weights of each
    shape: Enclosure | None = None
    measures: tuple[Measure, ...] = ()  # columns on request

    @classmethod
    def bind(cls, system: System, start: State, probes=(), shape: bool = False) -> "Observer":
        placed = _distinct(probes)
        cloth = system.cloth
        rows = {p.name: p.weights(cloth) for p in placed}
        names = dict.fromkeys(name for name in probes if isinstance(name, str))
        measures = tuple(bind_measure(name, system, rows) for name in names)
        weights = {name: (row.indices, row.data) for name, row in rows.items()}
        if shape:
            enclosure = Enclosure.from_triangles(cloth.cells, len(cloth.X))
        else:
            enclosure = None
        return cls(system, start, weights, enclosure, measures)

    def row(self, old: State | None, step) -> dict[str, float]:
        """Return probes, displacement, sag, area, reactions over the step (NaN at the start)."""
        if old is None or step is None:
            return self._row(self.start, {}, None)
        acting = step.over or self.system
        return self._row(step.state, reactions(self.system, old, step), acting)

    def row_at_rest(self, state: State) -> dict[str, float]:
        """Return the row of a state that rests: its pins hold its forces."""
        forces = _held_forces(self.system, -self.system.force(state))
        return self._row(state, forces, self.system)

    def _row(self, state: State, forces: Mapping, acting: System | None) -> dict[str, float]:
        mass = self.system.nodal_mass
        moved = state.x - self.start.x
        row = {"t": state.t}
        for name, (nodes, weights) in self.probes.items():
            row |= _components(name, weighted_sum(weights, state.x[nodes], np.zeros(3)))
        row |= _components("mean_displacement", self.system.sums.mean(mass, moved))
        row["sag"] = float(-moved[:, 2].min())
        row["area"] = area(self.system.cloth, state.x)
        if self.shape:
            stretches = extreme_stretches(self.system.cloth, state.x)
            row["volume"] = self.shape.volume(state.x)
            row["least_stretch"], row["largest_stretch"] = stretches
        for name in self.system.constraints.groups:
            row |= _components(f"reaction:{name}", forces.get(name, np.full(3, np.nan)))
        row |= contact_rows(self.system, acting, state)
        for measure in self.measures:
            row |= measure(state.x, row)
        return row


def _distinct(probes) -> tuple[Probe, ...]:
    single = isinstance(probes, Probe | str)
    if single or not all(isinstance(p, Probe | str) for p in probes):
        raise InputError(f"probes = {probes!r}", "must be a list of Probe(name, where)", "Observer")
    probes = [probe for probe in probes if isinstance(probe, Probe)]
    names = [probe.name for probe in probes]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"probe {name!r} appears twice", "needs a unique name", "Observer")
        if name in TAKEN or name.startswith(PREFIXES):
            raise InputError(f"probe {name!r}", "is the name of a column of every run", "Observer")
    return tuple(probes)


def area(cloth: Cloth, x: np.ndarray) -> float:
    """Return the deformed area Σ w √det(FᵀF) [m²]; P2 triangles use the 6 points of the energy."""
    return _area(*cloth.shape, cloth.stencil, cloth.gradients, cloth.weights, x)


@kernel
def _area(K, Q, nodes, G, w, x):
    """Σ w |F₁ × F₂|."""
    total = 0.0
    for e in range(len(nodes)):
        for q in range(len(Q)):
            F11, F21, F31, F12, F22, F32 = gradient(K, nodes, G, e, q, x)
            n1, n2, n3 = F21 * F32 - F31 * F22, F31 * F12 - F11 * F32, F11 * F22 - F21 * F12
            total += w[e, q] * math.sqrt(n1 * n1 + n2 * n2 + n3 * n3)
    return total


def _components(name, vector):
    return {f"{name}.{c}": float(value) for c, value in zip("xyz", vector, strict=True)}
