"""Tubes, cones and cushions that are sewn, held against closed forms."""

from dataclasses import replace

import numpy as np
import pytest

import fecloth as fc
from fecloth.mesh.surface import Enclosure
from fecloth.simulation.probes import _held_forces
from fecloth.system.recovered_stress import stress_at_nodes, stress_at_point

R = 0.1
HEIGHT = 0.1
FABRIC = fc.Fabric(areal_density=0.2, tensile_stiffness=1000.0, poisson_ratio=0.0)


def tube(element: str, pieces: int, h: tuple[float, ...]) -> tuple[fc.Cloth, np.ndarray, list]:
    """A cloth that is rolled up to a tube, its positions, and its seams.

    Several pieces have triangles of different sizes, so that their edges do not match.
    """
    width = 2 * np.pi * R / pieces
    sheets = []
    for number in range(pieces):
        sheet = fc.Cloth.rectangle(width, HEIGHT, h=h[number], pattern="cross", element=element)
        sheets.append(replace(sheet, X=sheet.X + (number * width, 0.0)))
    if pieces == 1:
        cloth, seams = sheets[0], [fc.Seam("left", "right")]
    else:
        cloth = fc.Cloth.join(sheets, names=["a", "b"])
        seams = [fc.Seam("a.right", "b.left"), fc.Seam("a.left", "b.right")]
    angle = cloth.X[:, 0] / R
    x = np.column_stack([R * np.cos(angle), R * np.sin(angle), cloth.X[:, 1]])
    return cloth, x, seams


PRESSURE, NU = 2e3, 0.3
STRETCH = np.sqrt(
    1 + 2 * PRESSURE * R * (1 - NU**2) / 1000.0
)  # p r = λ S, S = Y (λ² − 1)/2(1 − ν²)


def tube_under_pressure(element: str, pieces: int, h: tuple[float, ...], pressure) -> tuple:
    """The system of a tube whose length is held, and its start."""
    cloth, x, seams = tube(element, pieces, h)
    end = np.isin(cloth.X[:, 1], (0.0, HEIGHT))
    turns = np.exp(1j * cloth.X[:, 0] / R)
    pins = [
        fc.Slide(lambda X: X[:, 1] < 1e-9, normal=(0, 0, 1), name="low"),
        fc.Slide(lambda X: X[:, 1] > HEIGHT - 1e-9, normal=(0, 0, 1), name="high"),
        fc.Slide(np.flatnonzero(end & (abs(turns.imag) < 1e-9)), normal=(0, 1, 0)),
        fc.Slide(np.flatnonzero(end & (abs(turns.real) < 1e-9)), normal=(1, 0, 0)),
    ]
    fabric = replace(FABRIC, poisson_ratio=NU)
    terms = [fc.StVK(), fc.Pressure(pressure), fc.StrainRateDamping(time=0.01)]
    system = fc.System(cloth, fabric, terms, pins=pins, seams=seams)
    return system, system.state(x)


@pytest.mark.parametrize(("element", "pieces"), [("P1", 1), ("P1", 2), ("P2", 2)])
def test_a_sewn_tube_under_pressure_has_its_radius_stress_and_reactions(element, pieces):
    """Hoop tension p r: S_xx = p R at a point and at the nodes, S_yy = ν S_xx is held at the ends.

    All with order 2. The nodes that follow have a stress of their own, from their own piece.
    """
    errors = []
    for n in (20, 40):
        h = 2 * np.pi * R / n
        system, start = tube_under_pressure(element, pieces, (h, 0.7 * h), PRESSURE)
        x = fc.equilibrium(system, start, tolerance=1e-10).x
        at = stress_at_point(system, (0.37 * R, 0.4 * HEIGHT))(x)[0]
        nodal = stress_at_nodes(system)(x)
        hoop = PRESSURE * R
        held = _held_forces(system, -system.force(system.state(x)))
        pull = 2 * np.pi * R * NU * hoop
        parts = [
            np.hypot(x[:, 0], x[:, 1]).mean() / (STRETCH * R),
            *at[:2] / (hoop, NU * hoop),
            *nodal[:, 0] / hoop,
            held["high"][2] / pull,
            -held["low"][2] / pull,
        ]
        deviations = np.abs(np.array(parts) - 1)
        errors.append([*deviations[:3], deviations[3:-2].max(), *deviations[-2:]])
    coarse, fine = np.array(errors)
    assert (fine < 0.01).all()
    assert (np.log2(coarse / fine) > 1.6).all()


@pytest.mark.filterwarnings("ignore::fecloth.FeclothWarning")
def test_the_energy_of_a_tube_that_is_blown_up_balances():
    h = 2 * np.pi * R / 16
    pressure = f"{PRESSURE} * smoothstep(0, 0.05, t)"
    system, start = tube_under_pressure("P1", 2, (h, 0.7 * h), pressure)
    result = fc.run(system, fc.ImplicitMidpoint(), start, dt=1e-3, t_end=0.1)
    stored = result.energies["StVK"][-1]
    strain = (STRETCH**2 - 1) / 2
    area = 2 * np.pi * R * HEIGHT
    assert stored == pytest.approx(area * 0.5 * 1000.0 / (1 - NU**2) * strain**2, rel=0.02)
    assert np.abs(result.energies["remainder"]).max() < 1e-3 * stored


def sector(angle: float, n: int) -> fc.Cloth:
    """A sector from a radius of 0.05 to 0.2 m with edges "begin" and "end", symmetric to Y = 0."""
    sheet = fc.Cloth.rectangle(1.0, 3.0, h=1 / n, pattern="right")
    r, phi = 0.05 + 0.15 * sheet.X[:, 0], angle * (sheet.X[:, 1] / 3 - 0.5)
    X = np.column_stack([r * np.cos(phi), r * np.sin(phi)])
    sets = {"begin": sheet.nodes("bottom"), "end": sheet.nodes("top")}
    return fc.Cloth.from_arrays(X, sheet.triangles, sets=sets, renumber=False)


def test_a_sector_that_is_sewn_is_a_cone():
    """Of the angle α of the sector: sin φ = α/(2π). Its points keep their distances."""
    alpha = np.pi
    energies = []
    for n in (6, 12):
        cloth = sector(alpha, n)
        seam = fc.Seam("begin", "end")
        system = fc.System(cloth, replace(FABRIC, bending_rigidity=1e-6), [fc.StVK()], seams=[seam])
        r = np.linalg.norm(cloth.X, axis=1)
        turn = np.arctan2(cloth.X[:, 1], cloth.X[:, 0]) * 2 * np.pi / alpha
        sine = alpha / (2 * np.pi)
        height = -r * np.sqrt(1 - sine**2)
        x = np.column_stack([r * sine * np.cos(turn), r * sine * np.sin(turn), height])
        assert np.abs(system.constraints.followers.gap(x)).max() < 1e-15
        assert len(system.constraints.followers.nodes) == n + 1
        energies.append(system.energies(system.state(x))["StVK"])
    # strains of chords are of order h²
    assert np.log2(energies[0] / energies[1]) == pytest.approx(4.0, abs=0.3)


@pytest.mark.filterwarnings("ignore::fecloth.FeclothWarning")
@pytest.mark.parametrize("h", [(0.05, 0.05), (0.05, 0.04)], ids=["matching", "not matching"])
def test_a_cushion_with_gas_keeps_its_balances(h):
    """p V^γ stays, the energies balance, and no force is left over: the surface is closed."""
    front, back = (fc.Cloth.rectangle(0.4, 0.4, h=size) for size in h)
    cloth = fc.Cloth.join([front, back], names=["front", "back"])
    X, Y = cloth.X.T
    is_front = np.isin(np.arange(len(X)), cloth.nodes("front"))
    dome = 0.04 * X * (0.4 - X) * Y * (0.4 - Y) / 0.04**2
    x = np.column_stack([X, np.where(is_front, Y, 0.4 - Y), np.where(is_front, dome, -dome)])
    seams = [
        fc.Seam("front.left", "back.left", reverse=True),
        fc.Seam("front.right", "back.right", reverse=True),
        fc.Seam("front.bottom", "back.top"),
        fc.Seam("front.top", "back.bottom"),
    ]
    volume = Enclosure.from_triangles(cloth.cells, len(x)).volume(x)
    gas = fc.Gas(pressure=102e3, volume=volume)
    terms = [fc.StVK(), gas, fc.StrainRateDamping(time=0.01)]
    system = fc.System(cloth, FABRIC, terms, seams=seams)
    result = fc.run(system, fc.ImplicitMidpoint(), system.state(x), dt=2e-4, t_end=0.02)
    bound = dict(system.named)["Gas"]
    V = bound.volume(result.state.x)
    assert 1.003 * volume < V
    f = np.zeros_like(x)
    bound.add_force(result.state.x, result.state.v, 0.0, f)
    largest = np.abs(f).sum()
    assert np.abs(f.sum(axis=0)).max() < (1e-12 if h[0] == h[1] else 1e-3) * largest
    moved = result.energies["kinetic"].max() + np.ptp(result.energies["Gas"])
    assert np.abs(result.energies["remainder"]).max() < 0.02 * moved
