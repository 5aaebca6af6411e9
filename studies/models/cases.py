"""What each membrane model answers in the scenes of models.py: one case, its numbers."""

from __future__ import annotations

import time

import numpy as np
from scipy.sparse.linalg import spsolve

import fecloth as fc
from fecloth import study
from fecloth.scene.scene import load
from studies.models.hinge_bias import CELLS, cantilever
from studies.models.homogenised_moduli import NU, Y
from studies.models.homogenised_moduli import models as membranes

FABRIC = fc.Fabric(0.2, Y, NU, bending_rigidity=1e-4)
MEMBRANES = (fc.StVK, fc.TensorCondition, fc.BaraffWitkin, fc.NeoHookean, fc.Springs)
PATTERNS = ("right", "cross", "equilateral", "unstructured")
STRETCH, SHEAR = 0.1, np.radians(10.0)  # of the length; the angle of the picture frame
ANGLES = [float(angle) for angle in range(0, 181, 5)]  # of the pull [degrees]


def models(pattern: str) -> dict[str, object]:
    """All membranes by name; Baraff and Witkin's as published is matched to Y at h = 0.1 m."""
    return membranes(pattern) | {"NeoHookean": fc.NeoHookean()}


def run(scene: str, model: str, pattern: str, h: float, bending: bool = False) -> dict:
    """The numbers of one case of models.py, by the function of that name below."""
    terms = [models(pattern)[model]] + bending * [fc.HingeBending()]
    return globals()[scene](terms, pattern, h)


def stretch(terms: list, pattern: str, h: float) -> dict:
    """A strip 1 m × 0.5 m between clamps, kept plane, pulled by a tenth: the force it takes."""
    cloth = fc.Cloth.rectangle(1.0, 0.5, h, pattern)
    system = fc.System(cloth, FABRIC, terms, [*clamps(cloth), in_plane(cloth, "left", "right")])
    pulled = fc.equilibrium(system, system.state(flat(cloth.X * (1 + STRETCH, 1.0))))
    force = -system.force(pulled)[cloth.nodes("right"), 0].sum()
    return {"value": force, "unit": "N"}


def shear(terms: list, pattern: str, h: float) -> dict:
    """A square in a picture frame of stiff hinged bars, kept plane: 2 W/(A sin² γ).

    The bars turn by γ/2 each, so that E11 = E22 = 0 and 2 E12 = sin γ, of which StVK makes
    W = A G sin² γ/2.
    """
    cloth = fc.Cloth.rectangle(0.5, 0.5, h, pattern)
    system = fc.System(cloth, FABRIC, terms, ["boundary", in_plane(cloth, "boundary")])
    c, s = np.cos(SHEAR / 2), np.sin(SHEAR / 2)
    sheared = fc.equilibrium(system, system.state(flat(cloth.X @ [[c, s], [s, c]])))
    W = sum(system.energies(sheared).values())
    return {"value": 2 * W / (0.25 * np.sin(SHEAR) ** 2), "unit": "N/m"}


def drape(terms: list, pattern: str, h: float) -> dict:
    """A unit square held by 0.2 m of each edge's ends sags under its weight: its middle."""
    cloth = fc.Cloth.rectangle(1.0, 1.0, h, pattern)
    system = fc.System(cloth, FABRIC, [*terms, fc.Gravity()], [fc.Pin(near_corners)])
    hung = fc.equilibrium(system, system.rest())
    middle = np.abs(cloth.X - 0.5).max(axis=1) < 0.51 * h
    return {"value": -hung.x[middle, 2].mean(), "unit": "m"}


def swing(terms: list, pattern: str, h: float) -> dict:
    """A unit square falls from level, held along its left edge: its mean depth after 0.4 s."""
    system = swinging(terms, pattern, h)
    t_end, dt, limit = 0.4, 2.5e-3, study.check_time_limit
    end = fc.run(system, fc.ImplicitMidpoint(), system.rest(), dt, t_end, report=limit)
    share = system.nodal_mass / system.nodal_mass.sum()
    return {"value": -share @ end.state.x[:, 2], "unit": "m"}


def cost(terms: list, pattern: str, h: float) -> dict:
    """A step of implicit midpoint in the first 50 ms of the swing: CPU time and iterations."""
    system = swinging(terms, pattern, h)
    method, dt, steps = fc.ImplicitMidpoint(), 2.5e-3, 20

    def march() -> int:
        infos = [info for _, info in fc.march(system, method, system.rest(), dt, steps * dt)]
        return sum(info.counts.newton for info in infos)

    seconds = study.measure_seconds(march)
    row = {"value": 1e3 * seconds.cpu / steps, "unit": "ms/step", "newton": seconds.value / steps}
    return row | {"wall": 1e3 * seconds.wall / steps, "compile_seconds": seconds.compiling}


def rose(terms: list, pattern: str, h: float) -> dict:
    """Stiffness against the direction of a pull, measured on a patch and derived.

    Three uniform stresses along the boundary of a unit square at rest give its mean compliance s,
    W = A/2 σ·s σ; a pull along θ meets 1/(t·s t) with t = (cos², sin², cos sin). Derived: from
    the homogenised moduli of the endless pattern.
    """
    s = compliance(fc.Cloth.rectangle(1.0, 1.0, h, pattern), terms[0])
    numbers = {"angle": ANGLES, "measured": pull(s), "unit": "N/m"}
    numbers |= {"value": max(pull(s)) / min(pull(s)), "nu": -s[0, 1] / s[0, 0]}
    if pattern in CELLS:
        numbers["derived"] = pull(np.linalg.inv(fc.plane_moduli(terms[0], FABRIC, pattern, h)))
    return numbers


def hinge(pattern: str, along: int) -> dict:
    """B_eff/B of a strip a quarter as wide as long, and those derived for narrow and wide ones."""
    measured = {"value": cantilever(pattern, along, 0.25)}
    if pattern not in CELLS:
        return measured
    D = fc.bending_tensor(pattern)
    return measured | {"narrow": 1 / np.linalg.inv(D)[0, 0], "wide": D[0, 0]}


def own(path: str, text: str, model: str) -> dict:
    """A scene file with its membrane replaced: where it ends, and the seconds.

    `text` is the file's, so that a change of it is another case.
    """
    built = load(path).build()
    given = [term for term in built.system.terms if not isinstance(term, MEMBRANES)]
    whole, Y = built.system, built.system.panel.fabrics[0].tensile[0]
    choice = {**models("right"), "TensorCondition": fc.TensorCondition(Y / 4)}
    arguments = whole.pins, whole.mass_kind, whole.grain
    system = fc.System(built.cloth, whole.fabric, [choice[model], *given], *arguments)
    run_ = built.method, built.state, built.dt, built.t_end
    begin = time.process_time()
    options = {"solver": built.linear, "newton": built.newton, "report": study.check_time_limit}
    end = fc.run(system, *run_, **options)
    return {"x": end.state.x.ravel(), "cpu_seconds": time.process_time() - begin}


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
    """Three components that leave no rigid motion: a node, and one far from it across the line."""
    far = int(np.linalg.norm(X - X[0], axis=1).argmax())
    along_x = abs(X[far, 0] - X[0, 0]) >= abs(X[far, 1] - X[0, 1])
    return [0, 1, 2 * far + int(along_x)]


def tractions(cloth: fc.Cloth, sigma: tuple[float, float, float]) -> np.ndarray:
    """(n, 2) forces of a uniform stress on the boundary, half of each edge's to either end."""
    stress = np.array([[sigma[0], sigma[2]], [sigma[2], sigma[1]]])
    f, (a, b, c) = np.zeros((len(cloth.X), 2)), cloth.triangles[:, :3].T
    for i, j in ((a, b), (b, c), (c, a)):  # what two triangles share cancels
        along = cloth.X[j] - cloth.X[i]
        half = 0.5 * np.column_stack([along[:, 1], -along[:, 0]]) @ stress
        np.add.at(f, i, half)
        np.add.at(f, j, half)
    return f


def pull(s: np.ndarray) -> list[float]:
    """Stiffness against a pull along each of the angles [N/m]."""
    theta = np.radians(ANGLES)
    t = np.stack([np.cos(theta) ** 2, np.sin(theta) ** 2, np.cos(theta) * np.sin(theta)])
    return (1 / np.einsum("ia,ij,ja->a", t, s, t)).tolist()


def swinging(terms: list, pattern: str, h: float) -> fc.System:
    cloth = fc.Cloth.rectangle(1.0, 1.0, h, pattern)
    loads = [fc.StrainRateDamping(0.01), fc.Gravity()]
    return fc.System(cloth, FABRIC, [*terms, *loads], ["left"])


def clamps(cloth: fc.Cloth) -> list[fc.Pin]:
    return [fc.Pin("left"), fc.Pin("right")]


def in_plane(cloth: fc.Cloth, *held: str) -> fc.Slide:
    """All nodes but those of the held sets stay in the plane."""
    others = np.setdiff1d(np.arange(len(cloth.X)), np.concatenate([cloth.nodes(s) for s in held]))
    return fc.Slide(others, normal=(0, 0, 1))


def near_corners(X: np.ndarray) -> np.ndarray:
    """Whether a node lies on an edge of the unit square, within 0.2 m of a corner."""
    from_edge = np.minimum(X, 1 - X)
    return (from_edge.min(axis=1) < 1e-9) & (from_edge.max(axis=1) < 0.2 + 1e-9)


def flat(X: np.ndarray) -> np.ndarray:
    return np.column_stack([X, np.zeros(len(X))])
