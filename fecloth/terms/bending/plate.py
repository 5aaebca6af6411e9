"""Bending as a plate: Morley's triangle, its edge slopes reconstructed from the hinge angles."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fecloth.compiled.calls import Calls, ValuedCall
from fecloth.errors import InputError
from fecloth.fabric.panel import Panel
from fecloth.linalg.block_matrix import FindSlots
from fecloth.mesh.cloth import Cloth
from fecloth.terms.bending import plate_loops
from fecloth.terms.bending.dihedral_angle import fold_measure
from fecloth.terms.bending.hinge import hinge_angles
from fecloth.terms.bending.plate_angles import PlateAngles, bind_angles
from fecloth.terms.bending.plate_stiffness import panel_curvatures
from fecloth.terms.loops.array_updates import clear, scale, subtract
from fecloth.terms.protocol import At, BoundTerm, taken_from
from fecloth.terms.strain_errors import plate_error
from fecloth.terms.traits import BENDING, BOTH


@dataclass(frozen=True)
class PlateBending:
    """A thin plate that converges on any mesh: ½ (μ − μ⁰)ᵀ Q (μ − μ⁰) of all hinge angles.

    In each triangle of area A the curvature is constant (Morley 1968),

        κ = Σ_i l_i/A α_i n_i n_iᵀ,      W = A/2 κ : D : κ,

    with the length l_i of edge i, its normal n_i in the plane, and the angle α_i from the
    triangle to the normal that belongs to the edge. On an edge between two triangles with the
    dihedral angle θ these are α = θ/2 ± φ, where φ is a sum of the angles θ around with
    constant weights that are exact for every constant curvature (`fecloth.mesh.edge_slopes`).
    So the energy is a quadratic form of the angles with a constant sparse matrix Q [N m], and
    there are no unknowns but the positions of the nodes. On a free edge the moment is zero; a
    clamped pin holds α.

    D is the fabric's: D₁₁ = B₁, D₂₂ = B₂, D₁₂ = ν_b √(B₁B₂), D₆₆ from its bias rigidity
    (`Fabric.plate`), along warp and weft of each triangle.

    The measure μ of an angle is θ itself up to a right angle. Beyond, μ = ±(π/2 + tan(|θ| −
    π/2)) grows without bound towards a full fold, where θ would jump.

    Source: Morley (1968), The triangular equilibrium element in the solution of plate bending
    problems; Grinspun, Gingold, Reisman and Zorin (2006), Computing discrete shape operators on
    general meshes, for the curvature; the weights of φ are our own. The page
    fecloth/terms/bending/README.md derives the element.

    Valid for any rotation and for small curvature times edge length. Errors fall with h². In
    bending, P1 membranes lock where Y h⁴κ²/B is large and no edges lie along the folds.

    Cost of a triangle relative to `HingeBending`: force 1.0 to 1.1, tangent 1.7 to 2.1; the
    matrix has about twice the entries (``python -m studies.evidence.benchmarks``).

    Parameters
    ----------
    rest
        The angles without moment: "flat"; "start", the angles of the positions
        ``System(start=...)`` (in scenes of the table [start]); one angle [rad]; or one for each
        hinge, in the order of `hinge_angles`.

    Raises
    ------
    InputError
        For an angle that is not between −π and π, or another number of angles than hinges.
    """

    rest: str | float | tuple[float, ...] = "flat"

    traits = replace(
        BENDING,
        elements=BOTH,
        reach=8,
        cheaper=("HingeBending", "QuadraticBending"),
        holds_normals=True,
    )

    def __post_init__(self) -> None:
        object.__setattr__(self, "rest", check_rest(self.rest, "PlateBending"))

    def stencil(self, cloth: Cloth) -> np.ndarray:
        """(p, 2) pairs of nodes whose positions the curvature of one triangle depends on."""
        return cloth.edge_slopes.pairs

    def bind(self, panel: Panel, slots: FindSlots) -> BoundTerm:
        plate = bind_angles(panel, slots, "PlateBending")
        rest = fold_measure(rest_angles(self.rest, panel))
        of_clamps = np.zeros(len(plate.held))
        if self.rest == "start" and panel.start is not None:
            at_start = replace(plate, moved=None)
            of_clamps = at_start.measures(panel.start, 0.0)[len(rest) :]
        return BoundPlate(plate, rest=np.append(rest, of_clamps), panel=panel)


def check_rest(rest, where: str):
    """Return the angles at rest of a plate as a text, a float or a tuple of floats.

    Raises `InputError`, for the term `where`, for what is not "flat", "start", an angle or a
    sequence of angles, and for an angle that is not between −π and π [rad].
    """
    if isinstance(rest, str):
        if rest in ("flat", "start"):
            return rest
        raise InputError(f"rest = {rest!r}", 'must be "flat", "start" or angles [rad]', where)
    angles = np.asarray(rest)
    if angles.ndim > 1 or angles.dtype.kind not in "iuf" or not (np.abs(angles) < np.pi).all():
        allowed = 'must be "flat", "start", one angle, or one for each hinge, between -π and π'
        raise InputError(f"rest = {rest!r}", allowed, where)
    if angles.ndim:
        return tuple(angles.tolist())
    return float(angles)


def rest_angles(rest, panel: Panel) -> np.ndarray:
    """(h,) rest angles of the hinges of a plate [rad], from what `check_rest` returns.

    Raises `InputError` for "start" without a start of the run, and for another number of angles
    than one or the number of hinges.
    """
    count = len(panel.cloth.edge_slopes.edges.hinges.nodes)
    if rest == "flat":
        return np.zeros(count)
    if rest == "start":
        if panel.start is None:
            what = 'rest = "start"'
            allowed = "needs the start of the run"
            remedy = "Write System(..., start=state)."
            raise InputError(what, allowed, "PlateBending", remedy)
        return hinge_angles(panel.cloth, panel.start)
    angles = np.atleast_1d(np.asarray(rest, dtype=float))
    if angles.size not in (1, count):
        allowed = f"must be one angle or {count}, one for each hinge"
        raise InputError(f"rest has {angles.size} angles", allowed, "PlateBending")
    return np.broadcast_to(angles, count).copy()


@dataclass(frozen=True, eq=False)
class BoundPlate(BoundTerm):
    """`PlateBending` on a cloth.

    Attributes
    ----------
    plate
        The hinge angles and the matrix Q.
    rest
        (h,) The measures μ⁰ at rest.
    panel
        The cloth with its fabrics.
    """

    plate: PlateAngles
    rest: np.ndarray
    panel: Panel

    name = "PlateBending"
    nbytes = taken_from("plate.nbytes")
    symmetric = has_energy = keeps_tangent = True

    @property
    def objective(self) -> bool:
        return not len(self.plate.held)  # the normals of clamps do not turn with the cloth

    def energy(self, x: np.ndarray, t: float) -> float:
        """½ (μ − μ⁰)ᵀ Q (μ − μ⁰) [J]."""
        return self.plate.energy(x, t, self.rest)

    def add_force(self, x, v, t, f) -> None:
        """f_a −= Σ m ∂μ/∂x_a with the moments m = Q (μ − μ⁰) [N]."""
        mu, g = self.plate.gradients(x, t)
        self.plate.add_force(mu - self.rest, g, f)

    def force_calls(self, x, v, t, f) -> Calls | None:
        """The calls of `add_force`; None where clamps move, whose normals depend on t."""
        plate = self.plate
        if plate.moved is not None:
            return None
        mu, g = plate.gradients(x, t)  # arrays that the first call fills anew each time
        return [
            plate.gradient_call(x, t, mu, g),
            (subtract, (self.rest, mu)),
            plate.force_call(mu, g, f),
        ]

    def add_tangent(self, x, v, t, wx, wv, J, definite) -> None:
        """J += wx (GᵀQG + Σ m ∂²μ/∂x∂x) with G = ∂μ/∂x.

        `definite` leaves out the second part.
        """
        mu, g = self.plate.gradients(x, t)
        self.plate.add_products(g, g, wx, J)
        if not definite:
            self.plate.add_curvatures(x, t, self.plate.stiffness @ (mu - self.rest), wx, J)

    def tangent_calls(self, x, v, t, wx, wv, J, definite) -> Calls | None:
        plate = self.plate
        if plate.moved is not None:
            return None
        mu, g = plate.gradients(x, t)  # arrays that the first call fills anew each time
        calls = [plate.gradient_call(x, t, mu, g), plate.products_call(g, g, wx, J)]
        if definite:
            return calls
        moment = np.empty_like(mu)
        return [
            *calls,
            (subtract, (self.rest, mu)),
            plate.moments_call(mu, moment),
            plate.curvatures_call(x, t, moment, wx, J),
        ]

    def energy_calls(self, x, t, sums) -> Calls | None:
        plate = self.plate
        if plate.moved is not None or plate.loop.counted is not None:
            return None
        mu = plate.measures(x, t)
        moment = np.empty_like(mu)
        energy = sums[:1]
        return [
            (clear, (mu,)),  # `measures_call` adds to it
            plate.measures_call(x, t, mu),
            (subtract, (self.rest, mu)),
            plate.moments_call(mu, moment),
            ValuedCall(plate_loops.sum_products, (mu, moment), energy),
            (scale, (0.5, energy)),
        ]

    def strain_error(self, x: np.ndarray, t: float) -> np.ndarray:
        """(m,) energy [J] of the change that recovery makes of the curvature, by triangle."""
        return plate_error(self.panel, *self.curvatures(x, t))

    def curvatures(self, x: np.ndarray, t: float) -> tuple[np.ndarray, np.ndarray]:
        """Change of κ (m, 3) [1/m] and D (m, 3, 3) [N m], see `panel_curvatures`."""
        change = self.plate.measures(x, t) - self.rest
        return panel_curvatures(self.panel, change, self.name)

    def work_of_clamps(self, old: At, new: At, stages: Sequence[At]) -> float:
        """Work [J] that moves the normals of clamps over a step."""
        Q = self.plate.stiffness
        rest = self.rest
        return self.plate.work_of_clamps(old, new, stages, lambda mu: Q @ (mu - rest))
