"""Cost of derivatives by parameters, over the run or the equilibrium without them.

    python -m studies.evidence.benchmarks.sensitivity

A sheet of 4,000 triangles with a membrane, a plate, damping, drag and gravity swings by BDF2 for 30
steps, with PARDISO and with conjugate gradients; the cost is of one parameter, in runs. The
equilibrium is of a sheet that hangs from one edge and one corner, with 20 parameters, in solutions.
One thread, CPU seconds, the shortest of some runs. The check by twin runs is not in them.
"""

from __future__ import annotations

import time
from dataclasses import replace

import fecloth as fc
from fecloth.simulation.quantity import parse_quantity
from fecloth.study.derivation import Recorded, derive_run
from fecloth.study.derived_cases import Sought, derive_case
from fecloth.study.parameters import choose_parameters, setup_with
from fecloth.study.problems import open_problem
from studies import harness
from studies.evidence.benchmarks.measure import Measured, print_verdicts, square

TRIANGLES, FEW = 4000, 100
LIMITS = {"pardiso": 0.3, "pcg": 0.6, "equilibrium": 1.3}
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


def seconds_of(work, repeats: int) -> float:
    """CPU seconds of the fastest of some calls, after one that compiles."""
    work()
    return min(_timed(work) for _ in range(repeats))


def _timed(work) -> float:
    begin = time.process_time()
    work()
    return time.process_time() - begin


def measure_motion(triangles: int, linear: str, repeats: int) -> list[Measured]:
    problem = open_problem(swinging(square(triangles)), dt=DT, t_end=T_END)
    setup = replace(problem.setup(), linear=linear, newton=NEWTON)
    system, start, steps = setup.system, setup.start, setup.steps

    def run() -> None:
        steps_of = fc.march(system, steps, start, None, T_END, solver=linear, newton=NEWTON)
        for _ in steps_of:
            pass

    def derive() -> None:
        parameters = choose_parameters(problem, None, {})

        def setup_at(parameter, value):
            return setup_with(problem, {parameter.name: value}, setup)

        derive_run(setup, parameters, setup_at, Recorded(False, False), 2e-4)

    plain, whole = seconds_of(run, repeats), seconds_of(derive, repeats)
    count = len(choose_parameters(problem, None, {}))
    print(f"BDF2 with {linear}: {plain:.2f} s, with {count} derivatives {whole:.2f} s")
    what = f"a derivative of BDF2 with {linear}, {triangles} triangles / run"
    return [Measured(what, (whole - plain) / plain / count, "ratio", LIMITS[linear])]


def measure_rest(triangles: int, repeats: int) -> list[Measured]:
    problem = open_problem(hanging(square(triangles)))
    parameters = choose_parameters(problem, None, {})
    sought = Sought(parameters, (parse_quantity("sag"),), 1e-4)
    setup = problem.setup()
    plain = seconds_of(lambda: fc.equilibrium(setup.system, setup.start), repeats)
    whole = seconds_of(lambda: derive_case(problem, sought.settings()), repeats)
    print(f"equilibrium: {plain:.2f} s, with {len(parameters)} derivatives {whole:.2f} s")
    what = f"equilibrium of {triangles} triangles with {len(parameters)} derivatives / without"
    return [Measured(what, whole / plain, "ratio", LIMITS["equilibrium"])]


def main() -> int:
    parser = harness.Parser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="few triangles, once")
    few = parser.parse_args().quick
    size, repeats = (FEW, 1) if few else (TRIANGLES, 3)
    jobs = [lambda name=name: measure_motion(size, name, repeats) for name in ("pardiso", "pcg")]
    return print_verdicts([*jobs, lambda: measure_rest(size, repeats)], few)


if __name__ == "__main__":
    harness.run_main(main)
