"""Static equilibria by default: which of 40 problems does `fc.equilibrium` not solve, and how well?

    python -m studies.evidence.newton_catalogue.statics [--quick] [--jobs N] [--out DIR]

Strips, plates, membranes and sheets on P1 and P2: stiff (Y L²/B from 1e2 to 1e8), thin, taut,
pressed, slack, buckled, on an obstacle; two have 500,000 triangles. Each is solved with the default
tolerance. A second solution checks the positions: they are disturbed by 1e-5 of the largest
displacement, and Newton steps with the public operators f and K, solved by SciPy without any line
search, lead back until they no longer shrink. The error is the largest distance of
a node over the largest displacement. On the two large problems `fc.equilibrium` leads back.

An error above 1e-5 needs a reason that names the round-off. The table of the full form is
studies/evidence/newton_catalogue/statics.md.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.sparse.linalg import splu

import fecloth as fc
from fecloth import study
from studies import harness

ALLOWED = 1e-5  # of the largest displacement
ROUND_OFF = 1e-9  # of the largest displacement: the error that the fine solve may have
DISTURBANCE = 1e-5  # of the largest displacement
MOST = 40  # Newton steps of the fine solve
LARGE = 100_000  # triangles: SciPy's factorisation would need too much memory beyond
TITLE = "Static equilibria by default"
DOWN = fc.Gravity((0, 0, -9.81))

Problem = tuple[fc.System, fc.State]


def make_system(cloth, fabric, terms, pins) -> fc.System:
    mass = "lumped" if cloth.element == "P1" else "consistent"
    return fc.System(cloth, fabric, terms, pins, mass=mass)


def cantilever(ratio: float, load: float, element: str, h: float, pattern: str) -> Problem:
    """A strip of 0.2 m × 0.05 m, clamped level: ratio = Y L²/B, load = ρ g L³/B."""
    length, density = 0.2, 0.2
    B = density * 9.81 * length**3 / load
    fabric = fc.Fabric(density, ratio * B / length**2, 0.3, bending_rigidity=B)
    cloth = fc.Cloth.rectangle(length, 0.05, h * length, pattern, element)
    system = make_system(
        cloth, fabric, [fc.StVK(), fc.PlateBending(), DOWN], [fc.Pin("left", clamp=True)]
    )
    return system, system.rest()


def plate(weight: float, tension: float, element: str, h: float, pattern: str) -> Problem:
    """A supported square plate of 1 m, ρ g L³/B = weight, stretched by `tension`."""
    fabric = fc.Fabric(0.2, 1e4, 0.3, bending_rigidity=0.2 * 9.81 / weight)
    cloth = fc.Cloth.rectangle(1.0, 1.0, h, pattern, element)
    system = make_system(cloth, fabric, [fc.StVK(), fc.PlateBending(), DOWN], ["boundary"])
    return system, system.state(system.rest().x * [1 + tension, 1 + tension, 1])


def membrane(stretch: float, pressure: float, element: str, h: float, pattern: str) -> Problem:
    """A taut square of 1 m under a pressure [Pa], without bending stiffness."""
    cloth = fc.Cloth.rectangle(1.0, 1.0, h, pattern, element)
    terms = [fc.StVK(), fc.Pressure(pressure)]
    system = make_system(cloth, fc.Fabric(0.2, 1000.0, 0.3), terms, ["boundary"])
    return system, system.state(system.rest().x * [1 + stretch, 1 + stretch, 1])


def blown(stretch: float, pressure: float, element: str, h: float, law: str) -> Problem:
    """A disk of 0.5 m radius, blown up by a pressure [Pa] from flat, or from slack."""
    cloth = fc.Cloth.disk(0.5, h, element)
    terms = [getattr(fc, law)(), fc.PlateBending(), fc.Pressure(pressure)]
    system = make_system(
        cloth, fc.Fabric(0.2, 500.0, 0.3, bending_rigidity=1e-5), terms, ["boundary"]
    )
    x = system.rest().x * [1 + stretch, 1 + stretch, 1]
    x[:, 2] = 0.05 * (0.25 - (cloth.X**2).sum(axis=1))
    return system, system.state(x)


def buckled(squeeze: float, ratio: float, element: str, h: float, pattern: str) -> Problem:
    """A strip of 0.2 m whose clamped ends are brought nearer, with a small load across."""
    length = 0.2
    B = 1e-5
    fabric = fc.Fabric(0.2, ratio * B / length**2, 0.3, bending_rigidity=B)
    cloth = fc.Cloth.rectangle(length, 0.05, h * length, pattern, element)
    pins = [fc.Pin("left", clamp=True), fc.Pin("right", clamp=True)]
    terms = [fc.StVK(), fc.PlateBending(), fc.Gravity((0, 0, -0.05))]
    system = make_system(cloth, fabric, terms, pins)
    return system, system.state(system.rest().x * [1 - squeeze, 1, 1])


def curtain(slack: float, bending: float, element: str, h: float, pattern: str) -> Problem:
    """A sheet of 0.5 m × 0.5 m between two held edges nearer than its width, under gravity."""
    fabric = fc.Fabric(0.2, 500.0, 0.3, bending_rigidity=bending)
    cloth = fc.Cloth.rectangle(0.5, 0.5, h, pattern, element)
    system = make_system(cloth, fabric, [fc.StVK(), fc.PlateBending(), DOWN], ["left", "right"])
    return system, system.state(system.rest().x * [1 - slack, 1, 1])


def corners(stiffness: float, bending: float, element: str, h: float, pattern: str) -> Problem:
    """A sheet of 0.3 m that hangs from its four corners."""
    fabric = fc.Fabric(0.2, stiffness, 0.3, bending_rigidity=bending)
    cloth = fc.Cloth.rectangle(0.3, 0.3, h, pattern, element)
    at_corner = fc.Pin(lambda X: (abs(X - 0.15) > 0.15 - 1e-9).all(axis=1))
    system = make_system(cloth, fabric, [fc.StVK(), fc.PlateBending(), DOWN], [at_corner])
    return system, system.rest()


def sheared(shear: float, stretch: float, element: str, h: float, law: str) -> Problem:
    """A taut sheet of 1 m × 0.5 m whose upper edge is drawn along itself: wrinkles."""
    cloth = fc.Cloth.rectangle(1.0, 0.5, h, "cross" if element == "P1" else "right", element)
    terms = [getattr(fc, law)(), fc.PlateBending(), fc.Gravity((0, 0, -0.5))]
    fabric = fc.Fabric(0.2, 1000.0, 0.3, bending_rigidity=1e-4)
    system = make_system(cloth, fabric, terms, ["top", "bottom"])
    x = system.rest().x * [1, 1 + stretch, 1]
    x[:, 0] += shear * x[:, 1]
    return system, system.state(x)


def on_ball(radius: float, h: float, element: str, bending: float, pattern: str) -> Problem:
    """A sheet of 0.5 m, held on two edges, over a ball without friction."""
    cloth = fc.Cloth.rectangle(0.5, 0.5, h, pattern, element)
    ball = fc.Obstacle(fc.shapes.Sphere((0.25, 0.25, -radius - 0.005), radius), gap=2e-3)
    fabric = fc.Fabric(0.2, 300.0, 0.3, bending_rigidity=bending)
    terms = [fc.StVK(), fc.PlateBending(), DOWN, ball]
    system = make_system(cloth, fabric, terms, ["left", "right"])
    return system, system.rest()


FUNCTIONS: dict[str, Callable[..., Problem]] = {
    function.__name__: function
    for function in (
        *(cantilever, plate, membrane, blown, buckled, curtain, corners, sheared, on_ball),
    )
}
PROBLEMS: tuple[tuple, ...] = (
    ("cantilever", 1e2, 1.0, "P1", 1 / 16, "right"),
    ("cantilever", 1e4, 10.0, "P1", 1 / 16, "unstructured"),
    ("cantilever", 1e6, 1.0, "P1", 1 / 32, "right"),
    ("cantilever", 1e6, 1e-3, "P1", 1 / 16, "cross"),
    ("cantilever", 1e7, 100.0, "P1", 1 / 32, "right"),
    ("cantilever", 1e8, 1.0, "P1", 1 / 16, "equilateral"),
    ("cantilever", 1e8, 30.0, "P1", 1 / 16, "right"),
    ("cantilever", 1e4, 10.0, "P2", 1 / 8, "right"),
    ("cantilever", 1e6, 0.1, "P2", 1 / 8, "unstructured"),
    ("cantilever", 1e7, 1.0, "P2", 1 / 8, "right"),
    ("cantilever", 1e8, 1.0, "P2", 1 / 8, "right"),
    ("cantilever", 1e8, 100.0, "P2", 1 / 16, "right"),
    ("plate", 1e-3, 0.0, "P1", 1 / 16, "unstructured"),
    ("plate", 1e-3, 0.0, "P2", 1 / 8, "right"),
    ("plate", 1.0, 0.0, "P1", 1 / 16, "cross"),
    ("plate", 1e3, 0.0, "P2", 1 / 8, "right"),
    ("plate", 1e5, 0.01, "P1", 1 / 24, "right"),
    ("membrane", 0.01, 1e-4, "P1", 1 / 16, "right"),
    ("membrane", 0.1, 1e-3, "P2", 1 / 8, "unstructured"),
    ("membrane", 0.001, 1.0, "P1", 1 / 24, "cross"),
    ("blown", 0.0, 100.0, "P1", 0.06, "StVK"),
    ("blown", -0.05, 100.0, "P1", 0.06, "StVK"),
    ("blown", -0.02, 30.0, "P2", 0.12, "NeoHookean"),
    ("blown", 0.02, 300.0, "P2", 0.12, "StVK"),
    ("buckled", 0.01, 1e5, "P1", 1 / 24, "right"),
    ("buckled", 0.1, 1e4, "P1", 1 / 24, "unstructured"),
    ("buckled", 0.3, 1e6, "P1", 1 / 24, "right"),
    ("buckled", 0.05, 1e5, "P2", 1 / 12, "right"),
    ("buckled", 0.3, 1e7, "P2", 1 / 12, "right"),
    ("curtain", 0.1, 1e-4, "P1", 1 / 24, "right"),
    ("curtain", 0.3, 1e-5, "P1", 1 / 24, "unstructured"),
    ("curtain", 0.3, 1e-5, "P2", 1 / 12, "right"),
    ("corners", 100.0, 1e-3, "P1", 1 / 40, "unstructured"),
    ("corners", 1000.0, 1e-5, "P1", 1 / 40, "right"),
    ("corners", 3000.0, 1e-4, "P2", 1 / 20, "unstructured"),
    ("sheared", 0.05, 0.02, "P1", 1 / 16, "StVK"),
    ("sheared", 0.1, 0.005, "P2", 1 / 10, "StVK"),
    ("on_ball", 0.15, 1 / 24, "P1", 1e-4, "unstructured"),
    ("membrane", 0.01, 100.0, "P1", 1 / 500, "right"),
    ("plate", 1.0, 0.001, "P1", 1 / 500, "right"),
)
QUICK = (2, 6, 8, 13, 17, 20, 24, 30)  # numbers of problems, of each kind


def solve(number: int) -> dict:
    """Solve a problem with the default tolerance, and return its figures."""
    name, *values = PROBLEMS[number]
    system, start = FUNCTIONS[name](*values)
    begin = time.process_time()
    try:
        end = fc.equilibrium(system, start)
    except fc.EquilibriumFailed as failure:
        return {"failure": str(failure), "seconds": time.process_time() - begin}
    seconds, moved = time.process_time() - begin, distance(end.x, start.x)
    error = distance(solve_finely(system, end, moved), end.x) / moved
    return {
        "failure": "",
        "triangles": len(system.cloth.triangles),
        "iterations": end.iterations,
        "seconds": seconds,
        "moved": moved,
        "stated": end.solver_error / moved,
        "error": error,
        "reason": end.reason,
    }


def distance(x: np.ndarray, y: np.ndarray) -> float:
    """The largest distance of a node [m]."""
    return float(np.linalg.norm(x - y, axis=1).max())


def solve_finely(system: fc.System, end: fc.State, moved: float) -> np.ndarray:
    """Positions (n, 3) [m] to which an independent iteration leads from disturbed ones."""
    X = system.cloth.X
    waves = np.sin(2 * np.pi * (X @ [[1, 2, 0.5], [0.7, -1, 2]]) / np.ptp(X))
    disturbed = end.x.copy()
    free = system.free
    disturbed.reshape(-1)[free] += DISTURBANCE * moved * waves.reshape(-1)[free]
    if len(system.cloth.triangles) > LARGE:
        return fc.equilibrium(system, system.state(disturbed)).x
    x, before = disturbed, np.inf
    for _ in range(MOST):
        state = system.state(x)
        force = system.force(state).reshape(-1)[free]
        K = system.stiffness(state).tocsc()[free][:, free]
        step = splu(K).solve(force)
        longest = float(abs(step).max())
        if longest > 0.5 * before and before < DISTURBANCE * moved:
            break
        x, before = x.copy(), longest
        x.reshape(-1)[free] += step
    return x


def summary(rows: list[dict]) -> list[dict]:
    """A line for each problem: how many are solved, and the extremes of those."""
    lines = []
    for name in dict.fromkeys(PROBLEMS[row["number"]][0] for row in rows):
        own = [row for row in rows if PROBLEMS[row["number"]][0] == name]
        solved = [row for row in own if row["status"] == "ok" and not row["failure"]]
        line = {"problem": name, "cases": len(own), "solved": len(solved)}
        line |= {
            f"most {key}": max(row[key] for row in solved)
            for key in ("triangles", "iterations", "error", "seconds")
            if solved
        }
        lines.append(line)
    return lines


def is_stated(row: dict) -> bool:
    """Whether the equilibrium states an error; it has none where its tangent is not definite."""
    return not math.isnan(row["stated"])


def is_sound(row: dict) -> bool:
    """Whether the error is small, or the reason says that round-off limits it."""
    return not row["failure"] and (row["error"] <= ALLOWED or "round-off" in row["reason"])


def main(argv: list[str] | None = None) -> int:
    """Solve all problems, write table and report, and return the exit status."""
    options = harness.parse_arguments(__doc__ or "", argv)
    numbers = QUICK if options.quick else range(len(PROBLEMS))
    cases = [{"number": number} for number in numbers]
    rows = study.run_cases(cases, solve, **harness.run_options(options))
    solved = [row for row in rows if row["status"] == "ok" and not row["failure"]]
    findings = [
        harness.Finding("problems that are not solved", len(rows) - len(solved), high=0),
        harness.Finding(
            "answers above 1e-5 whose reason names no round-off",
            sum(not is_sound(row) for row in solved),
            high=0,
        ),
        harness.Finding(
            "stated errors that are below a third of the error, and above round-off",
            sum(
                row["error"] > max(3 * row["stated"], ROUND_OFF) for row in solved if is_stated(row)
            ),
            high=0,
        ),
    ]
    page = Path(__file__).with_suffix("")
    return harness.write_report(
        options, TITLE, rows, findings=findings, tables={"By problem": summary(rows)}, page=page
    )


if __name__ == "__main__":
    harness.run_main(main)
