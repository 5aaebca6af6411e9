"""Messages of wrong arguments: tables of calls and commands, and what they answer."""

import shutil
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from support import transcripts
from support.messages import message_test

import fecloth as fc
from fecloth.homogenisation import bending_tensor, strip_rigidity
from fecloth.integrators.protocol import MethodTraits
from fecloth.simulation.stability_limited import StabilityLimited
from fecloth.system.constraints import Constraints

NAN, INF = float("nan"), float("inf")
ISOTROPIC = fc.Fabric(areal_density=0.2, tensile_stiffness=1000.0, poisson_ratio=0.3)
ORTHOTROPIC = fc.Fabric(0.15, (2000.0, 900.0), 0.2, shear_stiffness=60.0)
BENDING = fc.Fabric(0.15, 1000.0, bending_rigidity=1e-5)
TURN = fc.Rotation((0, 0, 0), (0, 0, 1), "t")
SHEET = {"E": 2e5, "nu": 0.3, "thickness": 5e-4, "rho": 400.0}


@cache
def cloth(pattern="unstructured", element="P1"):
    return fc.Cloth.rectangle(1.0, 0.6, h=0.2, pattern=pattern, element=element)


def system(*terms, fabric=ISOTROPIC, pins=(), mesh=None, **options):
    return fc.System(mesh or cloth(), fabric, list(terms), list(pins), **options)


def force(*terms):
    """The force at rest, where a value is found out that was not known before."""
    bound = system(*terms)
    return bound.force(bound.rest())


def march(method=None, dt=0.01, bound=None, t_end=0.02, **options):
    bound = bound or system(fc.StVK())
    return next(fc.march(bound, method or fc.BDF2(), bound.rest(), dt, t_end, **options))


def modes(pins=(), **options):
    bound = system(fc.StVK(), pins=pins)
    return fc.modes(bound, bound.rest(), **options)


def equilibrium(**options):
    return fc.equilibrium(system(fc.StVK()), system(fc.StVK()).rest(), **options)


def condition(**changes):
    given = {"value": lambda y: y[:, 0, :2], "nodes": [[0, 1], [2, 3]], "stiffness": 1.0}
    return system(fc.Condition(**(given | changes)))


def many_steps(*terms, dt=1e-4, steps=1, threads=1, **options):
    bound = system(*terms, mesh=cloth("right"), **options)
    return fc.many_steps(bound, bound.rest(), dt, steps, threads=threads)


FABRIC = [
    (lambda: fc.Fabric(0.2, 700.0, NAN), "Fabric: poisson_ratio = nan"),
    (lambda: fc.Fabric(0.2, (1.0, 2.0, 3.0)), "tensile_stiffness = .1.0, 2.0, 3.0.: must be a num"),
    (lambda: fc.Fabric(0.2, 7.0, bending_rigidity=(1, 2, 3)), "bending_rigidity = .1, 2, 3.: must"),
    (lambda: fc.Fabric(0.2, (2000.0, 900.0), 0.2), "shear_stiffness is missing: an orthotropic"),
    *(
        (
            lambda t=tensile, nu=nu: fc.Fabric(0.2, t, nu, shear_stiffness=60.0),
            f"poisson_ratio = {nu}: must lie between {limit}",
        )
        for tensile, nu, limit in (
            ((2000.0, 500.0), 2.0, "-2 and 2"),
            ((500.0, 2000.0), 0.5, "-0.5 and 0.5"),
            ((500.0, 2000.0), -0.6, "-0.5 and 0.5"),
            (700.0, 1.0, "-1 and 1"),
            (700.0, -1.0, "-1 and 1"),
        )
    ),
    *(
        (lambda k=key, v=bad: fc.Fabric.sheet(**(SHEET | {k: v})), f"Fabric.sheet: {key} = {bad}")
        for key, values in (
            *((key, (0.0, -1.0, NAN, INF)) for key in ("E", "thickness", "rho")),
            ("nu", (-1.0, 0.51, NAN, INF)),
        )
        for bad in values
    ),
    (lambda: fc.Fabric.preset("denim"), r"preset = 'denim': must be one of silk, .*'denim-"),
    (lambda: fc.Fabric("150 g", 1000.0), "Fabric: areal_density = '150 g': must be a number"),
    (lambda: fc.Fabric("0.15", 1000.0), "areal_density = '0.15': must be a finite number > 0"),
]

MESH = [
    (lambda: cloth().nodes([True, False]), "must be the name of a set, indices, or .* booleans"),
    (lambda: cloth().nodes([0.5, 1.5]), "must be the name of a set, indices"),
    (lambda: cloth().nodes([None]), "must be the name of a set, indices"),
    (lambda: cloth().nodes([["left"]]), "must be the name of a set, indices"),
    (lambda: cloth().mass("diagonal"), "Cloth.mass: mass = 'diagonal': must be \"lumped\""),
    (lambda: cloth().l2_norm(np.ones(3)), r"must be \(\d+,\) or \(\d+, d\)"),
    (lambda: cloth().interpolate(np.ones(2), [(0.1, 0.1)]), "nodal field"),
    (lambda: cloth().interpolate(cloth().X, [(0.5, 0.3), (1.5, 0.3)]), "1 of 2 .* must lie on the"),
    (
        lambda: cloth().interpolate(cloth().X, [(NAN, 0.0)]),
        r"\[0\] = \[nan, 0.0\]: must be",
    ),
    (lambda: cloth().region(lambda X: X[:, 0] > 2), "no triangle is selected"),
    (lambda: fc.Cloth.disk(1.0, 0.5, element="P3"), "element = 'P3': must be one of P1, P2"),
    (lambda: bending_tensor("rigth"), "Did you mean 'right'"),
    (lambda: strip_rigidity("righ", 2), "Did you mean 'right'"),
    *(
        (
            lambda term=term: system(fc.StVK(), term, mesh=cloth(element="P2"), mass="consistent"),
            rf"System: {type(term).__name__} on element P2: must be on P1. Leave .* = 'P1'",
        )
        for term in (
            fc.HingeBending(),
            fc.QuadraticBending(),
            fc.BaraffWitkin(),
            fc.Springs(),
            fc.Drag(2.0),
            fc.Wind((1, 0, 0), 2.0),
            fc.Gas(3.0, volume=1.0),
        )
    ),
]

TERMS = [
    (
        lambda: system(fc.HingeBending()),
        "the fabric has no bending_rigidity.*Give it in the fabric",
    ),
    (lambda: system(fc.BendingDamping(0.1)), "the fabric has no bending_rigidity.*Give it"),
    (lambda: system(fc.QuadraticBending()), "QuadraticBending: the fabric has no bending_rigidity"),
    (lambda: fc.HingeBending(4.0), "rest = 4.0"),
    (lambda: fc.HingeBending("flat"), "rest = 'flat'"),
    (
        lambda: system(fc.HingeBending((0.0, 0.1, 0.2)), fabric=BENDING),
        "rest has 3 angles.*one for each hinge",
    ),
    (lambda: fc.BendingDamping(0.0), "time = 0.0"),
    (lambda: fc.BendingDamping(1.0, tangent="x"), "exact"),
    (lambda: condition(nodes=[0, 1]), "a list of one list"),
    (lambda: condition(nodes=[[0, 10**6]]), "node indices 0 … 1000000"),
    (lambda: condition(nodes=[[0, 1], [2, 2]]), "not hold a node twice"),
    (lambda: condition(stiffness=-1.0), "stiffness = -1.0"),
    (lambda: condition(stiffness=0.0), "one must be > 0"),
    (lambda: condition(stiffness=np.ones(5)), r"must be numbers, \(2,\) or \(2, 2\)"),
    (lambda: condition(value=lambda y: np.zeros(7)), r"value\(y\) of shape \(7,\)"),
    (lambda: condition(value=lambda y: np.full(len(y), NAN)), "must be finite"),
    (lambda: condition(gradient=lambda y: y), r"gradient\(y\) of shape \(2, 2, 3\)"),
    (lambda: condition(tangent="none"), 'must be "symmetric" or "exact"'),
    (lambda: condition(value="y"), "value = 'y': must be a function"),
    *(
        (lambda name=name: condition(name=name), f"name = '{name}': must be letters")
        for name in ("kinetic", "remainder", "pins", "dissipated:Drag", "a,b")
    ),
    (lambda: fc.StrainRateDamping(-1.0), "time = -1.0"),
    (lambda: fc.StrainRateDamping(1.0, tangent="x"), "exact"),
    (lambda: fc.StrainRateDamping(1.0, law=3), "law = 3"),
    *(
        (lambda r=rate: fc.MassDamping(r), f"MassDamping: rate = {rate}: must be finite and > 0")
        for rate in (0.0, -1.0, NAN, INF)
    ),
    (lambda: fc.Drag(-1.0), "Drag: normal = -1.0: must be finite and >= 0"),
    (lambda: fc.Drag(0.0), "normal = tangential = 0"),
    (lambda: fc.Drag(1.0, law="cubic"), 'law = \'cubic\': must be "quadratic" or "linear"'),
    (lambda: fc.Drag(1.0, tangent="x"), 'tangent = \'x\': must be "symmetric" or "exact"'),
    (lambda: fc.Drag("2 Pa s/m"), "Drag: normal = '2 Pa s/m': must be .* kg/m\\^3"),
    (lambda: fc.Wind((1.0, 2.0), 1.0), r"Wind: velocity = \(1.0, 2.0\): must be three"),
    (lambda: fc.Wind("x", 1.0), "velocity = .*'x'.*: must be three"),
    (lambda: fc.Wind((1.0, NAN, 0.0), 1.0), "velocity = .*nan.*: must be three"),
    (lambda: fc.Wind((1.0, "q", 0.0), 1.0), "formula 'q', unknown name 'q'"),
    (lambda: fc.Wind((1, 0, 0), 1.0, gusts=-0.1), "gusts = -0.1: must be in 0 … 2"),
    (lambda: fc.Wind((1, 0, 0), 1.0, gusts=0.1, gust_length=0.0), "gust_length = 0.0"),
    (lambda: fc.Wind((1, 0, 0), 1.0, gusts=0.1, seed=-1), "seed = -1: must be in"),
    (lambda: fc.Wind((1, "t", 0), 1.0, gusts=0.1), "gusts of a wind that is not uniform"),
    (lambda: force(fc.Wind(lambda x, t: x[:, :2], 1.0)), r"velocity of shape .* at t = 0: must be"),
    (lambda: fc.PointForce("left", (1.0, 2.0)), "PointForce: force = .*: must be three numbers"),
    (lambda: fc.PointForce("left", ("x", 0, 0)), "PointForce: force: formula 'x', unknown name"),
    (lambda: fc.PointForce("left", (INF, 0, 0)), "force = inf: must be a finite number"),
    (lambda: system(fc.PointForce("lft", (0, 0, 1))), "node set 'lft'"),
    (lambda: system(fc.PointForce((0.5, 0.5, 0.5), (0, 0, 1))), "must be two finite numbers"),
    (lambda: system(fc.PointForce((5.0, 0.5), (0, 0, 1))), "5.*must lie on the cloth"),
    (lambda: fc.UserForce("x"), "UserForce: force = 'x': must be three finite"),
    (lambda: fc.UserForce((1.0, NAN, 0.0)), "UserForce: force = .*nan"),
    (lambda: fc.UserForce(("__import__('os')", 0, 0)), "unknown function"),
    (
        lambda: fc.UserForce((0, 0, 0), per="edge"),
        'per = \'edge\': must be "area", "mass" or "node"',
    ),
    (lambda: fc.UserForce((0, 0, 0), tangent="x"), "tangent = 'x'"),
    (lambda: force(fc.UserForce(lambda x, v, t: x[:, :2])), "force of shape .* at t = 0: must be"),
    (lambda: force(fc.UserForce(lambda x, v, t: x / 0.0 * x)), "force of shape"),
    (lambda: force(fc.UserForce(("1 / t", 0, 0))), "formula '1 / t' is inf at"),
    *(
        (lambda p=pressure, e=more: fc.Gas(p, **({"volume": 1.0} | e)), message)
        for pressure, more, message in (
            (0.0, {}, "pressure = 0.0: must be finite and > 0"),
            (1.0, {"volume": NAN}, "volume = nan"),
            (1.0, {"ambient": -1.0}, "ambient = -1.0"),
            (1.0, {"exponent": 0.0}, "exponent = 0.0"),
            (1.0, {"origin": (0.0, 1.0)}, "origin"),
        )
    ),
    *(
        (lambda g=bad: fc.Gravity(g), "Gravity: acceleration = .*: must be three finite")
        for bad in (9.81, (0.0, -9.81), (0.0, NAN, 0.0), (0.0, 0.0, INF))
    ),
    (lambda: fc.Pressure(NAN), "pressure = nan: must be a finite number, a formula"),
    (lambda: fc.Pressure("3 * x"), "pressure: formula '3 \\* x', unknown name 'x'"),
    (lambda: fc.Pressure(True), "pressure = True"),
    (lambda: fc.Pressure(1.0, "x"), 'tangent = \'x\': must be "symmetric" or "exact"'),
    (
        lambda: fc.Pressure("5 mbr"),
        "pressure = '5 mbr'.*or a formula. Did you mean 'mbar'",
    ),
    (lambda: force(fc.Pressure(lambda t: 1 / t if t else INF)), r"Pressure: pressure\(0\) = .*inf"),
    (lambda: fc.BaraffWitkin(area_exponent=1.0), "needs both"),
    (lambda: fc.BaraffWitkin(stretch=(1.0, -2.0)), "two numbers >= 0"),
    (lambda: fc.BaraffWitkin(rest=(1.0,)), "two numbers"),
    (lambda: fc.BaraffWitkin(damping=-1.0), "damping = -1.0"),
    (lambda: fc.BaraffWitkin(tangent="published"), 'must be "symmetric" or "exact"'),
    (lambda: fc.NeoHookean("other"), "kind = 'other'"),
    (lambda: fc.NeoHookean(mu=0.0), "mu = 0.0"),
    (lambda: fc.NeoHookean("compressible", mu=1.0, lam=-1.0), "lam = -1.0"),
    (lambda: fc.NeoHookean("compressible", mu=1.0), "give both or neither"),
    (lambda: fc.NeoHookean(mu=1.0, lam=1.0), "lam is given"),
    (lambda: system(fc.NeoHookean(), fabric=ORTHOTROPIC), "law is isotropic"),
    (
        lambda: system(fc.NeoHookean(), fabric=fc.Fabric(0.2, 900.0, 0.3, 10.0)),
        "shear_stiffness = 10.0: must be",
    ),
    (
        lambda: system(fc.NeoHookean("compressible"), fabric=fc.Fabric(0.2, 900.0, -0.2)),
        "poisson_ratio = -0.2",
    ),
    (
        lambda: system(fc.TensionField(), fabric=ORTHOTROPIC),
        r"tensile_stiffness = \(2000.0, 900.0\)",
    ),
    (lambda: fc.Springs("cable"), "van_gelder"),
    (lambda: fc.Springs(stiffness=-1.0), "stiffness = -1.0"),
    (lambda: fc.Springs("van_gelder", stiffness=3.0), "Leave it out"),
    (lambda: fc.Springs(damping=NAN), r"damping = nan: must be >= 0 \[s\]"),
    (lambda: fc.Springs(tangent="x"), 'must be "symmetric" or "exact"'),
    *(
        (lambda args=args: system(fc.Tether(*args)), message)
        for args, message in (
            (("left", (0, 0), 1.0), "point"),
            (("left", (0, 0, "y"), 1.0), "point"),
            (("left", (0, 0, 0), 0.0), "stiffness = 0.0"),
            (("left", (0, 0, 0), 1.0, -1.0), "damping = -1.0"),
            (("nowhere", (0, 0, 0), 1.0), "nowhere"),
            (("left", lambda t: np.zeros(2), 1.0), "point"),
        )
    ),
]

SYSTEM = [
    (lambda: fc.System(ISOTROPIC, cloth(), []), "cloth = a Fabric: must be such as Cloth.rect"),
    (lambda: fc.System(None, ISOTROPIC, []), "cloth = None: must be such as Cloth.rectangle"),
    (
        lambda: fc.Cloth.from_arrays(
            cloth().X, cloth().triangles, sets={"top": cloth().X[:, 1] > 0}
        ),
        r"set 'top' .* type bool: must be integers.* np\.flatnonzero\(mask\)",
    ),
    *(
        (lambda term=term: system(fc.StVK(), term), rf"System\(terms=...\): term {term!r}: must be")
        for term in (3, "StVK", None)
    ),
    (lambda: system(fc.StVK), r"System\(terms=...\): term <class"),
    (lambda: fc.System(cloth(), ISOTROPIC, fc.StVK()), r"must be a list, as in \[StVK\(\)\]"),
    (lambda: fc.System(cloth(), ISOTROPIC, [], pins="left"), "pins = 'left': must be a list"),
    (lambda: system(pins=[3]), "pin 3: must be such as Pin"),
    (lambda: system(object()), r"term <.*: must be such as StVK\(\) with a method `bind`"),
    (lambda: system(pins=["lft"]), "node set 'lft'.* Did you mean 'left'"),
    (lambda: system(pins=[fc.Pin("lft")]), "node set 'lft'.* Did you mean 'left'"),
    (lambda: system(pins=[fc.Pin(lambda X: X[:, 0] > 9)]), "no node is selected"),
    (
        lambda: system(pins=["left", fc.Slide("bottom", normal=(0, 1, 0))]),
        r"pins 'left' and 'bottom' both hold node \d+ at \(0, 0\) m: .* "
        r"without = \"left\" in the pin 'bottom', or without = \"bottom\" in the pin 'left'",
    ),
    (
        lambda: system(pins=["left", fc.Pin("top", ["0", "0", "t"], name="grip")]),
        "pins 'left' and 'grip' both hold node .* without = \"left\" in the pin 'grip'",
    ),
    (lambda: system(pins=[fc.Pin("left", without="boundary")]), "no node is left by without"),
    (lambda: system(pins=[fc.Pin("left", without="tpo")]), "node set 'tpo'.* Did you mean 'top'"),
    (lambda: system(mass="diagonal"), "mass = 'diagonal'"),
    (lambda: system().state(system().rest().x, t=NAN), r"t = nan: must be finite"),
    (lambda: fc.Pin("left", velocity=lambda t: [0.0, 0.0, 0.0]), "velocity without a motion"),
    (lambda: fc.Pin("left", lambda t: [0, 0, t], velocity=3), "velocity = 3: must be a function"),
    (
        lambda: Constraints.bind([fc.Pin([1, 2, 3], lambda t: np.zeros((2, 3)))], cloth()),
        r"motion of shape \(2, 3\): must be \(3,\) or \(3, 3\)",
    ),
    (
        lambda: fc.Pin("left", lambda t: (0, 0, "a")).displacement(0.5),
        r"Pin\('left'\): motion\(0.5\): .*could not convert",
    ),
    (lambda: fc.Pin("left", lambda: 0).displacement(0.5), r"motion\(0.5\): .*argument"),
    *(
        (lambda m=motion: fc.Pin("left", m), rf"Pin\('left'\): {message}")
        for motion, message in (
            ("0.1*t", r"motion = '0.1\*t': must be three formulas of t, or a function of t"),
            (["t", "t"], r"motion = \['t', 't'\]: must be three formulas"),
            (3.0, "motion = 3.0: must be three formulas"),
            (["t", None, "t"], "motion = .*: must be three formulas"),
            (["t", NAN, "t"], "motion = .*: must be three formulas"),
            (["t", "0", "q"], "formula 'q', unknown name 'q'"),
        )
    ),
    *(
        (lambda v=value, n=name: motion_at(n, v), rf"{name}\(0.5\) = .*: must be three")
        for name in ("motion", "velocity")
        for value in ([1.0, 2.0], 3.0, [0.0, NAN, 0.0], np.zeros((1, 1, 3)))
    ),
    *(
        (lambda a=arguments: fc.Slide("left", **a), message)
        for arguments, message in (
            ({}, r"Slide\('left'\): neither of direction and normal: needs one"),
            ({"direction": (1, 0, 0), "normal": (0, 1, 0)}, "both of direction and normal"),
            ({"direction": (0, 0, 0)}, r"direction = \(0, 0, 0\): must not be zero"),
            ({"normal": (0.0, NAN, 1.0)}, "normal = .*: must be three finite numbers"),
            ({"normal": (0.0, 1.0)}, "normal = .*: must be three finite numbers"),
            ({"normal": "z"}, "normal = 'z': must be three finite numbers"),
            ({"normal": (0, 0, 1), "clamp": True}, "clamp and normal are given: exclude each oth"),
            (
                {"direction": (0, 0, 1), "rotate": TURN},
                r"Slide\('left'\): rotate and direction are",
            ),
        )
    ),
    *(
        (
            lambda angle=angle: fc.Rotation((0, 0, 0), (0, 0, 1), angle),
            "must depend on t: only chan",
        )
        for angle in (1.5, "pi / 2")
    ),
]


def motion_at(name, value):
    pin = fc.Pin("left", **({"motion": lambda t: np.zeros(3)} | {name: lambda t: value}))
    return pin.displacement(0.5) + pin.speed(0.5)


METHODS = [
    (lambda: fc.Newmark(beta=0.0), r"beta = 0.0: must be > 0.*CentralDifference"),
    (lambda: fc.Newmark(gamma=0.4), r"gamma = 0.4: must be >= 0.5"),
    (lambda: fc.Newmark(gamma=NAN), r"gamma = nan: must be >= 0.5"),
    (lambda: fc.Newmark(beta="0.3"), r"beta = '0.3': must be > 0"),
    (lambda: fc.GeneralizedAlpha(1.1), r"rho_inf = 1.1: must lie in \[0, 1\]"),
    (lambda: fc.GeneralizedAlpha(-0.1), r"rho_inf = -0.1: must lie in \[0, 1\]"),
    (lambda: fc.EnergyMomentum("central"), 'must be "auto", "symmetric" or "exact"'),
    *(
        (lambda c=cls: c(beyond_limit="yes"), rf"{cls.__name__}: beyond_limit = 'yes': must be Tr")
        for cls in (fc.CentralDifference, fc.ForwardEuler, fc.Newmark)
    ),
    (
        lambda: MethodTraits(order=1, explict=True),
        "'explict' is unknown: .*mean 'explicit'",
    ),
    (lambda: MethodTraits(order=1, explicit=True), "no explicit method is A-stable"),
    *(
        (lambda m=method: StabilityLimited(m), "has no stable step to choose")
        for method in (fc.ImplicitMidpoint(), fc.CentralDifference, "no method")
    ),
    (lambda: fc.Auto(rtol=-1.0), r"rtol = -1.0: must be a number >= 0"),
    (lambda: fc.Auto(rtol=0.0), r"rtol = atol = 0: one of them must be > 0"),
    (lambda: fc.Auto().step(None, None, 0.1, None), "is for march and run"),
    (lambda: march(fc.Auto(), dt=0.1), r"must be left out: Auto chooses its steps"),
    (lambda: march(fc.BDF2(), dt=None), "dt = None: must be a number .*let Adaptive"),
    (lambda: march(fc.BDF2(), dt=-1.0), "dt = -1.0: must be finite and > 0"),
    (lambda: march(t_end=0.0), "t_end = 0.0: must be finite and > 0"),
    *(
        (lambda t_end=t_end: march(t_end=t_end), "t_end = .*: must be a number")
        for t_end in ([0.1], "0.1", np.array([0.1]), np.array([0.05, 0.1]))
    ),
    (lambda: march(dt=np.array(0.01)), "dt = array.*: must be a number"),
    (lambda: march(fc.EnergyMomentum("exact"), solver="pcg"), "symmetric matrices only"),
    (
        lambda: march(fc.CentralDifference(), 1e-4, system(fc.StVK(), mass="consistent")),
        "must be 'lumped': an explicit step divides",
    ),
    (
        lambda: march(fc.SymplecticEuler(), 1e-5, system(fc.StVK(), mesh=cloth(element="P2"))),
        "must be 'lumped': .* Write mass = \"lumped\", or take an implicit method",
    ),
    (
        lambda: many_steps(fc.StVK(), fc.PointForce("left", lambda t: [t, 0, 0])),
        "many_steps: term PointForce",
    ),
    (lambda: many_steps(fc.StVK(), fc.UserForce(lambda x, v, t: x)), "many_steps: term UserForce"),
    (lambda: many_steps(fc.StVK(), mass="consistent"), "many_steps: mass = 'consistent'"),
    (
        lambda: many_steps(fc.StVK(), pins=[fc.Pin("left", rotate=TURN)]),
        "many_steps: pin 'left': must not rotate",
    ),
    *(
        (lambda o=options: many_steps(fc.StVK(), **o), "many_steps: (dt|steps|threads) = ")
        for options in (
            {"dt": 0.0},
            {"dt": NAN},
            {"steps": 0},
            {"steps": 1.5},
            *({"threads": threads} for threads in (0, 1.0, True, "2", 100_000)),
        )
    ),
    (lambda: fc.Probe("nowhere"), "either"),
    *(
        (
            lambda p=probes: fc.run(
                system(fc.StVK()), fc.BDF2(), system().rest(), 0.01, 0.02, probes=p
            ),
            message,
        )
        for probes, message in (
            ([fc.Probe("a", "left"), fc.Probe("a", "right")], "probe 'a' appears twice"),
            ([fc.Probe("mean_displacement", "right")], "is the name of a column of every run"),
            (["left"], "must be a list of Probe"),
            (fc.Probe("a", "left"), "must be a list of Probe"),
        )
    ),
    (lambda: fc.Newton(tolerance=0.0), "tolerance"),
    (lambda: fc.Newton(tolerance=NAN), "tolerance"),
    (lambda: fc.Newton(forcing=1.0), "forcing"),
    (lambda: fc.Newton(max_iterations=0), "max_iterations"),
    (lambda: fc.Newton(reuse=1), "reuse = 1: must be True or False"),
    (lambda: fc.Newton(definiteness="clamped"), 'must be "none", "clamp" or "on_failure"'),
    (lambda: equilibrium(tolerance=0.0), r"equilibrium: tolerance = 0.0: must lie in \[1e-13, 1\)"),
    (lambda: equilibrium(max_iterations=0), "max_iterations = 0: must be an integer >= 1"),
    (lambda: equilibrium(load_steps=2.5), "load_steps = 2.5: must be an integer >= 1"),
    (lambda: modes(count=0), r"modes: count = 0: must be an integer from 1 to \d+"),
    (lambda: modes(pins=[fc.Pin(lambda X: X[:, 0] > -1)]), "of 0 free degrees of freedom: must"),
    (lambda: equilibrium(solver="pcg"), "solver = 'pcg': must be direct, pardiso or superlu"),
]

test_fabrics = message_test(FABRIC)
test_meshes = message_test(MESH)
test_terms = message_test(TERMS)
test_systems = message_test(SYSTEM)
test_methods_and_solvers = message_test(METHODS)


@pytest.mark.parametrize(("command", "expected"), transcripts.blocks("mistakes.txt"))
def test_mistakes_are_answered_as_written_and_leave_no_files(
    command, expected, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    shutil.copy(transcripts.FOLDER / "scene.toml", "scene.toml")
    assert transcripts.answer(command) == expected
    assert list(Path().rglob("*")) == [Path("scene.toml")]
