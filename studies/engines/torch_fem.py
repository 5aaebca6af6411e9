"""torch-fem: small strains, `Planar` where a cloth stays in its plane, `Shell` for a small sag.

Its shells have no geometric nonlinearity, and it has no steps in time, so that it takes the cases
at rest whose rotations are small. Its finite strains in the plane are of hyperelastic energies in
three dimensions, which a cloth does not state.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from importlib.metadata import version
from typing import Any

import numpy as np
import torch
from torchfem import Planar, Shell
from torchfem.materials import IsotropicElasticityPlaneStress, OrthotropicElasticityPlaneStress

torch.set_default_dtype(torch.float64)
torch.set_num_threads(1)

VERSION = f"torch-fem {version('torch-fem')}, torch {torch.__version__}"
SETTINGS = (
    "Planar (Tria1, orthotropic) or Shell (Tria1, isotropic, stiff in transverse shear), float64, "
    "direct solver"
)
SMALL = ("cantilever",)  # of the cases that leave the plane


def run(case: Mapping[str, Any]) -> np.ndarray:
    """Return the positions (1, n, 3) [m] of a linear solution."""
    if not case["static"]:
        raise NotImplementedError("no steps in time")
    leaves = bool(case["gravity"][2]) or bool(np.ptp(case["x"][:, 2]))
    if leaves and case["name"] not in SMALL:
        raise NotImplementedError("shells without geometric nonlinearity")
    model, size = make_shell(case) if leaves else make_planar(case)
    flat = torch.tensor(np.pad(case["X"], ((0, 0), (0, 1))))
    pins, end = case["pins"], case["x"][case["pins"]]
    if case["motion"] is not None:
        end = case["motion"][-1]
    width = flat.shape[1] if leaves else 2
    model.constraints[pins] = True
    model.displacements[pins, :width] = (torch.tensor(end) - flat[pins])[:, :width]
    weight = case["fabric"]["areal_density"] * torch.tensor(case["gravity"][:width]) / size
    forces = model.integrate_body_load(1.0).reshape(len(flat), -1)[:, :1] * weight
    model.forces[:, :width] = forces
    for load in case["loads"]:
        share = torch.tensor(load["force"][:width]) / len(load["nodes"])
        model.forces[load["nodes"], :width] += share
    moved = model.solve()[0].numpy()
    positions = np.pad(case["X"], ((0, 0), (0, 1)))
    positions[:, :width] += moved[:, :width]
    return positions[None]


def make_planar(case: Mapping[str, Any]) -> tuple[Planar, float]:
    """Return a membrane of thickness 1, whose stress is the cloth's, and this thickness."""
    fabric = case["fabric"]
    warp, weft = fabric["tensile_stiffness"]
    material = OrthotropicElasticityPlaneStress(
        warp, weft, fabric["poisson_ratio"], fabric["shear_stiffness"]
    )
    c, s = math.cos(fabric["grain"]), math.sin(fabric["grain"])
    turned = material.rotate(torch.tensor([[c, -s], [s, c]]))
    nodes, elements = torch.tensor(case["X"]), torch.tensor(case["triangles"])
    return Planar(nodes, elements, turned), 1.0


def make_shell(case: Mapping[str, Any]) -> tuple[Shell, float]:
    """Return a shell with the fabric's stiffness in tension and bending, and its thickness [m].

    It is thick, as a solid with both stiffnesses is, and would shear across: a fabric does not, so
    that its transverse moduli are a hundred times Young's.
    """
    fabric, nu = case["fabric"], case["fabric"]["poisson_ratio"]
    Y, B = fabric["tensile_stiffness"][0], fabric["bending_rigidity"]
    thickness = math.sqrt(12 * (1 - nu**2) * B / Y)
    nodes = torch.tensor(np.pad(case["X"], ((0, 0), (0, 1))))
    material = IsotropicElasticityPlaneStress(Y / thickness, nu)
    stiff = [100 * Y / thickness] * 2
    elements = torch.tensor(case["triangles"])
    return Shell(nodes, elements, material, thickness, transverse_G=stiff), thickness
