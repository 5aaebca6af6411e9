"""The arrays of a frame, as ParaView shows them: the page fecloth/runs/README.md lists them.

Cell values are means over the reference triangle; the tensors and directions use the mean of F.
"""

from collections.abc import Callable

import numpy as np

from fecloth.mesh.cloth import Cloth
from fecloth.mesh.elements import blocks
from fecloth.mesh.pieces import piece_of_nodes
from fecloth.mesh.surface import Surface
from fecloth.output.vtu_writer import Arrays
from fecloth.system.recovered_stress import stress_at_nodes
from fecloth.system.space_error import space_error
from fecloth.system.state import State
from fecloth.system.system import System
from fecloth.terms.kinematics import deformation_gradient, mean_over_triangles, stretches_of

STATIC = ("quality", "region", "piece", "reference")  # the same in all frames


def fields(system: System, state: State, error_density: bool = False) -> tuple[Arrays, Arrays]:
    """Return the point data and cell data of a state, as fecloth/runs/README.md lists them.

    Stress resultants and energy density are summed over the membrane terms; a system without one
    has neither. With `error_density` the cells have the error density of `space_error`.
    """
    cloth = system.cloth
    gradients = system.panel.gradients  # along warp and weft
    membranes = [term for term in system.bound if term.has_stress]
    stress = np.zeros((len(cloth.triangles), 4)) if membranes else None
    for term in membranes:
        term.add_stress(state.x, stress)
    held = np.zeros(len(cloth.X), np.uint8)  # number of directions in which each node is held
    # A projector onto the free directions has their number as its trace.
    free_directions = np.trace(system.constraints.projectors, axis1=1, axis2=2)
    held[system.constraints.nodes] = np.round(3 - free_directions)
    points = _points(cloth, state) | {"held": held} | _contact(system, state)
    if smooth := stress_at_nodes(system):
        points["recovered_stress"] = smooth(state.x)
    cells = _in_blocks(cloth, lambda part: _cells(cloth, gradients, state.x, stress, part))
    cells |= _fixed(cloth) | {"region": system.panel.region.astype(np.int32)}
    for term in system.bound:
        cells |= term.cells(state.x, state.t)
    if error_density:
        cells["error_density"] = space_error(system, state).density
    return points, cells


def kinematics(cloth: Cloth, state: State) -> tuple[Arrays, Arrays]:
    """Return the point data and cell data that need no material, along X and Y."""
    G = cloth.gradients
    cells = _in_blocks(cloth, lambda part: _cells(cloth, G, state.x, stress=None, part=part))
    return _points(cloth, state), cells | _fixed(cloth)


def _fixed(cloth: Cloth) -> Arrays:
    """Return the cell data of the mesh alone; without `piece` if there is one piece."""
    piece = piece_of_nodes(cloth.triangles, len(cloth.X))[cloth.triangles[:, 0]]
    cells = {"quality": cloth.quality}
    return cells | {"piece": piece.astype(np.int32)} if piece.any() else cells


def _points(cloth: Cloth, state: State) -> Arrays:
    reference = np.column_stack([cloth.X, np.zeros(len(cloth.X))])
    return {"displacement": state.x - reference, "velocity": state.v, "reference": reference}


def _contact(system: System, state: State) -> Arrays:
    """Return contact pressure (n,) [Pa] and slip (n, 3) [m/s]; no arrays without contact.

    Both are sums over the terms of contact.
    """
    x = state.x
    v = state.v
    t = state.t
    arrays = {}
    pushes = [term.push(x, t) for term in system.bound]
    if pushes := [push for push in pushes if push is not None]:
        areas = Surface.from_cloth(system.cloth).node_areas(system.cloth.X)
        arrays["contact_pressure"] = np.linalg.norm(sum(pushes), axis=1) / areas
    slips = [term.slip(x, v, t) for term in system.bound]
    if slips := [slip for slip in slips if slip is not None]:
        arrays["slip"] = sum(slips)
    return arrays


def _in_blocks(cloth: Cloth, arrays_of: Callable[[slice], Arrays]) -> Arrays:
    """Return arrays for all triangles, joined from `arrays_of(part)` for parts of them.

    The intermediate arrays of a part take less memory than those of all triangles.
    """
    m = len(cloth.triangles)
    joined = {}
    for part in blocks(m):
        for name, values in arrays_of(part).items():
            if name not in joined:
                joined[name] = np.empty((m, *values.shape[1:]), values.dtype)
            joined[name][part] = values
    return joined


def _cells(
    cloth: Cloth, gradients: np.ndarray, x: np.ndarray, stress: np.ndarray | None, part: slice
) -> Arrays:
    """Return the cell data of the triangles in the slice `part`, from positions x (n, 3) [m].

    `gradients` are ∂N_a/∂X of all triangles along the axes of F. `stress` (m, 4) are S11, S22,
    S12 [N/m] and the energy density W [J/m²] of all triangles; without it there are no stresses.
    """
    F = deformation_gradient(cloth, x, gradients, part)
    mean_F = mean_over_triangles(cloth, F, part)
    R, U = _polar(mean_F)
    # The mean of the strain; for P2 it is not the strain of the mean F.
    mean_FTF = mean_over_triangles(cloth, F.swapaxes(2, 3) @ F, part)
    E = (mean_FTF - np.eye(2)) / 2
    cells = {
        "E11": E[:, 0, 0],
        "E22": E[:, 1, 1],
        "E12": E[:, 0, 1],
        "principal_stretches": stretches_of(mean_FTF),
        "warp": _single(mean_F[..., 0]),
        "weft": _single(mean_F[..., 1]),
        "strain_tensor": _turned(R, E),
    }
    if stress is None:
        return cells
    return cells | _stresses(R, U, stress[part])


def _stresses(R: np.ndarray, U: np.ndarray, stress: np.ndarray) -> Arrays:
    """Return the cell data of stress for triangles with the mean F = R U.

    R (m, 3, 2) and U (m, 2, 2) are of `_polar`, and `stress` (m, 4) are S11, S22, S12 [N/m] and
    the energy density W [J/m²].
    """
    # The stress in space, F S Fᵀ / J, is R (U S U / J) Rᵀ.
    S11, S22, S12, W = stress.T
    S = np.stack([S11, S12, S12, S22], axis=1).reshape(-1, 2, 2)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        T = U @ S @ U / _determinant(U)[:, None, None]
    T[~np.isfinite(T)] = 0.0  # a triangle without area
    # The principal stresses by Mohr's circle.
    mean = (T[:, 0, 0] + T[:, 1, 1]) / 2
    half = (T[:, 0, 0] - T[:, 1, 1]) / 2
    radius = np.hypot(half, T[:, 0, 1])
    return {
        "S11": S11,
        "S22": S22,
        "S12": S12,
        "stress_tensor": _turned(R, T),
        "principal_stresses": np.column_stack([mean - radius, mean + radius]),
        "energy_density": W,
    }


def _polar(F: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return R (m, 3, 2) and the symmetric U (m, 2, 2) with F = R U, for F (m, 3, 2).

    R has orthonormal columns; it is 0 where a triangle has no area.
    """
    # U² = FᵀF gives U = (FᵀF + J I) / √(tr FᵀF + 2J) with J = det U (Cayley and Hamilton).
    C = F.transpose(0, 2, 1) @ F
    J = np.sqrt(np.maximum(_determinant(C), 0.0))[:, None, None]
    trace = np.trace(C, axis1=1, axis2=2)[:, None, None]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        U = (C + J * np.eye(2)) / np.sqrt(trace + 2 * J)
        inverse = np.stack([U[:, 1, 1], -U[:, 0, 1], -U[:, 1, 0], U[:, 0, 0]], axis=1)
        R = F @ (inverse.reshape(-1, 2, 2) / J)
    R[~np.isfinite(R)] = 0.0
    return R, U


def _determinant(A: np.ndarray) -> np.ndarray:
    """(m,) the determinants of A (m, 2, 2), in a fifth of the time of `np.linalg.det`."""
    return A[:, 0, 0] * A[:, 1, 1] - A[:, 0, 1] * A[:, 1, 0]


def _turned(R: np.ndarray, T: np.ndarray) -> np.ndarray:
    """(m, 9) the tensors R T Rᵀ in space, row by row."""
    RT = _single(R @ T)[:, :, None]
    R = _single(R)[:, None]
    with np.errstate(over="ignore", invalid="ignore"):  # of a cloth that blows up
        return (RT[..., 0] * R[..., 0] + RT[..., 1] * R[..., 1]).reshape(-1, 9)


def _single(values: np.ndarray) -> np.ndarray:
    """Numbers that are only drawn need 4 bytes; of a cloth that blows up they are infinite."""
    with np.errstate(over="ignore"):
        return values.astype(np.float32)
