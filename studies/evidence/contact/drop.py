"""A sheet that falls on a ball: whether a point ever enters, and what a step costs.

The sheet of 0.4 m (200 g/m², 1000 N/m) starts 5 mm above a ball of 0.1 m, with μ = 0.3, a gap of
1 mm and steps of 10 ms. The least distance is taken over all points at the end of every step. The
full form takes 2 s and writes drop.md. With --self-contact the sheet cannot pass through itself
either (gap 1 mm, μ = 0.3). That is 0.3 s of 8,000 triangles: the impact, and the first folds that
touch.

    python -m studies.evidence.contact.drop [--self-contact] [--quick]
"""

from __future__ import annotations

import inspect
import time
import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import fecloth as fc
from studies import harness

SIZE, RADIUS, GAP = 0.4, 0.1, 1e-3
ITSELF = fc.SelfContact(GAP, friction=0.3)


@dataclass(frozen=True)
class Drop:
    """What a run with the ball gave.

    Attributes
    ----------
    triangles, steps, newton
        Numbers; Newton iterations of all steps.
    seconds
        CPU time of the steps [s].
    least
        Least distance of any point of the cloth from the ball, of all steps [m].
    gain
        Largest total energy after the start, less the energy at the start [J].
    drop
        How far the lowest node is below the top of the ball at the end [m].
    """

    triangles: int
    steps: int
    newton: int
    seconds: float
    least: float
    gain: float
    drop: float


def make(
    h: float, friction: float = 0.3, more: tuple[fc.SelfContact, ...] = ()
) -> tuple[fc.System, fc.State]:
    """A sheet of 0.4 m, 5 mm above the top of a ball of 0.1 m, and at rest."""
    cloth = fc.Cloth.rectangle(SIZE, SIZE, h)
    fabric = fc.Fabric(0.2, 1000.0, 0.3, bending_rigidity=1e-5)
    ball = fc.shapes.Sphere((SIZE / 2, SIZE / 2, -RADIUS), RADIUS)
    terms = [fc.StVK(), fc.PlateBending(), fc.Gravity(), fc.StrainRateDamping(time=1e-3)]
    system = fc.System(cloth, fabric, [*terms, *more, fc.Obstacle(ball, GAP, friction)])
    x = np.column_stack([cloth.X, np.full(len(cloth.X), 5e-3)])
    return system, system.state(x)


def drop(h: float, t_end: float, method, more: tuple[fc.SelfContact, ...] = ()) -> Drop:
    """Let the sheet fall in steps of 10 ms, and look at every step."""
    system, start = make(h, more=more)
    obstacle, newton, seconds, steps = system.bound[-1], 0, 0.0, 0
    first = sum(system.energies(start).values())
    least, gain, state = np.inf, -np.inf, start
    begin = time.process_time()
    for state, info in fc.march(system, method, start, 0.01, t_end):
        seconds += time.process_time() - begin
        newton, steps = newton + info.counts.newton, steps + 1
        least = min(least, obstacle.least_distance(state.x, state.t))
        gain = max(gain, sum(system.energies(state).values()) - first)
        begin = time.process_time()
    fallen = -float(state.x[:, 2].min())
    triangles = len(system.cloth.triangles)
    return Drop(triangles, steps, newton, seconds, float(least), float(gain), fallen)


def row(method, result: Drop) -> str:
    """A line of the table."""
    each = result.newton / result.steps, result.seconds / result.steps, 1e3 * result.least
    shown = " | ".join(f"{number:.3g}" for number in each)
    gain = "none" if result.gain <= 0 else f"{1e6 * result.gain:.2g} µJ"
    name = type(method).__name__
    return f"| {name} | {result.triangles} | {result.steps} | {shown} | {gain} |"


def main() -> None:
    """Print the table, and write drop.md in the full form."""
    parser = harness.Parser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="a coarse mesh, for 0.3 s")
    text = "the sheet does not pass through itself"
    parser.add_argument("--self-contact", action="store_true", help=text)
    options = parser.parse_args()
    quick = options.quick
    warnings.simplefilter("ignore", fc.FeclothWarning)
    full = [(0.0136, fc.BackwardEuler()), (0.0136, fc.BDF2()), (0.0068, fc.BackwardEuler())]
    more = (ITSELF,) if options.self_contact else ()
    runs = [(0.05, fc.BDF2())] if quick else full[2:] if more else full
    lines = [
        f"# A sheet on a ball\n\n{inspect.cleandoc(__doc__.split('    python')[0])}\n",
        "| method | triangles | steps | Newton a step | CPU s a step | least distance [mm] | "
        "energy gained |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    for h, method in runs:
        lines.append(row(method, drop(h, 0.3 if quick or more else 2.0, method, more)))
    text = "\n".join(lines) + "\n"
    print(text)
    if not (quick or more):
        (Path(__file__).parent / "drop.md").write_text(text, encoding="utf-8")
        print("wrote studies/evidence/contact/drop.md")


if __name__ == "__main__":
    harness.run_main(main)
