"""Cost of derivatives by parameters, over the run or the equilibrium without them.

    python -m studies.evidence.benchmarks.sensitivity

A sheet of 4,000 triangles with a membrane, a plate, damping, drag and gravity swings by BDF2 for 30
steps, with PARDISO and with conjugate gradients; the cost is of one parameter, in runs. The
equilibria are of a sheet of 2,000 triangles that hangs from one edge and one corner, a function
and a scene, with 20 parameters, in solutions with their set-up. One thread, CPU seconds, the
shortest of some runs. The check by twin runs is not in them.
"""

from __future__ import annotations

import time
from dataclasses import replace

import fecloth as fc
from fecloth.scene.scene import Scene, scene_of
from fecloth.simulation.quantity import parse_quantity
from fecloth.study.derivation import Recorded, derive_run
from fecloth.study.derived_cases import Sought, derive_case
from fecloth.study.parameters import choose_parameters
from fecloth.study.problem import StudyProblem
from studies import harness
from studies.evidence.benchmarks.measure import square

TRIANGLES, FEW = 4000, 100
LIMITS = {"pardiso": 0.3, "pcg": 0.6, "equilibrium": 1.5}
NEWTON = fc.Newton(tolerance=1e-6)  # as the derivatives have it at their usual tolerance
DT, T_END = 0.005, 0.15


def swinging(cloth: fc.Cloth):
    def problem(rho=0.2, Y=500.0, B=1e-4, tau=0.02, drag=0.5):
        fabric = fc.Fabric(rho, Y, 0.3, bending_rigidity=B)
        damping = fc.StrainRateDamping(time=tau), fc.Drag(drag)
        terms = [fc.StVK(), fc.PlateBending(), *damping, fc.Gravity()]
        pin = fc.Pin("left", clamp=True)
        system = fc.System(cloth, fabric, terms, pins=[pin], threads=1)
        return cloth, system, fc.BDF2(), system.rest()

    return problem


def hanging(cloth: fc.Cloth):
    corner = fc.Pin(lambda X: (X[:, 0] > 0.99) & (X[:, 1] > 0.99))

    up, down = (0.1, 0.2, 0.3), (0.1, 0.2, -9.81)

    def problem(  # of 20 numbers
        Y=(500.0, 400.0), nu=0.3, G=150.0, B=(1e-3, 2e-3), rho=0.2, p=0.5, g=down, a=up, b=up, c=up
    ):
        fabric = fc.Fabric(rho, Y, nu, shear_stiffness=G, bending_rigidity=B)
        forces = ((0.5, 0.5), a), ((0.2, 0.7), b), ((0.7, 0.3), c)
        loads = [fc.PointForce(place, force) for place, force in forces]
        terms = [fc.StVK(), fc.PlateBending(), fc.Pressure(p), fc.Gravity(g), *loads]
        system = fc.System(cloth, fabric, terms, pins=["left", corner], threads=1)
        return cloth, system, None, system.rest()

    return problem


def hanging_scene(triangles: int) -> Scene:
    """The same sheet as a scene: 20 numbers of its fabric and terms."""
    up, down = [0.1, 0.2, 0.3], [0.1, 0.2, -9.81]
    places = [0.5, 0.5], [0.2, 0.7], [0.7, 0.3]
    loads = [{"type": "PointForce", "where": place, "force": up} for place in places]
    fabric = {
        "areal_density": 0.2,
        "tensile_stiffness": [500.0, 400.0],
        "poisson_ratio": 0.3,
        "shear_stiffness": 150.0,
        "bending_rigidity": [1e-3, 2e-3],
    }
    return scene_of(
        {
            "cloth": {"shape": "rectangle", "width": 1.0, "height": 1.0, "pattern": "right"}
            | {"h": (2 / triangles) ** 0.5},
            "fabric": fabric,
            "terms": [
                {"type": "StVK"},
                {"type": "PlateBending"},
                {"type": "Pressure", "pressure": 0.5},
                {"type": "Gravity", "acceleration": down},
                *loads,
            ],
            "pins": [{"where": "left"}, {"inside": "X > 0.99 and Y > 0.99"}],
            "solver": {"threads": 1},
            "equilibrium": {"load_steps": 1},
        }
    )


def seconds_of(*works, repeats: int) -> list[float]:
    """CPU seconds of the fastest of some calls of each, by turns, after one that compiles."""
    for work in works:
        work()
    rounds = [[_timed(work) for work in works] for _ in range(repeats)]
    return [min(seconds) for seconds in zip(*rounds, strict=True)]


def _timed(work) -> float:
    begin = time.process_time()
    work()
    return time.process_time() - begin


def measure_motion(triangles: int, linear: str, repeats: int) -> harness.Finding:
    problem = StudyProblem.of(swinging(square(triangles)), dt=DT, t_end=T_END)
    setup = replace(problem.setup(), linear=linear, newton=NEWTON)
    system, start, steps = setup.system, setup.start, setup.steps

    def run() -> None:
        steps_of = fc.march(system, steps, start, None, T_END, solver=linear, newton=NEWTON)
        for _ in steps_of:
            pass

    def derive() -> None:
        parameters = choose_parameters(problem, None, {})

        def setup_at(parameter, value):
            return problem.on({parameter.name: value}, setup)

        derive_run(setup, parameters, setup_at, Recorded(False, False), 2e-4)

    plain, whole = seconds_of(run, derive, repeats=repeats)
    count = len(choose_parameters(problem, None, {}))
    print(f"BDF2 with {linear}: {plain:.2f} s, with {count} derivatives {whole:.2f} s")
    what = f"a derivative of BDF2 with {linear}, {triangles} triangles / run"
    return harness.Finding(what, (whole - plain) / plain / count, high=LIMITS[linear])


def measure_rest(problem, kind: str, repeats: int) -> harness.Finding:
    opened = StudyProblem.of(problem)
    parameters = choose_parameters(opened, None, {})[:20]
    sought = Sought(parameters, (parse_quantity("sag"),), 1e-4)
    triangles = len(opened.setup().cloth.triangles)

    def solve() -> None:
        setup = opened.setup()  # as the run with derivatives makes its own, too
        if setup.t_end is None:
            fc.equilibrium(setup.system, setup.start)
        else:
            setup.run(setup.choose()[1])

    def derive() -> None:
        derive_case(opened, sought.settings())

    plain, whole = seconds_of(solve, derive, repeats=repeats)
    print(
        f"equilibrium of a {kind}: {plain:.2f} s, with {len(parameters)} derivatives {whole:.2f} s"
    )
    what = f"equilibrium of a {kind}, {triangles} triangles, with {len(parameters)} derivatives"
    return harness.Finding(f"{what} / without", whole / plain, high=LIMITS["equilibrium"])


def main() -> None:
    parser = harness.Parser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="few triangles, once")
    size, repeats = TRIANGLES, 5
    if parser.parse_args().quick:
        size, repeats = FEW, 1
    for linear in ("pardiso", "pcg"):
        print(measure_motion(size, linear, repeats), flush=True)
    print(measure_rest(hanging(square(size // 2)), "function", repeats), flush=True)
    print(measure_rest(hanging_scene(size // 2), "scene", repeats), flush=True)


if __name__ == "__main__":
    harness.run_main(main)
