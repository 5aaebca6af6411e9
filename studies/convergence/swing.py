"""Order in space of a swinging sheet, which has no exact solution: `fc.study.converge`.

All meshes take the same steps, so that their differences are errors in space. The meshes are
nested, so that hinges have the same bending rigidity on all of them.
"""

from __future__ import annotations

from itertools import product

import fecloth as fc
from fecloth import study
from studies import harness

QUANTITIES = {"L2": "displacement in L2", "H1": "displacement in H1"}
QUANTITIES |= {"depth": "mean_displacement.z"}
ORDERS = {"HingeBending": {"L2": (2, 0.15), "H1": (1, 0.1), "depth": (2, 0.15)}}
ORDERS["QuadraticBending"] = ORDERS["HingeBending"]
# Without bending the solution has a moving kink, which limits P1 to h^3/2 and h^1/2.
ORDERS["none"] = {"L2": (1.5, 0.2), "H1": (0.5, 0.15)}
RUN = {"h": 1 / 16, "levels": 3, "dt": 0.003, "t_end": 0.3, "time_limit": 300}
SHORT = {"dt": 0.006, "t_end": 0.12}  # for --quick


def swing(h: float, bending: str, pattern: str):
    """Return a sheet of 1 m × 0.5 m that is pinned on one side and falls."""
    cloth = fc.Cloth.rectangle(1.0, 0.5, h, pattern)
    fabric = fc.Fabric(0.2, 200.0, 0.3, bending_rigidity=1e-2)
    bent = [] if bending == "none" else [getattr(fc, bending)()]
    terms = [fc.StVK(), *bent, fc.StrainRateDamping(2e-3), fc.Gravity()]
    system = fc.System(cloth, fabric, terms, ["left"])
    return cloth, system, fc.ImplicitMidpoint(), system.rest()


def refine_swings(options) -> list[dict]:
    """Return a row for each bending model, pattern and quantity."""
    bendings = ("HingeBending", "none") if options.quick else tuple(ORDERS)
    patterns = ("right",) if options.quick else ("right", "cross")
    how = RUN | (SHORT if options.quick else {}) | harness.run_options(options)
    cache = how.pop("out")
    rows = []
    for bending, pattern, name in product(bendings, patterns, QUANTITIES):
        found = study.converge(
            swing, QUANTITIES[name], bending=bending, pattern=pattern, cache=cache, **how
        )
        row = {"bending": bending, "pattern": pattern, "quantity": name, "order": found.order}
        row |= {"value": found.value, "uncertainty": found.uncertainty, "limit": found.limit}
        failed = {"status": "failed", "cause": found.verdict} if found.estimate is None else {}
        rows.append(row | failed)
    return rows


def conclude_swings(rows: list[dict]) -> list[harness.Finding]:
    """Return the findings for the observed orders."""
    findings = []
    for row in rows:
        if row["quantity"] in ORDERS[row["bending"]]:
            theory, tolerance = ORDERS[row["bending"]][row["quantity"]]
            what = f"swing, {row['bending']}, {row['pattern']}: order of {row['quantity']}"
            low, high = theory - tolerance, theory + tolerance
            findings.append(harness.Finding(what, row["order"], low, high))
    return findings
