"""What the studies share: cases that are run, kept and resumed, honest seconds, figures, reports.

A study is a list of settings, a function of them that returns numbers, and a conclusion in
numbers that sets the exit code:

    from fecloth import study

    import fecloth as fc


    def swing(method: str, dt: float) -> dict:
        cloth = fc.Cloth.rectangle(1.0, 1.0, h=0.1)
        system = fc.System(cloth, fc.Fabric(0.2, 1000.0), [fc.StVK(), fc.Gravity()], ["left"])
        run = fc.run(system, getattr(fc, method)(), system.rest(), dt, 0.5, report=study.tick)
        return {"sag": -run.state.x[:, 2].min()}


    def main() -> int:
        options = study.arguments(__doc__)
        sizes = (0.02, 0.01) if options.quick else (0.02, 0.01, 0.005, 0.0025)
        cases = [{"method": m, "dt": dt} for m in ("BackwardEuler", "BDF2") for dt in sizes]
        rows = study.run_cases(cases, swing, **study.running(options), time_limit=60)
        with study.figure(options.out, "sag", "time step [s]", "sag [m]") as (figure, ax):
            study.lines(ax, rows, x="dt", y="sag", by="method")
        sags = [row["sag"] for row in rows if row["status"] == "ok"]
        findings = [study.Finding("sag spread [m]", max(sags) - min(sags), high=0.05)]
        return study.report(options, "Swing", rows, figures=["sag"], findings=findings)


    if __name__ == "__main__":
        raise SystemExit(main())

`from fecloth import study` stands before NumPy's import: it pins every library to one thread.
"""

from fecloth.study import threads  # noqa: F401  before NumPy
from fecloth.study.cases import Case, run_cases
from fecloth.study.figures import (
    COLOURS,
    MARKERS,
    figure,
    lines,
    mark_failures,
    slope_triangle,
    style,
)
from fecloth.study.options import arguments, running
from fecloth.study.reports import Finding, hardware, report, write_csv
from fecloth.study.status import TimeLimit, tick
from fecloth.study.timing import Seconds, timed

__all__ = [
    "COLOURS",
    "MARKERS",
    "Case",
    "Finding",
    "Seconds",
    "TimeLimit",
    "arguments",
    "figure",
    "hardware",
    "lines",
    "mark_failures",
    "report",
    "run_cases",
    "running",
    "slope_triangle",
    "style",
    "tick",
    "timed",
    "write_csv",
]
