"""Cost of each term, in nanoseconds per triangle and relative to StVK.

    python -m studies.evidence.benchmarks.terms

Force and tangent on an unstructured square, on one thread, the minimum of several runs.
"""

from __future__ import annotations

import dataclasses

import numpy as np

import fecloth as fc
from fecloth import terms  # study first: one thread for every library
from fecloth.linalg.block_matrix import BlockMatrix
from studies import harness
from studies.evidence.benchmarks.measure import square

FABRIC = fc.Fabric(0.2, 1000.0, 0.3, bending_rigidity=1e-5, bending_hysteresis=1e-3)
ARGUMENTS = {
    "BaraffWitkin": {"area_exponent": 0.5},
    "BendingDamping": {"time": 0.01},
    "Drag": {"normal": 1.0, "tangential": 0.1},
    "MassDamping": {"rate": 1.0},
    "MembraneTable": {
        "warp": [(1.01, 4.0), (1.05, 40.0), (1.1, 200.0), (1.2, 900.0)],
        "weft": [(1.01, 4.0), (1.05, 40.0), (1.1, 200.0), (1.2, 900.0)],
        "shear": [(0.1, 5.0), (0.3, 30.0), (0.5, 200.0)],
    },
    "Pressure": {"p": 1.0},
    "Springs": {"kind": "biquadratic"},
    "StrainRateDamping": {"time": 0.01},
    "TensorCondition": {"k": 250.0},
}


def make_terms() -> list:
    """Return every term that needs no place on the cloth and no function."""
    made = []
    for name in terms.__all__:
        cls = getattr(terms, name)
        if not (dataclasses.is_dataclass(cls) and hasattr(cls, "bind")):
            continue
        try:
            made.append(cls(**ARGUMENTS.get(name, {})))
        except fc.InputError:  # needs a place, a function, ...
            continue
    return made


def cost(term, cloth: fc.Cloth) -> tuple[float, float]:
    """Return the times of force and tangent [ns per triangle]."""
    system = fc.System(cloth, FABRIC, [term])
    system = system.with_history(system.start_history(system.rest()))
    X, m = cloth.X, len(cloth.triangles)
    x = np.column_stack([1.02 * X, 0.02 * np.sin(3 * X[:, 0])])
    v = np.column_stack([0.1 * X, 0.2 * np.sin(5 * X[:, 1])])
    J, f, bound = BlockMatrix.zeros(system.pattern), np.zeros_like(x), system.bound[0]
    force = harness.measure_seconds(lambda: bound.add_force(x, v, 0.0, f), 7).wall
    tangent = harness.measure_seconds(
        lambda: bound.add_tangent(x, v, 0.0, 1.0, 1.0, J, False), 7
    ).wall
    return 1e9 * force / m, 1e9 * tangent / m


def main() -> None:
    parser = harness.Parser(description=__doc__)
    parser.add_argument("--triangles", type=int, default=20_000)
    parser.add_argument("--quick", action="store_true", help="a small mesh")
    options = parser.parse_args()
    cloth = square(2_000 if options.quick else options.triangles)
    unit_force, unit_tangent = cost(fc.StVK(), cloth)
    print(f"{'term':<20} {'force':>9} {'x StVK':>7} {'tangent':>9} {'x StVK':>7}   ns per triangle")
    for term in make_terms():
        force, tangent = cost(term, cloth)
        relative = f"{force / unit_force:>7.2f} {tangent:>9.1f} {tangent / unit_tangent:>7.2f}"
        print(f"{type(term).__name__:<20} {force:>9.1f} {relative}")


if __name__ == "__main__":
    harness.run_main(main)
