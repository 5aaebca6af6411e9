"""Each threshold of a doubt, from both sides: at 0.8 and 1.25 times its value."""

import re
from functools import cache

import numpy as np
import pytest
from scipy.optimize import brentq
from support.planned import warnings_before

import fecloth as fc
from fecloth.simulation import dimensionless
from fecloth.simulation.doubts import course, jumps, pins, terms, units, unseen
from fecloth.simulation.doubts.signals import find_signals
from fecloth.simulation.within_step import LOADS
from fecloth.stability.lanczos_estimate import largest_rates, step_of_rates

CLOTH = fc.Cloth.rectangle(0.3, 0.2, h=0.1, pattern="right")
FABRIC = fc.Fabric(0.2, 500.0)
G = 9.81
UP = (0, 0, 1)
PULSE = "where((t > 0.61) and (t < 0.64), 1, 0)"
DT = 0.01


def bound(*given, fabric=FABRIC, cloth=CLOTH, pins=()):
    return fc.System(cloth, fabric, [fc.StVK(), *given], pins)


@cache
def limit():
    """The largest stable step of the cloth at rest."""
    return step_of_rates(largest_rates(bound(), bound().rest())[0] / 4, 0.0)


def fabric(density=0.2, stiffness=500.0, **more):
    given = fc.Fabric(density, stiffness, source="measured", **more)  # all, also what is not used
    return warnings_before(bound(fabric=given), DT)


def size(length):
    cloth = fc.Cloth.rectangle(length, length, h=length, pattern="right")
    return warnings_before(bound(cloth=cloth), DT)


def term(given):
    bent = fc.Fabric(0.2, 500.0, bending_rigidity=1e-5)
    return warnings_before(bound(given, fabric=bent), DT, doubts=[units.find_values_in_other_units])


def turned(angle):
    rotation = fc.Rotation((0, 0, 0), (1, 0, 0), angle)
    pins = [fc.Pin("left", rotate=rotation)]
    return warnings_before(bound(pins=pins), DT, doubts=[units.find_values_in_other_units])


def test_an_angle_with_pi_is_in_radians():
    assert turned("9 * pi * t") == []


def test_the_unit_that_was_meant_is_the_one_of_a_usual_size():
    for given, words in ((1000.0, "mm, write 1;"), (60.0, "cm, write 0.6;")):
        (told,) = size(given)
        assert f"If you meant {words}" in told
    for given, words in ((9810.0, "mm/s², write 9.81"), (981.0, "cm/s², write 9.81")):
        (told,) = term(fc.Gravity((0, 0, -given)))
        assert told.endswith(f"If you meant {words}")


# --- terms ----------------------------------------------------------------------------------------


def softer(f):
    def make(k):
        return fc.System(CLOTH, FABRIC, [fc.TensorCondition(k)], ["left"])

    return warnings_before(make(f * 1e-3 / terms._resistance(make(1.0))), DT)


def net(f):
    """A net whose resistance is by f/10 larger than that of the fabric, at most."""

    def tell(k):
        lattice = fc.Cloth.rectangle(0.8, 0.05 * 14 * 0.75**0.5, h=0.05, pattern="equilateral")
        given = fc.Fabric(0.2, 500.0, 1 / 3)
        system = fc.System(lattice, given, [fc.Springs(stiffness=k)], ["left"])
        return warnings_before(system, DT)

    (soft,) = tell(1.0)
    ratios = re.search("are (.*), (.*) and (.*) times", soft).groups()
    return tell((1 + f * 0.1) / max(map(float, ratios)))


def incompressible(f):
    given = fc.Fabric(0.2, 500.0, 0.5 - f * 0.05)
    return warnings_before(fc.System(CLOTH, given, [fc.NeoHookean()], ["left"]), DT)


def hinges(**constants):
    given = fc.Fabric(0.2, 500.0, bending_rigidity=1e-5, **constants)
    return warnings_before(bound(fc.HingeBending(), fabric=given), DT)


def gas(f):
    cloth = fc.Cloth.rectangle(0.2, 0.2, h=0.1, pattern="cross")
    wave = np.sin(np.pi * cloth.X[:, 0] / 0.2) * np.sin(np.pi * cloth.X[:, 1] / 0.2)
    dome = np.column_stack([cloth.X, 0.05 * wave])
    volume = fc.System(cloth, FABRIC, [fc.Gas(1e5, 1.0)]).bound[0].volume(dome)
    inflated = bound(fc.Gas(f * 0.5 * 101325, volume), cloth=cloth)
    return warnings_before(inflated, DT, state=inflated.state(dome))


# --- pins -----------------------------------------------------------------------------------------


def slide(f):
    along = f * 0.01
    motion = (f"{(1 - along**2) ** 0.5} * t", "0", f"{along} * t")
    return warnings_before(bound(pins=[fc.Slide("left", motion, direction=UP)]), DT)


def region(f):
    """A region around a node inside that covers the part f/4 of its edges of 0.1 m."""
    middle = CLOTH.X[np.argmin(np.linalg.norm(CLOTH.X - 0.1, axis=1))]

    def within(X):
        return np.linalg.norm(X - middle, axis=1) < f * 0.25 * 0.1

    return warnings_before(bound(pins=[fc.Pin(within)]), DT, doubts=[pins.find_idle_pins])


def corner(f):
    """A node of the border where it turns by f/2."""
    turn = f * 0.5
    X = [(0, 0), (-1, 0), (np.cos(turn), np.sin(turn)), (0, -1)]
    cloth = fc.Cloth.from_arrays(X, [(0, 1, 3), (0, 3, 2)])
    pin = fc.Pin(lambda X: np.linalg.norm(X, axis=1) < 1e-3)
    return warnings_before(bound(cloth=cloth, pins=[pin]), DT, doubts=[pins.find_idle_pins])


def door(sticks_out=6.0, turns=5.0):
    """A cloth of 0.3 m, so many bending lengths, whose weight turns it by this part."""
    rigidity = 0.2 * G * (0.3 / sticks_out) ** 3
    down = 2 * turns * 0.1  # the weight acts at half the width
    weight = fc.Gravity((0, G * (1 - down**2) ** 0.5, -G * down))
    given = fc.Fabric(0.2, 500.0, bending_rigidity=rigidity)
    held = bound(fc.HingeBending(), weight, fabric=given, pins=["left"])
    return warnings_before(held, DT, doubts=[pins.find_free_turn])


def zigzag(apart=1e-4, rough=None, nodes=9):
    """A held side whose nodes lie so many extents off their neighbours' mean, on a shallow arc."""
    cloth = fc.Cloth.rectangle(1.0, 1 / (nodes - 1), h=1 / (nodes - 1), pattern="right")
    held = bound(cloth=cloth, pins=["bottom"])
    side, x = cloth.nodes("bottom"), held.rest().x
    z = (-1.0) ** np.arange(nodes) * apart * cloth.extent / 2
    arc = (cloth.X[side, 0] - 0.5) ** 2

    def part(k):
        off = z + k * apart * arc
        off = off - np.polyval(np.polyfit(cloth.X[side, 0], off, 1), cloth.X[side, 0])
        return abs(off[1:-1] - (off[:-2] + off[2:]) / 2).max() / abs(off).max()

    if rough:
        z = z + brentq(lambda k: part(k) - rough, 0, 1000) * apart * arc
    x[side, 2] = z
    doubts = [pins.find_uneven_start]
    return warnings_before(held, DT, state=held.state(x), doubts=doubts)


def test_a_start_interpolated_from_another_mesh_is_said_to_miss_its_pins():
    """A held circle is off its plane between the nodes of the coarse mesh; formulas are smooth."""
    coarse = fc.Cloth.disk(1.0, 0.2)
    for element in ("P1", "P2"):
        fine = fc.Cloth.disk(1.0, 0.1, element=element)
        held = fc.System(fine, FABRIC, [fc.StVK()], ["boundary"])
        dome = np.column_stack([coarse.X, 0.1 * (1 - (coarse.X**2).sum(axis=1))])
        x = coarse.interpolator(fine.X) @ dome
        told = warnings_before(held, DT, state=held.state(x), doubts=[pins.find_uneven_start])
        assert len(told) == 1
        assert "pin 'boundary' holds its nodes where they start" in told[0]
        smooth = held.rest().x * [1.3, 0.7, 1]  # drawn by hand, and bent to a wave
        smooth[:, 2] = 0.3 * np.sin(4 * fine.X[:, 0] + fine.X[:, 1])
        x[fine.nodes("boundary")] = smooth[fine.nodes("boundary")]
        assert warnings_before(held, state=held.state(x), doubts=[pins.find_uneven_start]) == []


# --- motions and loads ----------------------------------------------------------------------------


def moved(z, **options):
    return bound(pins=[fc.Pin("left", ("0", "0", z), **options)])


def jump(f):
    held = moved(f"where(t < 0.1, 0, {f * 1e-6 * CLOTH.extent})")
    return warnings_before(held, DT, doubts=[jumps.find_motion_jumps])


def missed(share, dt):
    """Return the words about a load of which steps of `dt` miss this share."""

    def pressed(a):
        return bound(fc.Pressure(f"1 + {a} * sin(pi * t / {DT} + 0.3)"))

    def share_of(a):
        (signal,) = find_signals(pressed(a), bound().rest(), 1.0, is_fixed=True)
        return unseen.missed_share(signal, dt, signal.span)[0]

    a = brentq(lambda a: share_of(a) - share, 0.01, 3.0)
    return warnings_before(pressed(a), DT, doubts=[unseen.find_missed])


def fast(far, mean):
    """Return the words about a motion that oscillates in each step, by this mean beside a way."""
    held = moved(f"{far} + {mean * np.pi / 2} * sin(2 * pi * t / {DT})")
    return warnings_before(held, DT, doubts=[unseen.find_missed])


def pulses(given, **options):
    doubts = [unseen.find_short_pulses]
    return warnings_before(given, method=fc.Auto(**options), t_end=2.0, doubts=doubts)


def pressed(p, **options):
    return pulses(bound(fc.Pressure(p)), **options)


def beside_a_lasting_load(f):
    """A load of f/10 for 0.6 of 2 s, beside a pulse."""
    lasting = "where(mod(t, 1) > 0.65 and mod(t, 1) < 0.95, 1, 0)"
    return pressed(f"{PULSE} + {f * 0.1} * {lasting}")


def longest(f):
    gap = np.diff([0.0, *LOADS, 1.0]).max()
    return pressed(PULSE, longest=0.03 / (gap * f))


# --- the course of the run ------------------------------------------------------------------------


def sliver(f):
    def triangle(height):
        return fc.Cloth.from_arrays([(0, 0), (1, 0), (0.5, height)], [(0, 1, 2)])

    height = brentq(lambda h: triangle(h).quality[0] - f * 0.3, 0.01, 0.8)
    return warnings_before(bound(cloth=triangle(height)), DT, doubts=[course.find_slivers])


def hanging(f):
    given = fc.Fabric(0.2, 0.2 * G * 0.3 / (f * 0.2))
    held = bound(fc.Gravity(), fabric=given, pins=["left"])
    return warnings_before(held, DT, doubts=[course.find_large_weight])


def resonant(f):
    dt = f * 20.0 * limit()
    return stepped(dt, course.find_fast_waves)


def damped(f):
    dt = 2 * 20.0 * limit()
    return stepped(dt, course.find_fast_waves, fc.MassDamping(2 * f * 0.01 / dt))


def stepped(dt, doubt, *given):
    return warnings_before(bound(*given), dt, method=fc.ImplicitMidpoint(), doubts=[doubt])


def swinging(f):
    rate = (G / 0.3) ** 0.5
    dt = brentq(lambda dt: dimensionless.swing_loss(rate * dt) - f * 0.1, 1e-6, 1.0)
    held = bound(fc.Gravity(), pins=["left"])
    doubts = [course.find_numerical_damping]
    return warnings_before(held, dt, method=fc.BackwardEuler(), doubts=doubts)


def wrinkled(compressed=0.5, rough=0.9, angle=0.1, height=1.0):
    doubt = course.doubt_wrinkles(bound(), compressed, rough, angle, height)
    return [str(doubt)] if doubt else []


ABOVE = {  # the words about a quantity of f times its threshold, which are there for f > 1
    "a heavy fabric": lambda f: fabric(density=f * 5.0),
    "a stiff fabric": lambda f: fabric(stiffness=f * 1e7),
    "a board": lambda f: fabric(bending_rigidity=0.2 * G * (f * 0.25) ** 3),
    "gf·cm/cm": lambda f: fabric(bending_rigidity=1e-5, bending_hysteresis=f * 2 * 500.0 * 1e-5),
    "a large cloth": lambda f: size(f * 10.0),
    "a long step": lambda f: warnings_before(bound(), f * 0.1),
    "large gravity": lambda f: term(fc.Gravity((0, 0, -f * 50.0))),
    "an angle in degrees": lambda f: turned(f"{f * 2 * np.pi} * t"),
    "a fast wind": lambda f: term(fc.Wind((f * 100.0, 0, 0), 0.7)),
    "long damping of strain": lambda f: term(fc.StrainRateDamping(f * 1.0)),
    "long damping of bending": lambda f: term(fc.BendingDamping(f * 1.0, law=fc.HingeBending())),
    "another net": net,
    "another Poisson ratio": incompressible,
    "bending of another Poisson ratio": lambda f: hinges(bending_poisson_ratio=-1 / 3 + f * 0.1),
    "another bias rigidity": lambda f: hinges(bias_rigidity=1e-5 * (1 + f * 0.25)),
    "a motion along a slide": slide,
    "a region that reaches another node": region,
    "a weight that turns": lambda f: door(turns=f),
    "held nodes beside their line": lambda f: zigzag(f * 1e-6),
    "held nodes rougher than an arc": lambda f: zigzag(rough=f * 0.5),
    "a side of several nodes": lambda f: zigzag(nodes=round(f * 6)),
    "a jump": jump,
    "a load between steps": lambda f: missed(f * 0.25, DT),
    "an oscillation beside a way": lambda f: fast("10 * t", f * 1e-3 * 10.0),
    "an oscillation far away": lambda f: fast("1e3", f * 1e-9 * 1e3),
    "a pulse beside a load": lambda f: pressed(f"{1 / (f * 0.05) - 1} + {PULSE}"),
    "a pulse beside a way": lambda f: pulses(moved(f"10 * t + {f * 1e-3 * 20.0} * {PULSE}")),
    "a heavy cloth": hanging,
    "steps beyond fast waves": resonant,
    "a damped swing": swinging,
    "a compressed cloth": lambda f: wrinkled(compressed=f * 0.2),
    "folds as fine as the mesh": lambda f: wrinkled(rough=f * 0.65),
    "folds beside the motion": lambda f: wrinkled(height=f * 0.012),
    "shallow folds beside the motion": lambda f: wrinkled(angle=0.04, height=f * 0.03),
    "folds that are not shallow": lambda f: wrinkled(angle=f * 0.05, height=0.02),
}
BELOW = {  # the same, for f < 1
    "a light fabric": lambda f: fabric(density=f * 0.004),
    "a soft fabric": lambda f: fabric(stiffness=f * 10.0),
    "a small cloth": lambda f: size(f * 0.002),
    "a zigzag that is meant": lambda f: zigzag(f * 3e-3),
    "no membrane": softer,
    "an empty gas": gas,
    "a straight border": corner,
    "a short door": lambda f: door(sticks_out=f * 12.0),
    "a pulse beside a lasting load": beside_a_lasting_load,
    "a rare train of pulses": lambda f: pressed(
        f"where(mod(t + 0.1, 0.2) < {0.2 * f * 0.25}, 20, 0)"
    ),
    "a pulse shorter than a step": longest,
    "a sliver": sliver,
    "waves with little damping": damped,
    "steps shorter than explicit ones": lambda f: stepped(
        f * 0.01 * limit(), course.find_short_steps
    ),
}
CASES = [(*case, True) for case in ABOVE.items()] + [(*case, False) for case in BELOW.items()]


@pytest.mark.parametrize(("name", "tell", "is_above"), CASES, ids=[case[0] for case in CASES])
def test_a_doubt_begins_at_its_threshold(name, tell, is_above):
    assert len(tell(1.25 if is_above else 0.8)) == 1
    assert tell(0.8 if is_above else 1.25) == []


@pytest.mark.parametrize(("f", "halved"), [(0.8, 1), (1.25, 2)])
def test_a_remedy_misses_little(f, halved):
    """Half of dt is proposed if it misses less than MISSED_BY_REMEDY, else a quarter."""
    (words,) = missed(f * 0.12, DT / 2)
    assert f"take dt <= {DT / 2**halved:.2g} s" in words
