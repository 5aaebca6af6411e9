"""Studies of your own problem, and the engine of refinement, comparison and cost studies.

A study is a list of settings, a function that takes one setting and returns numbers, and findings:
numbers with an expected range. The exit status is 0 if all are met, 1 if one is missed, 2 for a
mistake in the input, 3 if a case failed.

    from fecloth import study

    import fecloth as fc


    def swing(method: str, dt: float) -> dict:
        cloth = fc.Cloth.rectangle(1.0, 1.0, h=0.1)
        system = fc.System(cloth, fc.Fabric(0.2, 1000.0), [fc.StVK(), fc.Gravity()], ["left"])
        method, limit = getattr(fc, method)(), study.check_time_limit
        run = fc.run(system, method, system.rest(), dt, 0.5, report=limit)
        return {"sag": -run.state.x[:, 2].min()}


    def main() -> int:
        options = study.parse_arguments(__doc__, needs=["matplotlib"])
        sizes = (0.02, 0.01) if options.quick else (0.02, 0.01, 0.005, 0.0025)
        cases = [{"method": m, "dt": dt} for m in ("BackwardEuler", "BDF2") for dt in sizes]
        rows = study.run_cases(cases, swing, **study.run_options(options), time_limit=60)
        study.require_results(options, "Swing", rows)
        with study.figure(options.out, "sag", "time step [s]", "sag [m]") as (figure, ax):
            study.draw_lines(ax, rows, x="dt", y="sag", by="method")
        sags = [row["sag"] for row in rows if row["status"] == "ok"]
        findings = [study.Finding("sag spread [m]", max(sags) - min(sags), high=0.05)]
        return study.write_report(options, "Swing", rows, figures=["sag"], findings=findings)


    if __name__ == "__main__":
        study.run_main(main)

`converge` studies a scene or a function of yours, and returns a result with a verdict, a table, a
figure and a report.

The public names stand in ``__init__.pyi``. Each is imported when it is first used. A script whose
cases run in its own process imports `fecloth.study.threads` before NumPy, which limits every
library to one thread.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
