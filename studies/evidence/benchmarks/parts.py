"""The program that measures the parts of a fecloth: kernels, steps, binding and frames."""


def program(cells: int) -> str:
    """Return the program for a square of that many cells a side, of two triangles each."""
    return f"CELLS = {cells}\n" + PROGRAM


# Runs with any version: it uses only names that all of them have. Each part is a function that
# makes one call and returns its CPU seconds per triangle. "reference" is the force of StVK in the
# plainest form. It never changes, so that the other numbers can be compared between machines.
PROGRAM = """
import json, sys, tempfile, time, warnings
import numba
import numpy as np
import fecloth as fc
try:
    from fecloth.linalg.block_matrix import BlockMatrix
except ImportError:
    from fecloth.blocks import BlockMatrix

warnings.simplefilter("ignore")
clock = time.process_time_ns
cloth = fc.Cloth.rectangle(1.0, 1.0, 1 / CELLS, pattern="right")
fabric = fc.Fabric(0.2, 1000.0, 0.3, bending_rigidity=1e-5)
X, m = cloth.X, len(cloth.triangles)
x = np.column_stack([1.02 * X, 0.02 * np.sin(3 * X[:, 0])])
v, f = np.zeros_like(x), np.zeros_like(x)
parts = {}

@numba.njit
def plain_force(x, triangles, gradients, area, f):
    for e in range(len(triangles)):
        F, P = np.zeros((3, 2)), np.zeros((3, 2))
        for a in range(3):
            for i in range(3):
                for j in range(2):
                    F[i, j] += x[triangles[e, a], i] * gradients[e, a, j]
        E11 = 0.5 * (F[0, 0] ** 2 + F[1, 0] ** 2 + F[2, 0] ** 2 - 1)
        E22 = 0.5 * (F[0, 1] ** 2 + F[1, 1] ** 2 + F[2, 1] ** 2 - 1)
        E12 = 0.5 * (F[0, 0] * F[0, 1] + F[1, 0] * F[1, 1] + F[2, 0] * F[2, 1])
        S11, S22, S12 = 1099 * E11 + 330 * E22, 330 * E11 + 1099 * E22, 770 * E12
        for i in range(3):
            P[i, 0] = F[i, 0] * S11 + F[i, 1] * S12
            P[i, 1] = F[i, 0] * S12 + F[i, 1] * S22
        for a in range(3):
            for i in range(3):
                work = P[i, 0] * gradients[e, a, 0] + P[i, 1] * gradients[e, a, 1]
                f[triangles[e, a], i] -= area[e] * work

T = cloth.triangles
D = np.stack([X[T[:, 1]] - X[T[:, 0]], X[T[:, 2]] - X[T[:, 0]]], axis=1)
inverse, area = np.linalg.inv(D), 0.5 * np.abs(np.linalg.det(D))
later = inverse.transpose(0, 2, 1)
gradients = np.ascontiguousarray(np.concatenate([-later.sum(axis=1)[:, None], later], axis=1))

def timed(call):
    def seconds():
        begin = clock()
        call()
        return 1e-9 * (clock() - begin)
    return seconds

parts["reference"] = timed(lambda: plain_force(x, T, gradients, area, f))
quadratic = fc.Cloth.rectangle(1.0, 1.0, 2 / CELLS, pattern="right", element="P2")  # m/4 triangles
on = {"": cloth, ", P2": quadratic}

def bent(X):
    return np.column_stack([1.02 * X, 0.02 * np.sin(3 * X[:, 0])])

for name, arguments in {"StVK": {}, "TensionField": {}, "NeoHookean": {}, "BaraffWitkin": {},
                        "Springs": {}, "HingeBending": {}, "PlateBending": {},
                        "StrainRateDamping": {"time": 1e-3}}.items():
    for element, mesh in on.items():
        try:
            system = fc.System(mesh, fabric, [getattr(fc, name)(**arguments)])
        except (AttributeError, fc.InputError):
            continue
        at, f2 = bent(mesh.X), np.zeros((len(mesh.X), 3))
        speed = np.sin(9 * at) if "Damping" in name else np.zeros_like(at)
        J, bound = BlockMatrix.zeros(system.pattern), system.bound[0]
        parts[name + " force" + element] = timed(
            lambda bound=bound, at=at, u=speed, f=f2: bound.add_force(at, u, 0.0, f)
        )
        parts[name + " tangent" + element] = timed(
            lambda bound=bound, at=at, u=speed, J=J: bound.add_tangent(
                at, u, 0.0, 1.0, 1.0, J, False
            )
        )

whole = fc.System(cloth, fabric, [fc.StVK(), fc.HingeBending(), fc.Gravity()], pins=["left"])
start, dt = whole.state(x), 0.2 / CELLS * (0.2 / 1000) ** 0.5

def explicit():
    begin = clock()
    fc.run(whole, fc.CentralDifference(), start, dt, 400 * dt)
    return 1e-9 * (clock() - begin) / 400

def together():
    begin = clock()
    fc.many_steps(alone, alone.state(x), dt, 400)
    return 1e-9 * (clock() - begin) / 400

def implicit(solver, method=fc.BackwardEuler(), system=whole):
    def seconds():
        first = system.state(bent(system.cloth.X))
        steps = fc.march(system, method, first, 5e-3, 20e-3, solver=solver)
        next(steps)
        begin = clock()
        list(steps)
        return 1e-9 * (clock() - begin) / 3
    return seconds

parts["explicit step of a run"] = explicit
alone = fc.System(cloth, fabric, [fc.StVK(), fc.Gravity()], pins=["left"])
if hasattr(fc, "many_steps"):
    parts["explicit steps together"] = together
damping = [fc.StVK(), fc.StrainRateDamping(1e-3), fc.Gravity()]
for name in ("BackwardEuler", "BDF2", "ImplicitMidpoint", "Newmark", "EnergyMomentum"):
    for element, mesh in on.items():
        if hasattr(fc, name) and not (element and name == "EnergyMomentum"):  # needs shorter steps
            damped = fc.System(mesh, fabric, damping, pins=["left"])
            method = getattr(fc, name)()
            parts[f"damped step, {name}{element}"] = implicit("pcg", method, damped)
for solver in ("pcg", "direct", "multigrid", "auto"):
    try:
        fc.solver_for(whole, fc.BackwardEuler(), 5e-3, solver)
    except fc.InputError:
        continue
    parts["implicit step, " + solver] = implicit(solver)
parts["binding"] = timed(lambda: fc.System(cloth, fabric, whole.terms, pins=["left"]).pattern)

def frame():
    with tempfile.TemporaryDirectory() as folder:
        begin = clock()
        fc.write_vtk(folder + "/frame", cloth, start, whole)
        return 1e-9 * (clock() - begin)

parts["frame"] = frame
for part in parts.values():
    part()  # compiles
print(fc.__file__, flush=True)
for line in sys.stdin:
    question = json.loads(line)
    if question == "names":
        print(json.dumps(list(parts)), flush=True)
        continue
    spent, times = 0.0, []
    while len(times) < 5 and spent < 0.05:
        times.append(parts[question]())
        spent += times[-1]
    print(json.dumps(min(times) / m), flush=True)
"""
