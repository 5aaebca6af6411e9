"""The public names of `fecloth.study` and the modules that define them."""

from .cases import Case, run_cases
from .chart_result import Chart
from .charts import chart
from .command import (
    Parser,
    StudyFailed,
    parse_arguments,
    require_packages,
    run_main,
    run_options,
)
from .comparing import compare
from .comparison import Comparison, Difference
from .convergence import Convergence
from .converging import converge
from .figures import (
    COLOURS,
    MARKERS,
    draw_lines,
    draw_slope_triangle,
    figure,
    line_style,
    mark_failures,
    new_figure,
)
from .front import Study, of
from .overlay import Overlay, compare_runs
from .reports import Finding, hardware, require_results, write_csv, write_report
from .result import StudyResult, Table
from .simplification.result import Simplification
from .simplification.simplify import simplify
from .stability_map import StabilityMap, stability
from .status import Seconds, TimeLimit, check_time_limit, measure_seconds
from .sweeps import Sweep, sweep
from .uncertainty import Estimate, estimate_uncertainty

__all__ = [
    "COLOURS",
    "MARKERS",
    "Case",
    "Chart",
    "Comparison",
    "Convergence",
    "Difference",
    "Estimate",
    "Finding",
    "Overlay",
    "Parser",
    "Seconds",
    "Simplification",
    "StabilityMap",
    "Study",
    "StudyFailed",
    "StudyResult",
    "Sweep",
    "Table",
    "TimeLimit",
    "chart",
    "check_time_limit",
    "compare",
    "compare_runs",
    "converge",
    "draw_lines",
    "draw_slope_triangle",
    "estimate_uncertainty",
    "figure",
    "hardware",
    "line_style",
    "mark_failures",
    "measure_seconds",
    "new_figure",
    "of",
    "parse_arguments",
    "require_packages",
    "require_results",
    "run_cases",
    "run_main",
    "run_options",
    "simplify",
    "stability",
    "sweep",
    "write_csv",
    "write_report",
]
