"""The arrays of a frame, as ParaView shows them.

    displacement          (n, 3)  x − (X, 0) [m]
    velocity              (n, 3)  [m/s]
    reference             (n, 3)  (X, 0): the flat cloth [m]
    held                  (n,)    directions that pins hold: 0 free, 3 fixed, or 1 or 2 of a slide
    E11, E22, E12         (m,)    Green strain along warp and weft
    principal_stretches   (m, 2)  smaller, larger
    warp, weft            (m, 3)  F e₁, F e₂: where the threads point, and how far they stretch
    strain_tensor         (m, 9)  the Green strain in space: R E Rᵀ with F = R U
    quality               (m,)    4√3 A / Σ l² of the reference triangle
    region                (m,)    number of the triangle's fabric, from 0
    S11, S22, S12         (m,)    second Piola–Kirchhoff stress resultants [N/m]
    stress_tensor         (m, 9)  stress resultants in space: F S Fᵀ / J [N/m of the present width]
    principal_stresses    (m, 2)  smaller, larger of these [N/m]
    energy_density        (m,)    W [J/m²] per reference area
    error_density         (m,)    energy of the error in space [J/m²], where it is asked for

1 is the warp and 2 the weft by the grain of the system (without a system, X and Y). Cell values are
means over the reference triangle; the tensors and directions use the mean of F. A tensor's
magnitude in ParaView is its Frobenius norm. Triangles of the element P2 are VTK's quadratic ones,
`Cloth.cells`; ParaView draws them curved from a "Nonlinear Subdivision Level" of 1 on.
"""

from __future__ import annotations

import numpy as np

from fecloth.mesh.cloth import Cloth
from fecloth.output.vtu_writer import Arrays
from fecloth.system.space_error import space_error
from fecloth.system.state import State
from fecloth.system.system import System
from fecloth.terms.kinematics import deformation_gradient, principal_stretches

STATIC = ("quality", "region", "reference", "held")  # the same in all frames


def fields(system: System, state: State, error_density: bool = False) -> tuple[Arrays, Arrays]:
    """Return the point data and cell data of a state, as listed at the head of this file.

    Stress resultants and energy density are summed over the membrane terms; a system without one
    has neither. With `error_density` the cells have that of `space_error`.
    """
    F = deformation_gradient(system.cloth, state.x, system.panel.gradients)
    mean = _mean(system.cloth, F)
    R, U = _polar(mean)
    points, cells = _kinematics(system.cloth, state, F, mean, R)
    points["held"] = _held_directions(system)
    cells["region"] = system.panel.region.astype(np.int32)
    membranes = [term for term in system.bound if hasattr(term, "add_stress")]
    if membranes:
        stress = np.zeros((len(system.cloth.triangles), 4))
        for term in membranes:
            term.add_stress(state.x, stress)
        cells |= _stresses(R, U, stress)
    if error_density:
        cells["error_density"] = space_error(system, state).density
    return points, cells


def kinematics(cloth: Cloth, state: State) -> tuple[Arrays, Arrays]:
    """Return the point data and cell data that need no material, along X and Y."""
    F = deformation_gradient(cloth, state.x)
    mean = _mean(cloth, F)
    return _kinematics(cloth, state, F, mean, _polar(mean)[0])


def _kinematics(
    cloth: Cloth, state: State, F: np.ndarray, mean: np.ndarray, R: np.ndarray
) -> tuple[Arrays, Arrays]:
    reference = np.column_stack([cloth.X, np.zeros(len(cloth.X))])
    points = {
        "displacement": state.x - reference,
        "velocity": state.v,
        "reference": reference,
    }
    E = _green_strain(cloth, F)
    cells = {
        "E11": E[:, 0, 0],
        "E22": E[:, 1, 1],
        "E12": E[:, 0, 1],
        "principal_stretches": principal_stretches(cloth, state.x),
        "warp": _single(mean[..., 0]),
        "weft": _single(mean[..., 1]),
        "strain_tensor": _turned(R, E),
        "quality": cloth.quality,
    }
    return points, cells


def _stresses(R: np.ndarray, U: np.ndarray, stress: np.ndarray) -> Arrays:
    """Cell data from the mean F = R U and S11, S22, S12 and W of each triangle (m, 4).

    The stress in space, F S Fᵀ / J, is R (U S U / J) Rᵀ.
    """
    S11, S22, S12, W = stress.T
    S = np.stack([S11, S12, S12, S22], axis=1).reshape(-1, 2, 2)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        T = U @ S @ U / np.linalg.det(U)[:, None, None]
    T[~np.isfinite(T)] = 0.0  # a triangle without area
    mean, half = (T[:, 0, 0] + T[:, 1, 1]) / 2, (T[:, 0, 0] - T[:, 1, 1]) / 2
    radius = np.hypot(half, T[:, 0, 1])
    return {
        "S11": S11.copy(),
        "S22": S22.copy(),
        "S12": S12.copy(),
        "stress_tensor": _turned(R, T),
        "principal_stresses": np.column_stack([mean - radius, mean + radius]),
        "energy_density": W.copy(),
    }


def _held_directions(system: System) -> np.ndarray:
    """(n,) number of directions in which each node is held."""
    held = np.zeros(len(system.cloth.X), np.uint8)
    free = np.trace(system.constraints.projectors, axis1=1, axis2=2)
    held[system.constraints.nodes] = np.round(3 - free)
    return held


def _green_strain(cloth: Cloth, F: np.ndarray) -> np.ndarray:
    """(m, 2, 2) mean of E = (FᵀF − I)/2 over each triangle."""
    C = np.einsum("eq,eqij,eqik->ejk", _share(cloth), F, F)
    return (C - np.eye(2)) / 2


def _mean(cloth: Cloth, F: np.ndarray) -> np.ndarray:
    """(m, 3, 2) mean of F over each triangle."""
    return np.einsum("eq,eqij->eij", _share(cloth), F)


def _share(cloth: Cloth) -> np.ndarray:
    return cloth.weights / cloth.weights.sum(axis=1, keepdims=True)


def _polar(F: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """R (m, 3, 2) and U (m, 2, 2) with F = R U; R is 0 where a triangle has no area.

    U² = FᵀF gives U = (FᵀF + J I) / √(tr FᵀF + 2J) with J = det U (Cayley and Hamilton).
    """
    C = F.transpose(0, 2, 1) @ F
    J = np.sqrt(np.maximum(np.linalg.det(C), 0.0))[:, None, None]
    trace = np.trace(C, axis1=1, axis2=2)[:, None, None]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        U = (C + J * np.eye(2)) / np.sqrt(trace + 2 * J)
        inverse = np.stack([U[:, 1, 1], -U[:, 0, 1], -U[:, 1, 0], U[:, 0, 0]], axis=1)
        R = F @ (inverse.reshape(-1, 2, 2) / J)
    R[~np.isfinite(R)] = 0.0
    return R, U


def _turned(R: np.ndarray, T: np.ndarray) -> np.ndarray:
    """(m, 9) the tensors R T Rᵀ in space, row by row."""
    return _single((R @ T @ R.transpose(0, 2, 1)).reshape(-1, 9))


def _single(values: np.ndarray) -> np.ndarray:
    """Numbers that are only drawn need 4 bytes."""
    return values.astype(np.float32)
