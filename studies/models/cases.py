"""One case of the models study: a membrane model in a scene."""

from __future__ import annotations

import numpy as np
from scipy.sparse.linalg import spsolve

import fecloth as fc
from fecloth import study
from studies import harness
from studies.models.hinge_bias import CELLS, cantilever
from studies.models.homogenised_moduli import NU, Y
from studies.models.homogenised_moduli import models as membranes

FABRIC = fc.Fabric(0.2, Y, NU, bending_rigidity=1e-4)
PATTERNS = ("right", "cross", "equilateral", "unstructured")
STRETCH, SHEAR = 0.1, np.radians(10.0)  # of the length; the angle of the picture frame
ANGLES = [float(angle) for angle in range(0, 181, 5)]  # of the pull [degrees]


def models(pattern: str) -> dict[str, object]:
    """Return all membranes by name; Baraff and Witkin's original is matched to Y at h = 0.1 m."""
    return membranes(pattern) | {"NeoHookean": fc.NeoHookean()}


def run(scene: str, model: str, pattern: str, h: float, bending: bool = False) -> dict:
    """Return the result of the function `scene` of this file."""
    terms = [models(pattern)[model]] + bending * [fc.HingeBending()]
    return globals()[scene](terms, pattern, h)


def stretch(terms: list, pattern: str, h: float) -> dict:
    """Return the force of a plane strip of 1 m × 0.5 m between clamps, pulled by a tenth."""
    cloth = fc.Cloth.rectangle(1.0, 0.5, h, pattern)
    system = fc.System(cloth, FABRIC, terms, [*clamps(cloth), in_plane(cloth, "left", "right")])
    pulled = fc.equilibrium(system, system.state(flat(cloth.X * (1 + STRETCH, 1.0))))
    force = -system.force(pulled)[cloth.nodes("right"), 0].sum()
    return {"value": force, "unit": "N"}


def shear(terms: list, pattern: str, h: float) -> dict:
    """Return 2 W/(A sin² γ) of a plane square in a picture frame of stiff hinged bars.

    The bars turn by γ/2 each, so that E11 = E22 = 0 and 2 E12 = sin γ; for StVK,
    W = A G sin² γ/2.
    """
    cloth = fc.Cloth.rectangle(0.5, 0.5, h, pattern)
    system = fc.System(cloth, FABRIC, terms, ["boundary", in_plane(cloth, "boundary")])
    c, s = np.cos(SHEAR / 2), np.sin(SHEAR / 2)
    sheared = fc.equilibrium(system, system.state(flat(cloth.X @ [[c, s], [s, c]])))
    W = sum(system.energies(sheared).values())
    return {"value": 2 * W / (0.25 * np.sin(SHEAR) ** 2), "unit": "N/m"}


def drape(terms: list, pattern: str, h: float) -> dict:
    """Return the sag of the centre of a unit square that is pinned 0.2 m around its corners."""
    cloth = fc.Cloth.rectangle(1.0, 1.0, h, pattern)
    system = fc.System(cloth, FABRIC, [*terms, fc.Gravity()], [fc.Pin(near_corners)])
    hung = fc.equilibrium(system, system.rest())
    middle = np.abs(cloth.X - 0.5).max(axis=1) < 0.51 * h
    return {"value": -hung.x[middle, 2].mean(), "unit": "m"}


def swing(terms: list, pattern: str, h: float) -> dict:
    """Return the mean depth after 0.4 s of a horizontal unit square pinned on the left."""
    system = make_swing(terms, pattern, h)
    t_end, dt, limit = 0.4, 2.5e-3, study.check_time_limit
    end = fc.run(system, fc.ImplicitMidpoint(), system.rest(), dt, t_end, report=limit)
    share = system.nodal_mass / system.nodal_mass.sum()
    return {"value": -share @ end.state.x[:, 2], "unit": "m"}


def cost(terms: list, pattern: str, h: float) -> dict:
    """Return the CPU time and iterations of an implicit midpoint step in 50 ms of the swing."""
    system = make_swing(terms, pattern, h)
    method, dt, steps = fc.ImplicitMidpoint(), 2.5e-3, 20

    def march() -> int:
        infos = [info for _, info in fc.march(system, method, system.rest(), dt, steps * dt)]
        return sum(info.counts.newton for info in infos)

    seconds = harness.measure_seconds(march)
    row = {"value": 1e3 * seconds.cpu / steps, "unit": "ms/step", "newton": seconds.value / steps}
    return row | {"wall": 1e3 * seconds.wall / steps}


def rose(terms: list, pattern: str, h: float) -> dict:
    """Return the stiffness against the direction of a pull, measured on a patch and derived.

    Measured: three uniform stresses on the boundary of a unit square at rest give its mean
    compliance s, W = A/2 σ·s σ; the stiffness along θ is 1/(t·s t), t = (cos², sin², cos sin).
    Derived: from the homogenised moduli of the infinite pattern.
    """
    s = compliance(fc.Cloth.rectangle(1.0, 1.0, h, pattern), terms[0])
    numbers = {"angle": ANGLES, "measured": directional_stiffness(s), "unit": "N/m"}
    numbers |= {
        "value": max(directional_stiffness(s)) / min(directional_stiffness(s)),
        "nu": -s[0, 1] / s[0, 0],
    }
    if pattern in CELLS:
        numbers["derived"] = directional_stiffness(
            np.linalg.inv(fc.plane_moduli(terms[0], FABRIC, pattern, h))
        )
    return numbers


def hinge(pattern: str, along: int) -> dict:
    """Return B_eff/B of a strip a quarter as wide as long, and the derived values."""
    measured = {"value": cantilever(pattern, along, 0.25)}
    if pattern not in CELLS:
        return measured
    D = fc.bending_tensor(pattern)
    return measured | {"narrow": 1 / np.linalg.inv(D)[0, 0], "wide": D[0, 0]}


def compliance(cloth: fc.Cloth, membrane) -> np.ndarray:
    """(3, 3) mean compliance of a unit square under (σ11, σ22, σ12) on its boundary [m/N]."""
    system = fc.System(cloth, FABRIC, [membrane])
    n, plane = len(cloth.X), np.arange(3 * len(cloth.X)) % 3 < 2
    K = system.stiffness(system.rest()).tocsr()[plane][:, plane]
    free = np.setdiff1d(np.arange(2 * n), rigid(cloth.X))
    loads = np.stack(
        [tractions(cloth, sigma).ravel() for sigma in ((1, 0, 0), (0, 1, 0), (0, 0, 1))]
    )
    u = np.zeros((3, 2 * n))
    u[:, free] = spsolve(K[free][:, free].tocsc(), loads[:, free].T).T
    return loads @ u.T


def rigid(X: np.ndarray) -> list[int]:
    """Return three components to fix against rigid motion: of a node, and of one far from it."""
    far = int(np.linalg.norm(X - X[0], axis=1).argmax())
    along_x = abs(X[far, 0] - X[0, 0]) >= abs(X[far, 1] - X[0, 1])
    return [0, 1, 2 * far + int(along_x)]


def tractions(cloth: fc.Cloth, sigma: tuple[float, float, float]) -> np.ndarray:
    """Return (n, 2) forces of a uniform stress on the boundary, half of an edge's to each end."""
    stress = np.array([[sigma[0], sigma[2]], [sigma[2], sigma[1]]])
    f, (a, b, c) = np.zeros((len(cloth.X), 2)), cloth.triangles[:, :3].T
    for i, j in ((a, b), (b, c), (c, a)):  # inner edges cancel
        along = cloth.X[j] - cloth.X[i]
        half = 0.5 * np.column_stack([along[:, 1], -along[:, 0]]) @ stress
        np.add.at(f, i, half)
        np.add.at(f, j, half)
    return f


def directional_stiffness(s: np.ndarray) -> list[float]:
    """Return the stiffness against a pull along each of `ANGLES` [N/m]."""
    theta = np.radians(ANGLES)
    t = np.stack([np.cos(theta) ** 2, np.sin(theta) ** 2, np.cos(theta) * np.sin(theta)])
    return (1 / np.einsum("ia,ij,ja->a", t, s, t)).tolist()


def make_swing(terms: list, pattern: str, h: float) -> fc.System:
    cloth = fc.Cloth.rectangle(1.0, 1.0, h, pattern)
    loads = [fc.StrainRateDamping(0.01), fc.Gravity()]
    return fc.System(cloth, FABRIC, [*terms, *loads], ["left"])


def clamps(cloth: fc.Cloth) -> list[fc.Pin]:
    return [fc.Pin("left"), fc.Pin("right")]


def in_plane(cloth: fc.Cloth, *pinned: str) -> fc.Slide:
    """Constrain all nodes but the pinned sets to the plane."""
    others = np.setdiff1d(np.arange(len(cloth.X)), np.concatenate([cloth.nodes(s) for s in pinned]))
    return fc.Slide(others, normal=(0, 0, 1))


def near_corners(X: np.ndarray) -> np.ndarray:
    """Return True for nodes on an edge of the unit square within 0.2 m of a corner."""
    from_edge = np.minimum(X, 1 - X)
    return (from_edge.min(axis=1) < 1e-9) & (from_edge.max(axis=1) < 0.2 + 1e-9)


def flat(X: np.ndarray) -> np.ndarray:
    return np.column_stack([X, np.zeros(len(X))])
