"""Friction between the threads of a fabric that bends, on the curvature of a plate."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sparse

from fecloth import validation
from fecloth.compiled.calls import Call
from fecloth.fabric.panel import Panel
from fecloth.linalg.block_matrix import FindSlots
from fecloth.mesh.cloth import Cloth
from fecloth.mesh.edge_slopes import turn_curvature
from fecloth.terms.bending import plate_loops
from fecloth.terms.bending.plate_angles import PlateAngles, bind_angles, pointers
from fecloth.terms.bending.plate_stiffness import block_diagonal, of_parts, panel_plate
from fecloth.terms.loops.shared_loop import SharedLoop
from fecloth.terms.protocol import At, BoundTerm
from fecloth.terms.records import remembered
from fecloth.terms.sliders import Sliders
from fecloth.terms.step_difference import StepDifference
from fecloth.terms.traits import BOTH, DAMPING

NAME = "BendingFriction"
LOAD_STEPS = 20
"""Least number of load steps of an equilibrium: κ_s follows the path only from step to step."""


@dataclass(frozen=True)
class BendingFriction:
    """Dry friction inside a fabric: bent and let go, it stays a little bent.

    Beside the elastic moment of a bending term acts the moment of a slider, at most HB, half
    of the fabric's `bending_hysteresis` 2HB, which is the height of the loop that bending
    instruments draw. With the curvature κ of `PlateBending`'s triangles along warp and weft,
    the slid curvature κ_s that each triangle remembers, e = κ − κ_s, and

        z = (M₁ e₁₁, M₂ e₂₂, √(2 M₁M₂) e₁₂),   s = ‖z‖,   s_y = M₁M₂/(m √(B₁B₂)),   M = HB

    the energy per area over a step is s²/(2 s_y) where s ≤ s_y, else s − s_y/2 [J/m²]. At the
    end of the step κ_s moves towards κ until s = s_y, and s − s_y per area is heat: the column
    ``dissipated:BendingFriction``. `fecloth.terms.sliders` has the law, and the page
    fecloth/terms/bending/FRICTION.md says when it matters.

    At the start κ_s = κ, so that there is no moment. Only a run that starts from an
    `Equilibrium` begins with the κ_s of that equilibrium. The place of rest depends on the way
    there, not on the time it takes. An equilibrium takes at least 20 load steps, in which κ_s
    follows.

    Source: Grosberg (1966), The mechanical properties of woven fabrics, part II: the bending
    of woven fabrics, Textile Research Journal 36, for a moment of friction beside the elastic
    moment; Iwan (1966), A Distributed-Element Model for Hysteresis and Its Steady-State
    Dynamic Response, Journal of Applied Mechanics 33, for the elastic and plastic element. The
    law of two directions is our own.

    Valid for a hysteresis that does not depend on the curvature. The moment does not depend on
    the axes where M₁ = M₂.

    Cost of a triangle relative to `PlateBending`: force 1.4, tangent 1.4. Its stiffness m
    counts in the limit of explicit steps.

    Parameters
    ----------
    stiffness
        m > 0 [-]: before it slips, the slider is m times as stiff as the fabric. It slips at
        the curvature HB/(m B).

    Raises
    ------
    InputError
        For a stiffness that is not > 0; when the term is bound, for a fabric without
        `bending_rigidity` or `bending_hysteresis`, or with 0 in one direction only. With 0 for
        both the term does nothing.
    """

    stiffness: float = 20.0

    traits = replace(DAMPING, elements=BOTH, reach=8)

    def __post_init__(self) -> None:
        validation.positive("stiffness", self.stiffness, "", NAME)

    def stencil(self, cloth: Cloth) -> np.ndarray:
        """(p, 2) pairs of nodes whose positions the curvature of one triangle depends on."""
        return cloth.edge_slopes.pairs

    def bind(self, panel: Panel, slots: FindSlots) -> BoundTerm:
        """Return the term on a panel; raise `InputError` for a fabric that lacks a constant."""
        of_fabrics = [Sliders.of_fabric(fabric, self.stiffness) for fabric in panel.fabrics]
        moments = np.concatenate([sliders.moments for sliders in of_fabrics])[panel.region]
        limit = np.concatenate([sliders.limit for sliders in of_fabrics])[panel.region]
        sliders = Sliders(of_parts(panel, moments), of_parts(panel, limit))
        along_axes, _ = panel_plate(panel, NAME)  # R for curvatures along X and Y
        turn = block_diagonal(turn_curvature(of_parts(panel, panel.grain)))  # to warp and weft
        curvature = Curvature.make((turn @ along_axes).tocsr())
        # Rᵀ H R has other entries than Q: one for each two hinges of a triangle. `coupled` gives
        # their places; their values are computed at each tangent.
        plate = replace(bind_angles(panel, slots, NAME), stiffness=curvature.coupled())
        edges = panel.cloth.edge_slopes.edges
        loop = SharedLoop.over_elements(panel, edges.triangles)
        return BoundFriction(plate, curvature, sliders, edges.area, loop)


@remembered
@dataclass(frozen=True, eq=False)
class SlidCurvature:
    """How far the sliders of `BendingFriction` have slid.

    Attributes
    ----------
    curvature
        (m, p, 3) κ_s as (κ₁₁, κ₂₂, 2κ₁₂) along warp and weft [1/m]. p is 1, and on P2 4, for
        the parts of a triangle.
    """

    curvature: np.ndarray


@dataclass(frozen=True, eq=False)
class Curvature:
    """κ = R μ: the curvatures of m triangles along warp and weft, from the hinges' angles.

    Attributes
    ----------
    matrix
        (3m, h) R [1/m].
    transposed
        (h, 3m) Rᵀ.
    by_triangle
        R in blocks (3, 1).
    by_hinge
        Rᵀ in blocks (1, 3).
    """

    matrix: sparse.csr_matrix
    transposed: sparse.csr_matrix
    by_triangle: sparse.bsr_matrix
    by_hinge: sparse.bsr_matrix

    @classmethod
    def make(cls, R: sparse.csr_matrix) -> "Curvature":
        """The curvatures with this matrix R."""
        T = R.T.tocsr()
        return cls(matrix=R, transposed=T, by_triangle=R.tobsr((3, 1)), by_hinge=T.tobsr((1, 3)))

    def __call__(self, mu: np.ndarray) -> np.ndarray:
        """(m, 3) κ [1/m] of the measures μ (h,)."""
        return (self.matrix @ mu).reshape(-1, 3)

    def coupled(self) -> sparse.csr_matrix:
        """(h, h) with an entry for each two hinges of one triangle's curvature."""
        R = self.by_triangle
        ones = np.ones(len(R.indices))
        of_triangle = sparse.csr_matrix((ones, R.indices, R.indptr))
        pattern = (of_triangle.T @ of_triangle).tocsr()
        pattern.sort_indices()
        return pattern

    def products(self, H: np.ndarray, Q: sparse.csr_matrix, loop: SharedLoop) -> np.ndarray:
        """Return the entries of Rᵀ H R, for H (m, 3, 3) of the triangles.

        Q says which entries there are, and in which order; `coupled` makes such a Q. `loop` is
        over its rows, the hinges.
        """
        entries = np.empty(Q.nnz)
        T = self.by_hinge
        R = self.by_triangle
        left = T.data.reshape(-1, 3)
        right = R.data.reshape(-1, 3)

        def call(part: slice) -> Call:
            rows = pointers(Q, part), Q.indices
            of_hinge = pointers(T, part), T.indices, left
            of_triangle = R.indptr, R.indices, right
            position = np.empty(Q.shape[0], np.int64)  # work space, one for each thread
            arguments = *rows, *of_hinge, *of_triangle, H, position, entries
            return plate_loops.fill_products, arguments

        loop.each(call)
        return entries


@dataclass(frozen=True, eq=False)
class BoundFriction(BoundTerm):
    """`BendingFriction` on a cloth.

    Attributes
    ----------
    plate
        The hinge angles; its matrix has an entry for each two hinges of one triangle.
    curvature
        The curvature from these angles.
    sliders
        The sliders of the triangles, on P2 of their parts.
    area
        (m,) The areas of the triangles, on P2 of their parts [m²].
    loop
        The loop over the triangles.
    slid
        How far the sliders have slid. None before a run: then no slider has a moment.
    end
        The time at the end of the step, for the term over a step [s].
    """

    plate: PlateAngles
    curvature: Curvature
    sliders: Sliders
    area: np.ndarray
    loop: SharedLoop
    slid: SlidCurvature | None = None
    end: float = 0.0

    name = NAME
    symmetric = has_energy = True
    stores_strain = False

    @property
    def objective(self) -> bool:
        return not len(self.plate.held)  # the normals of clamps do not turn with the cloth

    @property
    def acts(self) -> bool:
        """Whether one of the fabrics has a hysteresis."""
        return bool(self.sliders.moments.any())

    dissipative = needs_path = acts

    @property
    def load_steps(self) -> int:
        return LOAD_STEPS if self.acts else 1

    def elastic(self, mu: np.ndarray) -> np.ndarray:
        """(m, 3) e = κ − κ_s [1/m]."""
        kappa = self.curvature(mu)
        if self.slid is None:
            return np.zeros_like(kappa)
        return kappa - self.slid.curvature.reshape(-1, 3)

    def _record(self, kappa: np.ndarray) -> SlidCurvature:
        return SlidCurvature(kappa.reshape(len(self.plate.panel.cloth.triangles), -1, 3))

    def _moments(self, mu: np.ndarray) -> np.ndarray:
        """(3m,) A ∂φ/∂κ of the triangles [N m²]."""
        return self.sliders.moment(self.elastic(mu), self.area).ravel()

    def _total(self, density: np.ndarray) -> float:
        return float(self.loop.select(self.area * density).sum())

    def energy(self, x: np.ndarray, t: float) -> float:
        """Σ A φ [J]; of a record after a step, what the sliders store."""
        if self.slid is None:
            return 0.0
        return self._total(self.sliders.energy(self.elastic(self.plate.measures(x, t))))

    def power(self, x: np.ndarray, v: np.ndarray, t: float) -> float:
        """Zero: no force depends on v. `dissipation` is the heat of a step."""
        return 0.0

    def dissipation(self, x: np.ndarray) -> float:
        """Σ A (s − s_y) [J] of the triangles that slid."""
        return self._total(self.sliders.heat(self.elastic(self.plate.measures(x, self.end))))

    def add_force(self, x, v, t, f) -> None:
        """f_a −= Σ m ∂μ/∂x_a with the moments m = Rᵀ A ∂φ/∂κ [N m]."""
        if self.slid is None:
            return
        mu, g = self.plate.gradients(x, t)
        self.plate.add_force(self._moments(mu), g, f, self.curvature.transposed)

    def add_tangent(self, x, v, t, wx, wv, J, definite) -> None:
        """J += wx (Gᵀ Rᵀ A φ″ R G + Σ m ∂²μ/∂x∂x) with G = ∂μ/∂x.

        `definite` leaves out the second part, which is indefinite. Before a run, when the
        sliders have no moment, they count as sticking.
        """
        if not self.acts:
            return
        mu, g = self.plate.gradients(x, t)
        H = self.area[:, None, None] * self.sliders.tangent(self.elastic(mu))
        entries = self.curvature.products(H, self.plate.stiffness, self.plate.loop)
        self.plate.add_products(g, g, wx, J, entries)
        if not definite and self.slid is not None:  # without `slid` all moments are zero
            moments = self.curvature.transposed @ self._moments(mu)
            self.plate.add_curvatures(x, t, moments, wx, J)

    def work_of_clamps(self, old: At, new: At, stages: Sequence[At]) -> float:
        """Work [J] that moves the normals of clamps over a step."""
        if self.slid is None:
            return 0.0
        T = self.curvature.transposed
        return self.plate.work_of_clamps(old, new, stages, lambda mu: T @ self._moments(mu))

    # --- over a step, and between two -------------------------------------------------------------

    def start_history(self, x: np.ndarray, t: float) -> SlidCurvature | None:
        """κ_s = κ at the start; None without a hysteresis."""
        if self.acts:
            return self._record(self.curvature(self.plate.measures(x, t)))
        return None

    def with_history(self, record: SlidCurvature) -> "BoundFriction":
        return replace(self, slid=record)

    def over_step(self, step: StepDifference) -> BoundTerm:
        sliders = self.sliders
        if step.increment and step.increment.friction != 1.0:
            sliders = sliders.weakened(step.increment.friction)
        record = step.history or self.start_history(step.start, step.t)
        return replace(self, sliders=sliders, slid=record, end=step.end)

    def commit(self, x: np.ndarray, t: float) -> SlidCurvature | None:
        """κ_s at the end of the step at x."""
        if self.slid is None:
            return None
        e = self.elastic(self.plate.measures(x, t))
        return self._record(self.slid.curvature.reshape(-1, 3) + e - self.sliders.left(e))

    def cells(self, x: np.ndarray, t: float) -> dict[str, np.ndarray]:
        """κ_s [1/m] and the moments of the sliders [N], both as (11, 22, 12).

        On P2 they are the means of a triangle's parts.
        """
        if self.slid is None:
            return {}
        moment = self._record(self.sliders.moment(self.elastic(self.plate.measures(x, t))))
        return {
            "slid_curvature": (self.slid.curvature * (1.0, 1.0, 0.5)).mean(axis=1),
            "friction_moment": moment.curvature.mean(axis=1),
        }

    def nbytes(self, explicit: bool) -> int:
        R = self.curvature.matrix
        return self.plate.nbytes(explicit) + 4 * int(R.data.nbytes + R.indices.nbytes)
