"""The size of a run before it: triangles, steps, and the order of magnitude of its time."""

import math
from dataclasses import dataclass
from pathlib import Path

from fecloth.compiled.cache_folder import cache_folder

START = 3.0  # CPU seconds of the first run of a process: imports, and machine code from disk
COMPILATION = 20.0  # CPU seconds of kernels whose machine code is not on disk
MESHING = 3e-5  # CPU seconds per triangle of meshing and binding
# CPU seconds by the kind of steps on n triangles: of a case beside its steps, of any step, and
# of a step in proportion to n^p, with p = 1.3 where equations are solved. They are fitted to
# scenes of 26 to 3,700 triangles; what other terms cost, the first case of a study tells.
RATES = {
    "explicit": (0.02, 1.4e-3, 1e-6, 1.0),
    "implicit": (0.02, 4e-3, 1.5e-6, 1.3),
    "with contact": (0.02, 4.5e-2, 4.5e-6, 1.3),
    "static": (0.1, 1e-3, 7e-7, 1.3),  # of a Newton iteration
}
CHOSEN_STEPS = 300  # guessed steps of a run that chooses its steps by their error
LOAD_STEP = 10  # Newton iterations of a load step
LONGEST = 3600.0  # estimated time [s]: above it a study does not start, or go on, by itself
ANYWAY = "most_seconds = None, as a command --yes, runs it anyway."


@dataclass(frozen=True)
class Work:
    """The estimated size of a run.

    Attributes
    ----------
    triangles
        Number of triangles.
    steps
        Number of steps, or of iterations.
    kind
        Kind of the steps, one of `RATES`.
    """

    triangles: float
    steps: float
    kind: str = "implicit"

    @property
    def unit(self) -> str:
        """What the steps are, for messages."""
        return "Newton iterations" if self.kind == "static" else "steps"

    @property
    def seconds(self) -> float:
        """CPU time [s], without the start of the process: an order of magnitude.

        Ratios of it tell more: how much longer a run takes than a similar one of another size.
        """
        case, least, rate, power = RATES[self.kind]
        step = least + rate * self.triangles**power
        return case + self.triangles * MESHING + self.steps * step


def start_seconds() -> float:
    """CPU time of the first run of a process beside the run itself [s]: start and compilation."""
    has_machine_code = any(Path(cache_folder()).iterdir())
    return START if has_machine_code else START + COMPILATION


def in_words(seconds: float) -> str:
    """Return a time as text with one unit."""
    if seconds >= 2 * 3600:
        return f"{seconds / 3600:,.0f} h"
    if seconds >= 1.5 * 60:
        return f"{seconds / 60:,.0f} min"
    return f"{max(seconds, 1):.0f} s"


def in_magnitude(seconds: float) -> str:
    """Return the order of magnitude of a time in words, such as "about 10 s" or "hours"."""
    steps = {"some seconds": 10, "half a minute": 60, "minutes": 600, "half an hour": 3600}
    for words, longest in steps.items():
        if seconds < longest:
            return words
    if seconds < 24 * 3600:
        return "hours"
    return f"{math.ceil(seconds / 86400):,.0f} days"
