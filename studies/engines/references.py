"""The known values of the cases of `fecloth bench`, computed without triangles or read from data.

Each function takes what the file of a case says and returns value and standard uncertainty. A test
recomputes all files. Laws that agree at small strain differ at larger ones: where a closed form is
of one law, its difference from linear force over stretch is in the uncertainty.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from scipy.optimize import brentq

from studies.references import closed_forms, falling_disk
from studies.references.elastica import heavy_elastica
from studies.validation.comparison import read_comparisons
from studies.validation.pages import DATA, read_columns

GRAVITY = 9.81
Said = Mapping[str, Any]


def flight(said: Said) -> tuple[float, float]:
    """Rigid motion: 0 apart from it; the uncertainty is what the spin ω stretches, from t = 0.

    A spinning disk of radius a has u(r) = (1 − ν) ρ ω² r ((3 + ν) a² − (1 + ν) r²)/(8 Y),
    which balances plane stress and the load ρ ω² r, with a free edge. The disk begins unstretched,
    so that it swings up to 2 u(a) at the rim, and turns slower by 2 ⟨u/r⟩, the mean over its moment
    of inertia.
    """
    fabric, a, omega = said["fabric"], said["mesh"]["radius"], 2 * math.pi
    Y, nu = fabric["tensile_stiffness"][0], fabric["poisson_ratio"]
    part = (1 - nu) * fabric["areal_density"] * omega**2 * a**2 / (8 * Y)
    late = 2 * omega * said["times"][-1] * part * ((3 + nu) - (1 + nu) * 2 / 3)
    return 0.0, a * (2 * part * 2 + late)


def hanging(said: Said) -> tuple[float, float]:
    """Mean displacement of a strip under its own weight; linear: ρ g L²/(3 Y)."""
    L, (Y, _), rho = _strip(said)
    exact = closed_forms.hanging_strip_mean(L, Y, rho, GRAVITY)
    return exact, abs(exact - rho * GRAVITY * L**2 / (3 * Y))


def shear(said: Said) -> tuple[float, float]:
    """An affine motion of the boundary is the equilibrium of the inside, by any uniform law."""
    return 0.0, 0.0


def cantilever(said: Said) -> tuple[float, float]:
    """The small sag ρ g L⁴/(8 B) (Euler and Bernoulli); uncertain by the elastica's difference."""
    L, rho, B = _overhang(said)
    small = rho * GRAVITY * L**4 / (8 * B)
    _, _, drop = heavy_elastica(rho * GRAVITY * L**3 / B)
    return -small, abs(small - L * drop[-1])


def elastica(said: Said) -> tuple[float, float]:
    """The sag of the heavy elastica that stretches; the uncertainty is the stretch's share."""
    L, rho, B = _overhang(said)
    gamma, softness = rho * GRAVITY * L**3 / B, rho * GRAVITY * L / _strip(said)[1][0]
    _, _, drop = heavy_elastica(gamma, softness=softness)
    _, _, stiff = heavy_elastica(gamma)
    return -L * drop[-1], L * abs(drop[-1] - stiff[-1])


def catenary(said: Said) -> tuple[float, float]:
    """The sag of the elastic catenary (Irvine, 1981, chapter 1).

    With the horizontal force H and the weight w = ρ g of a strip between two points at the distance
    l = H L/Y + 2 H/w asinh(w L/(2 H)), the sag is w L²/(8 Y) + (√(H² + (w L/2)²) − H)/w. Its force
    is linear in the stretch; the uncertainty is the share of the stretch times three strains, by
    which St. Venant and Kirchhoff's law differs at most.
    """
    L, (Y, _), rho = _strip(said)
    span, w = 0.8 * L, rho * GRAVITY

    def sag(Y: float) -> tuple[float, float]:
        def miss(H: float) -> float:
            return H * L / Y + 2 * H / w * math.asinh(w * L / (2 * H)) - span

        H = brentq(miss, 1e-3 * w * L, 10 * w * L, xtol=1e-14)
        strain = math.hypot(H, w * L / 2) / Y
        return w * L**2 / (8 * Y) + (math.hypot(H, w * L / 2) - H) / w, strain

    (here, strain), (stiff, _) = sag(Y), sag(1e12)
    return -here, 3 * strain * abs(here - stiff)


def string(said: Said) -> tuple[float, float]:
    """The period 2 L √(ρ/S) of a taut strip with S = Y (λ² − 1)/2; linear: S = Y (λ − 1)/λ."""
    L, (Y, _), rho = _strip(said)
    stretch = 1.001
    S, linear = Y * (stretch**2 - 1) / 2, Y * (stretch - 1) / stretch
    period = 2 * L * math.sqrt(rho / S)
    return period, abs(period - 2 * L * math.sqrt(rho / linear))


def wave(said: Said) -> tuple[list[float], float]:
    """The free end as a pulse arrives: 2 A exp(−((L − a − c t)/b)²), c² = Y/ρ (d'Alembert).

    The uncertainty is how much StVK's speed c (1 + 3 e/2) at the largest strain e changes it.
    """
    L, (Y, _), rho = _strip(said)
    c, A, a, b = math.sqrt(Y / rho), 3e-5, 0.4, 0.1
    t = np.array(said["times"])

    def end(c: float) -> np.ndarray:
        return 2 * A * np.exp(-(((L - a - c * t) / b) ** 2))

    strain = math.sqrt(2 / math.e) * A / b
    return end(c).tolist(), float(np.abs(end(c * (1 + 1.5 * strain)) - end(c)).max())


def trampoline(said: Said) -> tuple[list[float], float]:
    """The mean deflection of a disk that falls, of `falling_disk.trampoline`; 1e-4 of its peak."""
    run = falling_disk.trampoline(said["times"])
    return (-run.mean_deflection).tolist(), 1e-4 * float(run.mean_deflection.max())


def nylon(said: Said) -> tuple[float, float]:
    """The extension of a strip at 30° to the grain at its largest force (Farrell et al., 2025).

    The first point of the curve has the force F₀: the strip is taut before it by F₀ over the mean
    slope. Uncertain are forces by 2 % and the slack by 0.46 N (studies/validation/nylon.py).
    """
    columns = read_columns(DATA / "farrell_2025_tension_30.csv")
    extension, force = columns["extension [mm]"], columns["force [N]"]
    slope = (force[-1] - force[0]) / (extension[-1] - extension[0])
    value = 1e-3 * (extension[-1] + force[0] / slope)
    return value, value * math.hypot(0.02, 0.46 / force[-1])


def knit(said: Said) -> tuple[float, float]:
    """The narrowing of stockinette along the course at 12.5 % (Singal et al., 2024).

    It is the mean of five repeats, in each between the two measured points about 12.5 %; uncertain
    by their standard deviation.
    """
    columns = read_columns(DATA / "singal_2024_acrylic_stockinette_course.csv")
    repeats = [columns["repeat"] == number for number in np.unique(columns["repeat"])]
    length = np.mean([columns["clamp distance [mm]"][rows][0] for rows in repeats])
    narrowings = []
    for rows in repeats:
        drawn = columns["clamp distance [mm]"][rows]
        across = columns["pin distance across [mm]"][rows]
        order = np.argsort(drawn, kind="stable")
        extension = drawn - drawn[0]
        narrowing = across[0] - across
        at_place = np.interp(0.125 * length, extension[order], narrowing[order])
        narrowings.append(1e-3 * at_place)
    return float(np.mean(narrowings)), float(np.std(narrowings, ddof=1))


def drape(said: Said) -> tuple[float, float]:
    """The drape coefficient of a wool tropical (Matsudaira et al., 2015)."""
    case = ("wool tropical", "drape coefficient, elastic")
    rows = read_comparisons(DATA.parent / "drape" / "comparison.csv")
    row = next(row for row in rows if (row.specimen, row.quantity) == case)
    return row.measured, math.hypot(row.scatter, row.input)


CASES: dict[str, Callable[[Said], tuple[Any, float]]] = {
    function.__name__: function
    for function in (
        *(flight, hanging, shear, cantilever, elastica, catenary),
        *(string, wave, trampoline, nylon, knit, drape),
    )
}


def _strip(said: Said) -> tuple[float, list[float], float]:
    """Return length, stiffnesses and areal density of a strip."""
    fabric = said["fabric"]
    return said["mesh"]["width"], fabric["tensile_stiffness"], fabric["areal_density"]


def _overhang(said: Said) -> tuple[float, float, float]:
    """Return length beyond the clamp, areal density and bending rigidity."""
    mesh, fabric = said["mesh"], said["fabric"]
    return mesh["width"] + mesh["corner"][0], fabric["areal_density"], fabric["bending_rigidity"]
