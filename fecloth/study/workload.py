"""The size of a study before its first case: cases, triangles, steps and time."""

import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass

from fecloth.errors import InputError, amount
from fecloth.integrators import EXPLICIT
from fecloth.scene.scene import Scene
from fecloth.simulation.dimensionless import wave_speed

# CPU seconds per triangle, as with StVK and hinges: of a step, and of the set-up.
IMPLICIT_STEP = 1e-5
EXPLICIT_STEP = 2e-7
BINDING = 3e-5
# CPU seconds of a step on any mesh, as with plates, damping, energies and a probe.
IMPLICIT_LEAST = 2e-3
EXPLICIT_LEAST = 8e-4
STABLE_STEP = 0.4  # stable step of central differences over h / wave speed, as with StVK
LONGEST = 3600.0  # predicted time [s]: above it a study does not start by itself
CHOSEN_STEPS = 300  # guessed steps of a run that chooses its steps by their error
ITERATIONS = "Newton iterations"  # of an equilibrium
LOAD_STEP = 10  # Newton iterations of a load step, each as long as a step in time
TRIANGLES = {"right": 2.0, "cross": 4.0}  # triangles per h²
EQUILATERAL = 4 / math.sqrt(3)
ANYWAY = "most_seconds = None, as a command --yes, runs it anyway."
COARSEST = 30  # edge length over h of the first mesh that is tried for the area of a shape


@dataclass(frozen=True)
class Workload:
    """The predicted size of a case: its triangles, its steps and the CPU time [s].

    Attributes
    ----------
    triangles
        Number of triangles.
    steps
        Number of steps, or of iterations.
    is_explicit
        Whether the steps are explicit.
    unit
        What the steps are, for messages.
    """

    triangles: float
    steps: float
    is_explicit: bool = False
    unit: str = "steps"

    @property
    def seconds(self) -> float:
        """Predicted CPU time [s]: right within a factor of about three."""
        step = IMPLICIT_STEP
        least = IMPLICIT_LEAST
        if self.is_explicit:
            step = EXPLICIT_STEP
            least = EXPLICIT_LEAST
        return self.triangles * BINDING + self.steps * (least + self.triangles * step)

    def coarser(self, k: float) -> "Workload":
        """Return the size with edges k times as long; explicit steps are as much longer."""
        steps = self.steps
        if self.is_explicit:
            steps /= k
        return Workload(self.triangles / k**2, steps, self.is_explicit, self.unit)

    @classmethod
    def of(cls, scene: Scene) -> "Workload":
        """Predict the size of a scene."""
        triangles = count_triangles(scene)
        steps = count_steps(scene)
        if scene.equilibrium:
            return cls(triangles, steps, unit=ITERATIONS)
        return cls(triangles, steps, is_explicit=scene.time.method.type in EXPLICIT)


def count_triangles(scene: Scene) -> float:
    """Estimate the number of triangles from area and h, without gradings or the mesh."""
    cloth = scene.cloth
    if cloth.h is None:
        return len(scene.mesh().triangles)
    triangles_per_h2 = TRIANGLES.get(getattr(cloth, "pattern", ""), EQUILATERAL)
    return _estimate_area(scene) / cloth.h**2 * triangles_per_h2


def _estimate_area(scene: Scene) -> float:
    """Return the area of the cloth [m²].

    For a shape without a formula it is the area of a coarse mesh, which is made quickly: first
    with 30 h, then with ever finer edges until the shape can be meshed. Raise `InputError` if it
    cannot be meshed with h either.
    """
    cloth = scene.cloth
    if cloth.shape == "rectangle":
        return cloth.width * cloth.height
    if cloth.shape == "disk":
        return math.pi * cloth.radius**2
    factor = float(COARSEST)
    while factor > 1:
        try:
            return cloth.model_copy(update={"h": factor * cloth.h}).cloth().area
        except InputError:  # too coarse for a shape with small parts
            factor /= 2
    return scene.mesh().area  # raises the error with its place in the scene


def count_steps(scene: Scene) -> float:
    """Return the number of steps; a load step takes as long as several steps in time.

    For an equilibrium it is the number of Newton iterations. If an implicit run chooses its
    steps, it is a guess, `CHOSEN_STEPS`.
    """
    if scene.equilibrium:
        return LOAD_STEP * scene.equilibrium.load_steps
    if scene.time.dt != "auto":
        return math.ceil(_span(scene) / scene.time.dt - 1e-9)
    if scene.time.method.type in EXPLICIT:
        return _count_explicit_steps(scene)
    return CHOSEN_STEPS


def _count_explicit_steps(scene: Scene) -> float:
    """Estimate the number of stable steps of an explicit method.

    The stable step is in proportion to h / c, with the speed c of waves of stretching in the
    stiffest fabric, and the smallest h of all gradings.
    """
    fabric_tables = list((scene.fabrics or {}).values())
    if scene.fabric:
        fabric_tables = [scene.fabric]
    speed = max(wave_speed(table.make()) for table in fabric_tables if table)
    h = scene.cloth.h or math.sqrt(EQUILATERAL * scene.mesh().area / count_triangles(scene))
    shortest = h * min([1.0, *(table.make().smallest(h) for table in scene.cloth.grading)])
    return math.ceil(_span(scene) * speed / (STABLE_STEP * shortest))


def _span(scene: Scene) -> float:
    """Return the length of the run [s]."""
    return scene.schedule.t_end - scene.schedule.t_start


def check_size(
    cases: Sequence[Workload],
    jobs: int,
    most_seconds: float | None,
    where: str,
    remedy: str = ANYWAY,
) -> None:
    """Print the size of a study before it begins: cases, triangles, steps and predicted time.

    Raise `InputError`, which names `where` and ends with the `remedy`, if the predicted time is
    above `most_seconds` [s]; None is no limit. `jobs` is the number of processes, which share
    the time.
    """
    seconds = sum(case.seconds for case in cases) / jobs
    count = amount(len(cases), "case")
    most_triangles = max(case.triangles for case in cases)
    most_steps = max(case.steps for case in cases)
    size = f"{count}, up to {most_triangles:,.0f} triangles × {most_steps:,.0f} {cases[0].unit}"
    print(f"{size}; predicted: about {in_words(seconds)}", file=sys.stderr, flush=True)
    if most_seconds is not None and seconds > most_seconds:
        allowed = f"predicted time above {in_words(most_seconds)}"
        advice = f"Check the size of the cloth, h and dt; {remedy}"
        raise InputError(size, allowed, where, advice)


def in_words(seconds: float) -> str:
    """Return a time as text with one unit."""
    if seconds >= 2 * 3600:
        return f"{seconds / 3600:,.0f} h"
    if seconds >= 1.5 * 60:
        return f"{seconds / 60:,.0f} min"
    return f"{max(seconds, 1):.0f} s"
