"""Does contact give known answers as h, dt and the gap are refined?

A sheet bounces, and one slides to rest (Coulomb); a strip is pulled over a cylinder (the capstan
equation); a heavy strip is lifted from a plane (the elastica, a boundary-value problem); a ball is
pushed into a stretched drum (a membrane of revolution). Each is refined by `converge` in h, in dt
where it moves, and in the gap, from the same first level. The ± is that of the finest level, with
the parts of the error that are not refined. A drum that touches a sheet by `SelfContact` has its
error alone.

    python -m studies.contact [--quick]
"""

from __future__ import annotations

from fecloth import study
from studies.contact import references

CLOSE = 1.0  # %, on the finest level
LEAST_COVERED = 0.85  # of the exact values, in value ± uncertainty


def refine(known: references.Known, refined: str, levels: int) -> dict:
    """A row: the figure on the finest level, its ±, the order, and the exact value."""

    def problem(h: float, dt: float | None = None):
        sizes = {"h": known.h, "dt": known.dt, "gap": known.gap, refined: h}
        if refined == "dt":
            sizes |= {"h": known.h, "dt": dt}
        return known.problem(**{name: size for name, size in sizes.items() if size is not None})

    first = known.gap if refined == "gap" else known.h
    sizes = {"h": first} | ({"dt": known.dt, "t_end": known.t_end} if known.dt else {})
    by = "dt" if refined == "dt" else "h"
    result = study.converge(problem, known.quantity, by, levels, **sizes)
    error = 100 * (result.value / known.exact - 1)
    return {
        "problem": known.name,
        "refined": refined,
        "value": result.value,
        "±": result.uncertainty,
        "order": result.order,
        "exact": known.exact,
        "error %": error,
        "error over ±": abs(result.value - known.exact) / result.uncertainty,
        "says": result.verdict.splitlines()[0],
    }
