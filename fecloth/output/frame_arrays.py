"""The arrays of a frame, as ParaView shows them.

    displacement          (n, 3)  x − (X, 0) [m]
    velocity              (n, 3)  [m/s]
    green_strain          (m, 3)  E11, E22, E12
    principal_stretches   (m, 2)  smaller, larger
    quality               (m,)    4√3 A / Σ l² of the reference triangle
    stress_resultants     (m, 3)  S11, S22, S12 [N/m]
    energy_density        (m,)    W [J/m²] per reference area
    error_density         (m,)    energy of the error in space [J/m²], where it is asked for

1 is the warp and 2 the weft by the grain of the system (without a system, X and Y); ParaView shows
the components by these names. Cell values are means over the reference triangle. Triangles of the
element P2 are VTK's quadratic ones, `Cloth.cells`; ParaView draws them curved from a "Nonlinear
Subdivision Level" of 1 on.
"""

from __future__ import annotations

import numpy as np

from fecloth.mesh.cloth import Cloth
from fecloth.output.vtu_writer import Arrays
from fecloth.system.space_error import space_error
from fecloth.system.state import State
from fecloth.system.system import System
from fecloth.terms.kinematics import deformation_gradient, principal_stretches


def fields(system: System, state: State, error_density: bool = False) -> tuple[Arrays, Arrays]:
    """Return the point data and cell data of a state, as listed at the head of this file.

    Stress resultants and energy density are summed over the membrane terms; a system without one
    has neither. With `error_density` the cells have that of `space_error`.
    """
    points, cells = kinematics(system.cloth, state, system.panel.gradients)
    membranes = [term for term in system.bound if hasattr(term, "add_stress")]
    if membranes:
        stress = np.zeros((len(system.cloth.triangles), 4))
        for term in membranes:
            term.add_stress(state.x, stress)
        cells |= {"stress_resultants": stress[:, :3], "energy_density": stress[:, 3]}
    if error_density:
        cells["error_density"] = space_error(system, state).density
    return points, cells


def kinematics(
    cloth: Cloth, state: State, gradients: np.ndarray | None = None
) -> tuple[Arrays, Arrays]:
    """Return the point data and cell data that need no material.

    `gradients` are those along warp and weft, `Panel.gradients`; left out, along X and Y.
    """
    moved = state.x.copy()
    moved[:, :2] -= cloth.X
    cells = {
        "green_strain": _green_strain(cloth, state.x, gradients),
        "principal_stretches": principal_stretches(cloth, state.x),
        "quality": cloth.quality,
    }
    return {"displacement": moved, "velocity": state.v}, cells


def _green_strain(cloth, x, gradients):
    """(m, 3) means of E11, E22, E12 over each triangle."""
    F = deformation_gradient(cloth, x, gradients)
    share = cloth.weights / cloth.weights.sum(axis=1, keepdims=True)
    C11, C22 = np.einsum("eq,eqij,eqij->je", share, F, F)
    C12 = np.einsum("eq,eqi,eqi->e", share, F[..., 0], F[..., 1])
    return np.column_stack([(C11 - 1) / 2, (C22 - 1) / 2, C12 / 2])
