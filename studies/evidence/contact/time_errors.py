"""Is the stated error in time right where a cloth hits obstacles?

A random sheet of about a hundred triangles falls on a plane, a ball or a box, with a random
restitution of 0 or 1, by backward Euler or BDF2, with steps that are fixed or chosen by their
error. The truth is the same method with fixed steps, of an eighth or of 0.2 ms, compared at eight
times: the largest root mean square of the difference over the largest displacement.

    python -m studies.evidence.contact.time_errors [--quick] [--count 40]
"""

import math
import warnings
from pathlib import Path

import numpy as np

import fecloth as fc
from studies import harness
from studies.contact.motions import distance, march

COUNT, SEED, T_END = 40, 1, 0.08
FINER, FINEST = 8.0, 2e-4  # of fixed steps; [s] of chosen ones
FACTOR, SHARE = 5.0, 0.8


def draw(seed: int) -> tuple[fc.System, fc.State, object, float | None, str]:
    """Return a system, its start, a method, dt (None if chosen) and words for them."""
    r = np.random.default_rng([SEED, seed])
    extent = r.uniform(0.1, 0.4)
    cloth = fc.Cloth.rectangle(extent, extent * r.uniform(0.6, 1), extent / 7)
    numbers = r.uniform(0.05, 0.4), 10 ** r.uniform(1.5, 3), 0.3
    fabric = fc.Fabric(*numbers, bending_rigidity=10 ** r.uniform(-6, -4))
    middle = (extent / 2, extent / 3)
    shapes = {
        "plane": fc.shapes.Plane((0, 0, 0), (0, r.uniform(-0.1, 0.1), 1)),
        "ball": fc.shapes.Sphere((*middle, -extent / 3), extent / 3),
        "box": fc.shapes.Box((*middle, -0.1), (extent / 2, extent / 2, 0.2)),
    }
    kind, e = str(r.choice(list(shapes))), float(r.choice([0.0, 1.0], p=[0.75, 0.25]))
    obstacle = fc.Obstacle(shapes[kind], 2e-3, float(r.choice([0.0, 0.3])), restitution=e)
    system = fc.System(cloth, fabric, [fc.StVK(), fc.PlateBending(), fc.Gravity(), obstacle])
    tilt, v = r.uniform(-0.3, 0.3), 10 ** r.uniform(-0.7, 0.3)
    x = np.column_stack([cloth.X, np.zeros(len(cloth.X))])
    x[:, 1], x[:, 2] = math.cos(tilt) * x[:, 1], math.sin(tilt) * x[:, 1]
    x[:, 2] += 2e-3 + r.uniform(0.1, 0.7) * v * T_END - x[:, 2].min()
    method = (fc.BackwardEuler(), fc.BDF2())[r.integers(2)]
    dt = float(r.choice([8e-3, 4e-3, 2e-3]))
    name = f"{kind}, e = {e:g}, {v:.2g} m/s, {type(method).__name__}, dt {1e3 * dt:g} ms"
    if r.integers(2):
        rtol, dt = 10 ** r.uniform(-0.5, 0.5), None
        method, name = fc.Adaptive(method, rtol=rtol), f"{name.rpartition(',')[0]}, rtol {rtol:.2g}"
    return system, system.state(x, 0 * x - [0, 0, v]), method, dt, name


def measure(seed: int) -> tuple[str, fc.Result, float]:
    """Return the words of a set-up, its run and its true error."""
    system, start, method, dt, name = draw(seed)
    told = march(system, start, method, dt, T_END)
    finer = (method, dt / FINER) if dt else (method.method, FINEST)
    exact = march(system, start, *finer, T_END).places
    error = distance(system, told.places, exact) / distance(system, exact, start.x[None])
    return name, told.run, error


def main() -> int:
    options = harness.parse_arguments(__doc__, count={"type": int, "default": COUNT})
    rows = []
    for seed in range(1 if options.quick else options.count):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", fc.FeclothWarning)
            name, run, true = measure(seed)
        rows.append({"set-up": name, "stated": run.time_error, "true": true})
    ratios = np.array([row["stated"] / row["true"] for row in rows])
    ratios = ratios[np.isfinite(ratios)]
    shares = (ratios >= 1).mean(), (ratios <= FACTOR).mean()
    asked = 0.0 if options.quick else SHARE
    title, what = harness.about(__doc__)
    findings = [
        harness.Finding(f"of {len(rows)} set-ups, errors that are stated", len(ratios)),
        harness.Finding("share that is at least the true error", shares[0], asked),
        harness.Finding(f"share that is at most {FACTOR:g} times that", shares[1], asked),
    ]
    return harness.write_report(
        options,
        title,
        rows,
        conclusion=what,
        findings=findings,
        page=Path(__file__).with_suffix(""),
    )


if __name__ == "__main__":
    harness.run_main(main)
