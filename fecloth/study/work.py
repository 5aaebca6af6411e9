"""The size of a run before it: triangles, steps, and the order of magnitude of its time."""

import math
from dataclasses import dataclass

# CPU seconds per triangle: of an implicit step or iteration, of an explicit step, and of meshing
# and binding.
IMPLICIT_STEP = 1e-5
EXPLICIT_STEP = 2e-7
MESHING = 1e-4
LEAST_STEP = 1e-3  # CPU seconds of a step on any mesh
START = 3.0  # CPU seconds of the first run of a process: imports, and machine code from disk
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
    is_explicit
        Whether the steps solve no equations.
    unit
        What the steps are, for messages.
    """

    triangles: float
    steps: float
    is_explicit: bool = False
    unit: str = "steps"

    @property
    def seconds(self) -> float:
        """CPU time [s], without the start of the process: an order of magnitude.

        Ratios of it tell more: how much longer a run takes than a similar one of another size.
        """
        per_triangle = EXPLICIT_STEP if self.is_explicit else IMPLICIT_STEP
        step = LEAST_STEP + self.triangles * per_triangle
        return self.triangles * MESHING + self.steps * step


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
