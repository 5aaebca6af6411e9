"""One case of the bending study: a problem, a model, a pattern and an edge length."""

from __future__ import annotations

import numpy as np
from scipy.sparse.linalg import eigsh, spsolve

import fecloth as fc
from fecloth.terms.traits import traits_of
from studies.bending.meshes import disk, on_sides, rectangle, square
from studies.references import plates
from studies.references.elastica import heavy_elastica

MODELS = {  # name: term, element
    "HingeBending": (fc.HingeBending(), "P1"),
    "QuadraticBending": (fc.QuadraticBending(), "P1"),
    "PlateBending": (fc.PlateBending(), "P1"),
    "PlateBending P2": (fc.PlateBending(), "P2"),
}
PROBLEMS = (
    "supported_square",
    "clamped_square",
    "clamped_disk",
    "free_square",
    "corner_twist",
    "heavy_strip",
)
FABRIC = fc.Fabric(1.0, 1e3, bending_rigidity=1.0, bending_poisson_ratio=0.3)
WEIGHT, RATIO, WIDTH = 10.0, 1e5, 0.25  # of the strip: ρ g L³/B, Y L²/B, width over length


def run(problem: str, model: str, pattern: str, n: int) -> dict:
    """Return the relative error of the function `problem` of this file; nodes are 1/n m apart."""
    term, element = MODELS[model]
    between = n // 2 if element == "P2" else n
    return {"error": globals()[problem](term, element, pattern, between), "h": 1 / n}


def transverse(system: fc.System) -> object:
    """Return the stiffness (n, n) against deflections from flat [N/m]."""
    return system.stiffness(system.rest()).tocsr()[2::3, 2::3].tocsc()


def deflection(system: fc.System, load: np.ndarray, held: np.ndarray) -> np.ndarray:
    """Return w (n,) under nodal forces (n,); the nodes `held` (n,) have none."""
    w, free = np.zeros(len(load)), ~held
    w[free] = spsolve(transverse(system)[free][:, free], load[free])
    return w


def uniform_load(cloth: fc.Cloth) -> np.ndarray:
    return cloth.weighted_load(np.ones(len(cloth.triangles)))


def next_to(cloth: fc.Cloth, held: np.ndarray) -> np.ndarray:
    """Return (n,) whether a node belongs to a triangle with a node that is held."""
    near = np.zeros(len(held), bool)
    near[cloth.triangles[held[cloth.triangles].any(axis=1)]] = True
    return near


def moved_out(cloth: fc.Cloth, factor: float, centre: float) -> fc.Cloth:
    X = centre + factor * (cloth.X - centre)
    return fc.Cloth.from_arrays(X, cloth.triangles, renumber=False)


def largest_error(w: np.ndarray, exact: np.ndarray) -> float:
    return float(np.abs(w - exact).max() / exact.max())


def supported_square(term, element: str, pattern: str, n: int) -> float:
    """Largest error of the deflection under a uniform load, over the largest deflection."""
    cloth = square(pattern, n, element)
    system = fc.System(cloth, FABRIC, [term])
    w = deflection(system, uniform_load(cloth), on_sides(cloth.X))
    return largest_error(w, plates.square_deflection(cloth.X, FABRIC.plate(), "supported"))


def clamped_square(term, element: str, pattern: str, n: int) -> float:
    """The same with clamped sides."""
    cloth = square(pattern, n, element)
    cloth, w = clamped(term, cloth, on_sides(cloth.X), 1 + 1 / n, 0.5)
    X = np.clip(cloth.X, 0.0, 1.0)
    return largest_error(w, plates.square_deflection(X, FABRIC.plate(), "clamped"))


def clamped_disk(term, element: str, pattern: str, n: int) -> float:
    """The same for a disk with a clamped rim."""
    cloth = disk(pattern, n, element)
    rim = np.isin(np.arange(len(cloth.X)), cloth.nodes("boundary"))
    cloth, w = clamped(term, cloth, rim, 1 + 0.5 / n, 0.0)
    return largest_error(w, plates.disk_deflection(cloth.X, FABRIC.plate()[0, 0]))


def clamped(term, cloth: fc.Cloth, rim: np.ndarray, factor: float, centre: float) -> tuple:
    """Return the cloth and its deflection under a uniform load.

    Hinges have no clamp: two rows of nodes are held, and the plate begins half-way between them,
    so the cloth is larger by the `factor`.
    """
    if traits_of(term).holds_normals:
        system = fc.System(cloth, FABRIC, [term], [fc.Pin(np.flatnonzero(rim), clamp=True)])
        return cloth, deflection(system, uniform_load(cloth), rim)
    cloth = moved_out(cloth, factor, centre)
    system = fc.System(cloth, FABRIC, [term])
    return cloth, deflection(system, uniform_load(cloth), next_to(cloth, rim))


def free_square(term, element: str, pattern: str, n: int) -> float:
    """Error of the lowest frequency; the mass is lumped on P1 and consistent on P2."""
    cloth = square(pattern, n, element)
    system = fc.System(cloth, FABRIC, [term])
    mass = system.mass.tocsr()[2::3, 2::3].tocsc()
    squares = eigsh(transverse(system), 4, mass, sigma=-1.0, return_eigenvectors=False)
    exact = plates.square_frequencies(FABRIC.plate(), "free", 1)[0]
    return float(abs(np.sqrt(np.sort(squares)[3]) / exact - 1))


def corner_twist(term, element: str, pattern: str, n: int) -> float:
    """Error of w = P/(4 D₆₆) of a free square: three corners held, a force P at the fourth."""
    cloth = square(pattern, n, element)
    corners = [int(np.abs(cloth.X - c).sum(axis=1).argmin()) for c in ((0, 0), (1, 0), (0, 1))]
    last = int(np.abs(cloth.X - 1.0).sum(axis=1).argmin())
    load, held = np.zeros(len(cloth.X)), np.zeros(len(cloth.X), bool)
    load[last], held[corners] = 1.0, True
    w = deflection(fc.System(cloth, FABRIC, [term]), load, held)
    return float(abs(w[last] * 4 * FABRIC.plate()[2, 2] - 1))


def heavy_strip(term, element: str, pattern: str, n: int) -> float:
    """Error of drop over width of a clamped strip that hangs: rotations of up to 60°."""
    fabric = fc.Fabric(1.0, RATIO, bending_rigidity=1.0)
    begin = 0.0 if traits_of(term).holds_normals else 0.5 / n
    cloth = rectangle(1.0 + begin, WIDTH, 1 / n, pattern, element)
    left = cloth.X[:, 0] < 1e-9
    held = next_to(cloth, left) if begin else left
    pin = fc.Pin(np.flatnonzero(held), clamp=not begin)
    terms = [fc.StVK(), term, fc.Gravity((0, 0, -WEIGHT))]
    system = fc.System(cloth, fabric, terms, [pin])
    tip = fc.equilibrium(system, system.rest()).x[cloth.X[:, 0] > 1 + begin - 1e-9].mean(axis=0)
    _, reach, drop = heavy_elastica(WEIGHT, softness=WEIGHT / RATIO)
    return float(abs(-tip[2] / (tip[0] - begin) / (drop[-1] / reach[-1]) - 1))
