"""What the calls of `tests/messages/calls.txt` and `files.txt` may name."""

import math as math
import tempfile
from contextlib import chdir
from dataclasses import dataclass as dataclass
from dataclasses import replace as replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from support import matrices as matrices
from support.examples import example as example
from support.local_link import LocalLink as LocalLink
from support.sewn_strips import SEAM as SEAM
from support.sewn_strips import halves as halves
from support.study_functions import fail_or_return as fail_or_return
from support.study_functions import return_setting as return_setting

import fecloth as fc
from fecloth import study as study
from fecloth.distributed.distributed_system import DistributedSystem as DistributedSystem
from fecloth.homogenisation import bending_tensor as bending_tensor
from fecloth.homogenisation import strip_rigidity as strip_rigidity
from fecloth.integrators.protocol import MethodTraits as MethodTraits
from fecloth.linalg import select as select
from fecloth.mesh.flat_mesh import FlatMesh as FlatMesh
from fecloth.mesh.grading import Grading as Grading
from fecloth.quantities.columns import factor_to_si as factor_to_si
from fecloth.quantities.columns import read_table
from fecloth.quantities.formula import Formula as Formula
from fecloth.quantities.units import AREAL as AREAL
from fecloth.quantities.units import MOMENT as MOMENT
from fecloth.quantities.units import PER_WIDTH as PER_WIDTH
from fecloth.quantities.units import TIME as TIME
from fecloth.quantities.units import quantity as quantity
from fecloth.runs import restart as restart
from fecloth.scene.probe_tables import read_measured as read_measured
from fecloth.simulation.on_request import grip_width as grip_width
from fecloth.simulation.quantity import parse_quantity as parse_quantity
from fecloth.simulation.quantity_values import RunRecord
from fecloth.simulation.quantity_values import signal_period as signal_period
from fecloth.simulation.quantity_values import value_of as value_of
from fecloth.simulation.resolve import solver_for as solver_for
from fecloth.simulation.stability_limited import StabilityLimited as StabilityLimited
from fecloth.stability import amplification as amplification
from fecloth.stability import estimate as estimate
from fecloth.study.fitting import file as fit_file
from fecloth.study.fitting.experiment import Experiment as Experiment
from fecloth.study.problem import StudyProblem as StudyProblem
from fecloth.study.result import read_tolerance as read_tolerance
from fecloth.study.uncertainty import estimate_uncertainty as estimate_uncertainty
from fecloth.study.variants import parse_range as parse_range
from fecloth.system.constraints import Constraints as Constraints
from fecloth.system.recovered_stress import stress_at_point as stress_at_point
from fecloth.terms.records import remembered as remembered
from fecloth.terms.traits import traits_of as traits_of

NAN, INF = float("nan"), float("inf")
ISOTROPIC = fc.Fabric(areal_density=0.2, tensile_stiffness=1000.0, poisson_ratio=0.3)
ORTHOTROPIC = fc.Fabric(0.15, (2000.0, 900.0), 0.2, shear_stiffness=60.0)
BENDING = fc.Fabric(0.15, 1000.0, bending_rigidity=1e-5)
TURN = fc.Rotation((0, 0, 0), (0, 0, 1), "t")
FLOOR = fc.shapes.Plane((0, 0, -1), (0, 0, 1))
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


def solved_by_pcg(prepares=True, b=None, rtol=1e-3):
    A, solver = matrices.sheet(m=5), select.PCG()
    if prepares:
        solver.prepare(A)
    return solver.solve(matrices.load(A) if b is None else b, rtol=rtol)


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


def motion_at(name, value):
    pin = fc.Pin("left", **({"motion": lambda t: np.zeros(3)} | {name: lambda t: value}))
    return pin.displacement(0.5) + pin.speed(0.5)


# a system, its state, and a run of them
CLOTH = fc.Cloth.rectangle(0.6, 0.3, h=0.15, pattern="right")
FABRIC = fc.Fabric(areal_density=0.2, tensile_stiffness=100.0)
SYSTEM = fc.System(CLOTH, FABRIC, [fc.StVK(), fc.Gravity()], pins=["left"])
START = SYSTEM.rest()
OTHER = fc.Cloth.rectangle(0.6, 0.3, h=0.3, pattern="right")
X, V = START.x, START.v
BROKEN = X.copy()
BROKEN[3, 1] = np.nan


BDF2 = fc.BDF2()


# terms, laws and methods of a user's own
class Stub:
    """A term that gives what it is told."""

    def __init__(self, stencil=None, bound=None, **members):
        self.stencil = lambda cloth: stencil
        self.bind = lambda panel, slots: bound
        vars(self).update(members)


class Least(fc.BoundTerm):
    """A bound term with no more than it must have."""

    name, symmetric, has_energy = "Least", True, False

    def add_force(self, x, v, t, f):
        f[:, 2] -= 1.0

    def add_tangent(self, x, v, t, wx, wv, J, definite):
        pass


class Half(fc.BoundTerm):
    """A bound term without the half of what it must have."""

    name, has_energy, dissipative = "half", True, True

    def add_force(self, x, v, t, f):
        pass


class NoEnergy(Least):
    has_energy = dissipative = True


class Foreign:
    """An object with the functions of a bound term that does not derive from `BoundTerm`."""

    name, symmetric = "Foreign", True
    has_energy = dissipative = velocity_dependent = False
    add_force, add_tangent = Least.add_force, Least.add_tangent


def linear(E, c, S12=1.0, C66=1.0, C12=0.0):
    """StVK of Y = 1000 N/m and ν = 0, spoiled."""
    S = 1000 * E[0], 1000 * E[1], S12 * 1000 * E[2]
    W = 500 * (E[0] ** 2 + E[1] ** 2 + 2 * E[2] ** 2)
    return W, S, (1000, 1000, C66 * 500, C12, 0, 0)


def mine(law, constants=(0.0,)):
    """A law of that function, which is a method where it has three arguments."""
    members = {"law": staticmethod(law), "constants": lambda self, fabric: constants}
    return type("Mine", (fc.MembraneLaw,), members)()


def squared(wrong=1.0, sign=1.0):
    """C = |y₁ − y₀|²/2 with an entry of the gradient, or the Hessian, wrong."""

    def gradient(y):
        d = y[:, 1] - y[:, 0]
        g = np.stack([-d, d], axis=1)
        g[3, 1, 2] *= wrong
        return g

    def hessian(y):
        H = np.einsum("ab,ij->aibj", [[1.0, -1.0], [-1.0, 1.0]], np.eye(3))
        return sign * np.broadcast_to(H, (len(y), *H.shape))

    nodes = np.arange(12).reshape(6, 2)
    value = lambda y: 0.5 * np.sum((y[:, 1] - y[:, 0]) ** 2, axis=1)  # noqa: E731
    return fc.Condition(value, nodes, 1.0, gradient=gradient, hessian=hessian)


def own_method(base, *members, **others):
    """A method with these members of another one, and others."""
    return type("Own", (), {name: getattr(base, name) for name in members} | others)()


def theta(**others):
    """The method θ of studies/examples/integrator.py, changed."""
    from studies.examples.integrator import Theta

    return type("Own", (Theta,), others)(1.0)


def short_stage(self, state, dt):
    stage = theta().stage(state, dt)
    return replace(stage, v=stage.v[1:])


FIRST = MethodTraits(order=1, error_constant=0.5)


def marched(system=SYSTEM, method=BDF2, state=START, dt=0.01, t_end=0.02, **options):
    return fc.run(system, method, state, dt, t_end, **options)


# a cloth of regions, readings of instruments, uncertainties, and the arrays of a square
GRID = fc.Cloth.rectangle(1.0, 0.5, h=0.25, pattern="right")
BODY = {"body": np.arange(8), "hem": np.arange(8, 16), "all": np.arange(16)}
REGIONS = fc.Cloth.from_arrays(GRID.X, GRID.triangles, regions=BODY, renumber=False)
KES = {"W": 20.0, "EMT": (4.0, 6.0), "LT": (0.65, 0.6), "G": (0.9, 0.7), "WT": (6.5, 9.0)}
KES |= {"B": (0.12, 0.08)}
FAST = {"W": 168, "E100": (4.60, 5.87), "EB5": 4.7, "C": (15.00, 14.50)}
UNCERTAIN = {"tensile_stiffness.0": "0.12 N/cm", "shear_stiffness": "5 %"}
QUAD_X, QUAD_T = [[0.0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2], [0, 2, 3]]


def regions(fabric, **options):
    return fc.System(REGIONS, fabric, [fc.StVK()], **options)


def uncertain(table):
    return fc.Fabric(0.2, 1000.0, uncertainty=table)


def standard(fabric):
    return fabric.uncertainty.standard(fabric)


def mesh(X=QUAD_X, triangles=QUAD_T, where="sheet", **options):
    return FlatMesh.from_arrays(X, triangles, where=where, **options)


# triangles around a square of two, and a node on its side that the others lack
RING = [[0, 0], [3, 0], [3, 3], [0, 3], [1, 1], [2, 1], [2, 2], [1, 2], [1.5, 1.0]]
FRAME = [[0, 1, 4], [1, 5, 4], [1, 2, 5], [2, 6, 5], [2, 3, 6], [3, 7, 6], [3, 0, 7], [0, 4, 7]]

# sewn cloths, and cloths laid down
MOVED = ("0.1*t", 0, 0)
CORNERED = fc.Cloth.rectangle(0.2, 0.2, h=0.05, pattern="right")
DART = fc.Cloth.from_arrays(
    [[0.0, 0], [1, 0], [1.5, 1], [2, 0], [3, 0], [3, 2], [1.5, 2], [0, 2]],
    [(0, 1, 2), (2, 3, 4), (2, 4, 5), (2, 5, 6), (2, 6, 7), (2, 7, 0)],
    sets={"left": [1, 2], "right": [2, 3]},
)


def sewn(*seams, cloth=None, pins=(), fabric=ISOTROPIC):
    terms = [fc.StVK(), *([fc.PlateBending()] if fabric.bending else [])]
    return system(*terms, fabric=fabric, pins=pins, mesh=cloth or halves(), seams=seams)


def at_rest(bound, x=None):
    return fc.equilibrium(bound, bound.rest() if x is None else bound.state(x))


def rolled(cloth):
    """The positions of a cloth of 1 m as a tube."""
    angle = 2 * np.pi * cloth.X[:, 0]
    return np.column_stack([np.cos(angle), np.sin(angle), 2 * np.pi * cloth.X[:, 1]]) / (2 * np.pi)


def laid(*terms, pins=(), z=0.0):
    bound = system(fc.StVK(), *terms, pins=pins)
    return fc.lay_down(bound, bound.state(bound.rest().x + [0, 0, z]))


# files of meshes
MESHES = Path(__file__).parents[2] / "meshes"
FILES = Path(__file__).parents[1] / "messages" / "meshes"


def read(file, **given):
    """What a file is read as: its size, its sets by their length or number of triangles, notes."""
    path = FILES / file if isinstance(file, str) else file
    if path.suffix in (".vtp", ".vtk"):
        pytest.importorskip("pyvista")
    cloth = fc.Cloth.read(path, **given)
    shape = f"{len(cloth.X)} nodes, {len(cloth.triangles)} triangles of {cloth.element}"
    ends = {name: np.diff(cloth.X[edges], axis=1) for name, edges in cloth.edge_sets.items()}
    sets = [f"{name}: {np.linalg.norm(each, axis=2).sum():.6g} m" for name, each in ends.items()]
    sets += [f"{name}: {len(part)} triangles" for name, part in cloth.triangle_sets.items()]
    return [f"{shape}, {cloth.area:.6g} m²", *sets, *cloth.notes]


def written(name, text):
    """A file of the working directory with this text."""
    Path(name).write_text(text)
    return Path(name)


def geo(extra):
    """The file of a square with further commands."""
    return written("s.geo", (MESHES / "square.geo").read_text() + extra)


def msh(*changes):
    """The file of two triangles with changes of its text."""
    text = (FILES / "own_numbers.msh").read_text()
    for old, new in changes:
        text = text.replace(old, new)
    return written("s.msh", text)


# what a run has recorded, and problems of studies
COLUMNS = ["tip.x", "tip.y", "tip.z", "sag", "StVK", "reaction:left.z"]
RECORD = RunRecord(np.linspace(0, 2, 9), {"sag": np.linspace(0, 2, 9)}, frequencies=(3.0,))
TIP = [fc.Probe("tip", "right")]


def strip(h, dt=0.1, stiffness=20.0):
    """A strip that hangs in its plane, at rest."""
    cloth = fc.Cloth.rectangle(1.0, 0.25, h, pattern="right")
    terms = [fc.StVK(), fc.Gravity((9.81, 0, 0))]
    system = fc.System(cloth, fc.Fabric(0.2, stiffness), terms, ["left"])
    return cloth, system, None, system.rest()


def scene(*changes):
    return fc.load_scene(FILES.parent / "static.toml", changes)


# files that are read

MESSAGES = Path(__file__).parents[1] / "messages"
SQUARES = [
    (MESSAGES.parents[1] / "meshes" / f"square_{version}.msh").read_text(encoding="utf-8")
    for version in (22, 41)
]
FIT, TWO = (
    {path.name: path.read_text(encoding="utf-8") for path in (MESSAGES / name).iterdir()}
    for name in ("fit", "regions")
)
OWN_TERMS = """
cloth = { shape = "rectangle", width = 0.4, height = 0.3, h = 0.1, pattern = "right" }
fabric = { areal_density = 0.2, tensile_stiffness = 1000.0 }
terms = [
  { type = "Fung", strain = 0.15 },
  { type = "StrainRateDamping", time = 1e-3, law = { type = "Fung" } },
  { type = "Winkler", k = 300.0 },
]
pins = [{ where = "left" }]
start = { position = ["X", "Y", "0.05 * X"] }
time = { method = "bdf2", dt = 1e-3, t_end = 5e-3 }
"""


def given(files, call, *arguments, **options):
    """The call in a folder with these files, by their names."""
    with tempfile.TemporaryDirectory() as folder, chdir(folder):
        for name, content in files.items():
            Path(name).write_bytes(content if isinstance(content, bytes) else content.encode())
        return call(*arguments, **options)


def a_scene(content, *overrides, **options):
    """The set-up of a scene with this text."""
    return given({"a.toml": content}, lambda: fc.load_scene("a.toml", overrides, **options).build())


def a_fit(old="", new="", **files):
    """The fit of a file in which a text is replaced, with other files beside it."""
    text = FIT["FIT.toml"].replace(old, new)
    files = {name.replace("_", "."): content for name, content in files.items()}
    return given(FIT | {"FIT.toml": text} | files, fit_file.fit, "FIT.toml")


def two_regions(*overrides, old="", new=""):
    """The set-up of a scene with two regions, of which a text is replaced."""
    text = TWO["scene.toml"].replace(old, new)
    return given(TWO | {"scene.toml": text}, lambda: fc.load_scene("scene.toml", overrides).build())


def a_column(text, name="force"):
    """The numbers of a column, in newtons."""
    return given({"a.csv": text}, lambda: read_table(Path("a.csv"), "x").numbers(name, "N"))


def fan(degrees, parts):
    """Triangles around the origin, that turn by so many degrees altogether."""
    angles = np.radians(np.linspace(0.0, degrees, parts + 1))
    radii = 1.0 + 0.1 * np.arange(parts + 1)  # a spiral, so that no nodes coincide
    X = np.vstack([[0.0, 0.0], np.column_stack([radii * np.cos(angles), radii * np.sin(angles)])])
    return fc.Cloth.from_arrays(X, [[0, i, i + 1] for i in range(1, parts + 1)])


def march_on(method, *steps):
    """A step of backward Euler, and another one of a method with the memory of the first."""
    state, info = next(fc.march(SYSTEM, fc.BackwardEuler(), START, 0.01, 0.05))
    return next(fc.march(SYSTEM, method, state, *steps, memory=info.memory))
