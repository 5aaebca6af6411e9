"""Each set-up that cannot be meant is warned of, and its remedy ends the warning."""

import re
import warnings

import numpy as np
import pytest
from support.planned import warnings_before

import fecloth as fc
from fecloth.simulation.doubts.before_run import OF_RUNS
from fecloth.simulation.doubts.pins import find_free_fall, find_free_turn, rotation_about_pins

CLOTH = {name: fc.Cloth.rectangle(0.3, 0.2, h=0.05, pattern=name) for name in ("right", "cross")}
FABRIC = {"areal_density": 0.2, "tensile_stiffness": 500.0, "poisson_ratio": 0.0}
STIFF = FABRIC | {"bending_rigidity": 2e-4}
BASE = {"terms": (fc.StVK(), fc.Gravity()), "pins": (fc.Pin("left"),), "fabric": FABRIC}
BENT = BASE | {"terms": (fc.StVK(), fc.HingeBending(), fc.Gravity()), "fabric": STIFF}
SHEET = BASE | {"fabric": STIFF | {"bending_poisson_ratio": 0.3}}
BIAS = BASE | {"fabric": STIFF | {"bending_rigidity": (1e-4, 4e-4), "bias_rigidity": 5e-4}}
DAMPED = BASE | {"fabric": STIFF, "pins": (fc.Pin("left", clamp=True),)}
DAMPING = fc.BendingDamping(0.01, law=fc.PlateBending())
UP = (0, 0, 1)
INSIDE = int(np.argmin(np.linalg.norm(CLOTH["right"].X - 0.1, axis=1)))


def dome(cloth):
    wave = np.sin(np.pi * cloth.X[:, 0] / 0.3) * np.sin(np.pi * cloth.X[:, 1] / 0.2)
    return np.column_stack([cloth.X, 0.1 * wave])


def terms(*given):
    return BASE | {"terms": given}


def pin(*given, **more):
    return BASE | {"pins": (fc.Pin(*given, **more),)}


def slide(motion, **more):
    return BASE | {"pins": (fc.Slide("left", motion, **more),)}


def bent(*pins, **more):
    return BENT | {"pins": pins} | more


def gas(pressure):
    return terms(fc.StVK(), fc.Gas(pressure, volume=0.0024)) | {"start": dome}


def within(x, y):
    return lambda X: (X[:, 0] < x) & (X[:, 1] < y)


def rubs(bending):
    """A scene with friction inside the fabric beside a bending term."""
    fabric = STIFF | {"bending_rigidity": 1e-6, "bending_hysteresis": 1e-5}
    return terms(fc.StVK(), *bending, fc.BendingFriction(), fc.Gravity()) | {"fabric": fabric}


CASES = [  # the words of the warning, the wrong set-up, and the right one by the remedy
    (
        r"no membrane is among the terms \(HingeBending, Gravity\).* 0 % of .*; add StVK",
        BENT | {"terms": (fc.HingeBending(), fc.Gravity()), "pins": ()},
        BENT | {"terms": (fc.HingeBending(), fc.Gravity(), fc.StVK()), "pins": ()},
    ),
    (
        "BendingFriction acts on the curvature of a plate, and PlateBending is not among the terms",
        rubs([fc.HingeBending()]),
        rubs([fc.PlateBending()]),
    ),
    ("take PlateBending, and leave out other bending terms", rubs([]), rubs([fc.PlateBending()])),
    (
        r"no membrane is among the terms \(Gravity, Pressure, MassDamping\)",
        terms(fc.Gravity(), fc.Pressure(5.0), fc.MassDamping(1.0)),
        terms(fc.Gravity(), fc.Pressure(5.0), fc.MassDamping(1.0), fc.TensorCondition(500.0)),
    ),
    (
        r"the Springs are 1\.25, 1\.25 and 0\.5 times as stiff as the fabric .* StVK",
        terms(fc.Springs("van_gelder"), fc.Gravity()),
        terms(fc.Springs("biquadratic"), fc.Gravity()),
    ),
    (
        r"the Springs are .*, .* and 0 times as stiff",
        terms(fc.Springs(shear=0.0), fc.Gravity()),
        terms(fc.StVK(), fc.Gravity()),
    ),
    (
        "Gravity stands 2 times among the terms, and their forces add up; leave one out",
        terms(fc.StVK(), fc.Gravity(), fc.Gravity((0, 0, -1.0))),
        terms(fc.StVK(), fc.Gravity((0, 0, -10.81))),
    ),
    ("StVK stands 3 times", terms(fc.StVK(), fc.StVK(), fc.StVK()), terms(fc.StVK())),
    (
        "PointForce stands 2 times",
        terms(fc.StVK(), fc.PointForce([0], (0, 0, 1)), fc.PointForce([0], (0, 0, 1))),
        terms(fc.StVK(), fc.PointForce([0], (0, 0, 1)), fc.PointForce("corners", (0, 0, 1))),
    ),
    (
        "PointForce gives each of .* nodes of an edge the same force.*EdgeForce",
        terms(fc.StVK(), fc.PointForce("right", (0, 0, 1))),
        terms(fc.StVK(), fc.EdgeForce("right", (0, 0, 1)), fc.PointForce("corners", (0, 0, 1))),
    ),
    (
        r"pin 'left' holds to the end of the run, .*, as until = 500 s is not before it",
        pin("left", until=500.0),
        pin("left", until=1e-4),
    ),
    (
        r"formula of Obstacle has the slope 100 at its surface.* from 0.01 mm on.* divide .* 100",
        terms(fc.StVK(), fc.Obstacle(fc.shapes.Sdf("100*(sqrt(x**2+y**2+(z+1)**2)-0.5)", 0.5))),
        terms(fc.StVK(), fc.Obstacle(fc.shapes.Sdf("x**2 + y**2 + (z+1)**2 - 0.5**2", 0.5))),
    ),
    (
        "Obstacle stands 2 times",
        terms(fc.StVK(), *2 * [fc.Obstacle(fc.shapes.Sphere((0, 0, -1), 0.5))]),
        terms(fc.StVK(), *(fc.Obstacle(fc.shapes.Sphere((x, 0, -1), 0.5)) for x in (0, 1))),
    ),
    (
        r"2 membranes act at once \(StVK, NeoHookean\), and their forces add up; leave",
        terms(fc.StVK(), fc.NeoHookean()),
        terms(fc.NeoHookean()),
    ),
    (
        r"2 bending terms act at once \(HingeBending, QuadraticBending\)",
        BENT | {"terms": (fc.StVK(), fc.HingeBending(), fc.QuadraticBending())},
        BENT | {"terms": (fc.StVK(), fc.QuadraticBending())},
    ),
    (
        r"2 drag terms act at once \(Drag, Wind\)",
        terms(fc.StVK(), fc.Drag(0.7), fc.Wind((5.0, 0.0, 0.0), 0.7)),
        terms(fc.StVK(), fc.Wind((5.0, 0.0, 0.0), 0.7)),
    ),
    (
        r"poisson_ratio = 0\.3 has no effect: NeoHookean is incompressible, with 0\.5",
        terms(fc.NeoHookean()) | {"fabric": FABRIC | {"poisson_ratio": 0.3}},
        terms(fc.NeoHookean("compressible")) | {"fabric": FABRIC | {"poisson_ratio": 0.3}},
    ),
    (
        r"bending_poisson_ratio = 0\.3 has no effect: HingeBending .* of -1/3.* PlateBending",
        SHEET | {"terms": (fc.StVK(), fc.HingeBending())},
        SHEET | {"terms": (fc.StVK(), fc.PlateBending())},
    ),
    (
        r"bias_rigidity = 0\.0005 N m has no effect: QuadraticBending .* at 45° with 0\.000225 N m",
        BIAS | {"terms": (fc.StVK(), fc.QuadraticBending())},
        BIAS | {"terms": (fc.StVK(), fc.PlateBending())},
    ),
    (
        r"BendingDamping acts on hinges, .* not ω τ/2, but .*; give it law = PlateBending\(\)",
        DAMPED | {"terms": (fc.StVK(), fc.PlateBending(), fc.BendingDamping(0.01))},
        DAMPED | {"terms": (fc.StVK(), fc.PlateBending(), DAMPING)},
    ),
    (
        r"pin 'left': 100 % of its motion of 5 m lies along .* leave direction out",
        slide(["0", "0", "5 * t"], direction=UP),
        pin("left", ["0", "0", "5 * t"]),
    ),
    (
        r"pin 'left': 71 % of its motion of 0\.14\d* m .* leave normal out .* across itself",
        slide(["0.1 * t", "0", "0.1 * t"], normal=UP),
        slide(["0", "0", "0.1 * t"], normal=UP),
    ),
    (
        r"pin 'left': 100 % of its motion",
        slide(lambda t: np.array([0.0, np.sin(t), 0.0]), direction=(0, -2, 0)),
        slide(lambda t: np.array([0.0, np.sin(t), 0.0]), direction=(0, 0, -2)),
    ),
    (
        r"the Gas has 533 Pa at the start, 0\.53 % of the ambient 101325 Pa.* write 101825",
        gas(500.0),
        gas(101825.0),
    ),
    (
        r"pin 'pin0' holds one node only, at \(0, 0\) m.*: the next one is 0\.05 m away",
        pin(within(1e-9, 0.03)),
        pin(within(1e-9, 0.06)),
    ),
    (
        r"pin 'grip' holds one node only, at \(0\.15, 0\) m.* by its number, \d+, if",
        pin(lambda X: (abs(X[:, 0] - 0.15) < 0.01) & (X[:, 1] < 0.01), name="grip"),
        pin([3]),
    ),
    (
        r"the pins lie on a line, .* \(0\.3 m wide\), though .* over 0\.047 m; .* clamp = true",
        BENT,
        bent(fc.Pin("left", clamp=True), terms=(fc.StVK(), fc.PlateBending(), fc.Gravity())),
    ),
    (
        "the pins lie on a line",
        bent(fc.Pin("left", ["0", "0", "0.1 * t"]), fc.Slide("right", direction=UP)),
        bent(fc.Pin("left", ["0", "0", "0.1 * t"]), fc.Slide("right", normal=UP)),
    ),
    (
        "the pins lie on a line",
        bent(fc.Pin("bottom"), terms=(fc.StVK(), fc.QuadraticBending(), fc.Pressure(1.0))),
        bent(fc.Pin("boundary"), terms=(fc.StVK(), fc.QuadraticBending(), fc.Pressure(1.0))),
    ),
    (
        r"areal_density = 150 kg/m²: .* write 0\.15",
        BASE | {"fabric": FABRIC | {"areal_density": 150.0}},
        BASE | {"fabric": FABRIC | {"areal_density": 0.15}},
    ),
    (
        r"the cloth is 40 m long: few are longer than 10 m\. If you meant cm, write 0\.4",
        BASE | {"cloth": fc.Cloth.rectangle(40.0, 2.0, h=2.0, pattern="right")},
        BASE | {"cloth": fc.Cloth.rectangle(0.4, 0.02, h=0.02, pattern="right")},
    ),
    (
        r"the cloth is 0\.001 m long",
        BASE | {"cloth": fc.Cloth.rectangle(1e-3, 1e-3, h=1e-3, pattern="right")},
        BASE | {"cloth": fc.Cloth.rectangle(1.0, 1.0, h=1.0, pattern="right")},
    ),
    (r"dt = 5 s is large: .* write 0\.005", BASE | {"dt": 5.0}, BASE | {"dt": 0.005}),
    (
        r"Gravity has 981 m/s².* write 9\.81",
        terms(fc.StVK(), fc.Gravity((0, 0, -981))),
        terms(fc.StVK(), fc.Gravity((0, 0, -9.81))),
    ),
    (
        r"Gravity pulls up: .* write -9\.81",
        terms(fc.StVK(), fc.Gravity((0.0, 1.0, 9.81))),
        terms(fc.StVK(), fc.Gravity((0.0, 9.81, 1.0))),
    ),
    (
        r"Wind blows at 120 m/s.* write 33\.3",
        terms(fc.StVK(), fc.Wind((120.0, 0.0, 0.0), 0.7)),
        terms(fc.StVK(), fc.Wind((33.3, 0.0, 0.0), 0.7)),
    ),
    (
        r"StrainRateDamping has time = 10 s.* write 0\.01",
        terms(fc.StVK(), fc.StrainRateDamping(10.0)),
        terms(fc.StVK(), fc.StrainRateDamping(0.01)),
    ),
]


def find(cloth=CLOTH["right"], start=None, dt=0.01, terms=(), pins=(), fabric=None):
    system = fc.System(cloth, fc.Fabric(**fabric), terms, pins)
    state = system.state(start(cloth)) if start else system.rest()
    doubts = (*OF_RUNS, find_free_turn)
    return warnings_before(system, dt, max(1.0, 2 * dt), state=state, doubts=doubts)


@pytest.mark.parametrize(("words", "wrong", "right"), CASES)
def test_a_wrong_set_up_is_warned_of_and_its_remedy_is_not(words, wrong, right):
    (result,) = find(**wrong)
    assert re.search(words, result)
    assert find(**right) == []


HOLDS = (  # beside gravity; None is a pin
    *(None, fc.Drag(1.0), fc.MassDamping(1.0), fc.Tether("left", (0, 0, 0), 5.0)),
    *(fc.Obstacle(fc.shapes.Plane((0, 0, -1), UP)), fc.UserForce((0, 0, 1.0))),
)


def test_a_cloth_that_nothing_holds_falls_freely():
    def noted(*given, pins=()):
        system = fc.System(CLOTH["right"], fc.Fabric(**STIFF), given, pins)
        return warnings_before(system, 0.01, 1.0, doubts=[find_free_fall])

    inner = (fc.StVK(), fc.HingeBending(), fc.StrainRateDamping(0.01))
    (words,) = noted(*inner, fc.Gravity())
    assert words == "nothing holds the cloth, no pin, air or obstacle: it falls freely"
    assert noted(*inner) == []
    for held in HOLDS:
        more, pins = ((held,), ()) if held else ((), ("left",))
        assert noted(*inner, fc.Gravity(), *more, pins=pins) == []


SOUND = {
    "free fall": terms(fc.Gravity()) | {"pins": ()},
    "a net that is the fabric": {
        "cloth": fc.Cloth.rectangle(0.8, 0.05 * 14 * 0.75**0.5, h=0.05, pattern="equilateral"),
        "terms": [fc.Springs()],
        "fabric": FABRIC | {"poisson_ratio": 1 / 3},
    },
    "a tether on a cloth of springs": terms(
        fc.StVK(), *(fc.Tether(where, (0, 0, 0), 5.0) for where in ("left", "right"))
    ),
    "hinges of their own Poisson's ratio": BASE
    | {
        "terms": (fc.StVK(), fc.HingeBending()),
        "fabric": STIFF | {"bending_poisson_ratio": -0.33, "bias_rigidity": 2.4e-4},
    },
    "a corner": pin(within(1e-3, 1e-3)),
    "a node inside": pin(lambda X: np.linalg.norm(X - 0.1, axis=1) < 1e-3),
    "a predicate of all nodes": pin(lambda X: np.arange(len(X)) == INSIDE),
    "hangs from its line": BENT
    | {
        "start": lambda cloth: np.column_stack(
            [-0.01 * cloth.X[:, 0], cloth.X[:, 1], -cloth.X[:, 0]]
        )
    },
    "soft": bent(fc.Pin("left"), fabric=FABRIC | {"bending_rigidity": 1e-6}),
    "turns about one node": bent(fc.Pin([0])),
    "a vacuum around a gas": terms(fc.StVK(), fc.Gas(500.0, 0.0024, ambient=0.0)) | {"start": dome},
    "an elastic foundation": terms(fc.StVK(), fc.UserForce(("-10 * x", "-10 * y", "-10 * z"))),
}


@pytest.mark.parametrize("name", SOUND)
def test_no_warning_without_reason(name):
    assert find(**SOUND[name]) == []


def test_run_warns_in_python():
    system = fc.System(CLOTH["right"], fc.Fabric(150.0, 500.0), [fc.StVK()], ["left"])
    with pytest.warns(fc.FeclothWarning, match=r"write 0\.15"):
        fc.run(system, fc.BDF2(), system.rest(), dt=0.01, t_end=0.01)
    with warnings.catch_warnings(action="error"):
        system = fc.System(CLOTH["right"], fc.Fabric(**FABRIC), [fc.StVK()], ["left"])
        fc.run(system, fc.BDF2(), system.rest(), dt=0.01, t_end=0.01)


def test_the_free_rotation_is_rigid_and_leaves_the_pins():
    system = fc.System(CLOTH["cross"], fc.Fabric(**STIFF), [fc.StVK()], ["left"])
    x = dome(system.cloth) @ np.linalg.qr(np.random.default_rng(3).standard_normal((3, 3)))[0]
    motion = rotation_about_pins(system, x)
    left = system.cloth.nodes("left")
    axis = x[left[-1]] - x[left[0]]
    axis /= np.linalg.norm(axis)
    expected = np.cross(axis, x - x[left[0]])
    assert np.allclose(motion * np.sign(np.vdot(motion, expected)), expected, atol=1e-12)
    free = fc.System(system.cloth, system.fabric, [fc.StVK()])
    assert rotation_about_pins(free, x) is None
