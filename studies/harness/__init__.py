"""What the studies share: cases that are run, kept and resumed, honest seconds, figures, reports.

A study is a list of settings, a function of them that returns numbers, and a conclusion in
numbers that sets the exit code:

    import harness

    import fecloth as fc


    def swing(method: str, dt: float) -> dict:
        cloth = fc.Cloth.rectangle(1.0, 1.0, h=0.1)
        system = fc.System(cloth, fc.Fabric(0.2, 1000.0), [fc.StVK(), fc.Gravity()], ["left"])
        run = fc.run(system, getattr(fc, method)(), system.rest(), dt, 0.5, report=harness.tick)
        return {"sag": -run.state.x[:, 2].min()}


    def main() -> int:
        options = harness.arguments(__doc__)
        sizes = (0.02, 0.01) if options.quick else (0.02, 0.01, 0.005, 0.0025)
        cases = [{"method": m, "dt": dt} for m in ("BackwardEuler", "BDF2") for dt in sizes]
        rows = harness.run_cases(cases, swing, **harness.running(options), time_limit=60)
        with harness.figure(options.out, "sag", "time step [s]", "sag [m]") as (figure, ax):
            harness.lines(ax, rows, x="dt", y="sag", by="method")
        sags = [row["sag"] for row in rows if row["status"] == "ok"]
        findings = [harness.Finding("sag spread [m]", max(sags) - min(sags), high=0.05)]
        return harness.report(options, "Swing", rows, figures=["sag"], findings=findings)


    if __name__ == "__main__":
        raise SystemExit(main())

`import harness` stands before NumPy's import: it pins every library to one thread.
"""

from . import threads  # noqa: F401  before NumPy
from .cases import Case, run_cases
from .failures import TimeLimit, tick
from .figures import COLOURS, MARKERS, figure, lines, mark_failures, slope_triangle, style
from .options import arguments, running
from .reports import Finding, hardware, report, write_csv
from .timing import Seconds, timed

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
