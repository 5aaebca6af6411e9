"""The public names of `fecloth.study` and the modules that define them."""

from .budgeting.budget import budget
from .budgeting.result import Budget
from .cases import Case, run_cases
from .charts import chart
from .command import StudyFailed, require_packages
from .comparing import compare
from .comparison import Comparison, Difference
from .convergence import Convergence
from .converging import converge
from .figures import COLOURS, MARKERS, line_style, mark_failures, new_figure
from .fitting.file import fit
from .fronts.front import front
from .fronts.result import Front
from .overlay import Overlay, compare_runs
from .result import StudyResult, Table, write_csv
from .sensitivities import sensitivity
from .sensitivity_result import Sensitivity
from .simplification_result import Simplification
from .simplifying import simplify
from .stability_map import StabilityMap, stability
from .status import TimeLimit, check_time_limit
from .study import Study, of
from .sweeps import Sweep, sweep
from .uncertainty import Estimate, estimate_uncertainty

__all__ = [
    "COLOURS",
    "MARKERS",
    "Budget",
    "Case",
    "Comparison",
    "Convergence",
    "Difference",
    "Estimate",
    "Front",
    "Overlay",
    "Sensitivity",
    "Simplification",
    "StabilityMap",
    "Study",
    "StudyFailed",
    "StudyResult",
    "Sweep",
    "Table",
    "TimeLimit",
    "budget",
    "chart",
    "check_time_limit",
    "compare",
    "compare_runs",
    "converge",
    "estimate_uncertainty",
    "fit",
    "front",
    "line_style",
    "mark_failures",
    "new_figure",
    "of",
    "require_packages",
    "run_cases",
    "sensitivity",
    "simplify",
    "stability",
    "sweep",
    "write_csv",
]
