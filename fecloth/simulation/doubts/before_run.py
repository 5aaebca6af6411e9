"""The warnings before the first step: a list of doubts, and the place that walks it.

A doubt is a function of a `PlannedRun` that yields sentences, each with a remedy, or "" for
none.
"""

from collections.abc import Callable, Iterable, Iterator

from fecloth.simulation.doubts import course, jumps, pins, terms, units, unseen
from fecloth.simulation.doubts.planned_run import PlannedRun

Doubt = Callable[[PlannedRun], Iterable[str]]

OF_EQUILIBRIA: tuple[Doubt, ...] = (
    units.find_values_in_other_units,
    terms.find_no_membrane,
    terms.find_counted_twice,
    terms.find_springs_of_another_fabric,
    terms.find_ignored_poisson_ratio,
    terms.find_lowered_coupling,
    terms.find_bending_unknown_to_hinges,
    terms.find_friction_without_plate,
    terms.find_gas_without_pressure,
    terms.find_cutting_edges,
    pins.find_idle_pins,
)
DOUBTS = (  # of `run`, in the order of the warnings
    *OF_EQUILIBRIA,
    terms.find_damping_of_other_bending,
    *(pins.find_uneven_start, course.find_step_beyond_end),
    *(unseen.find_missed, unseen.find_short_pulses),
)
OF_MARCH: tuple[Doubt, ...] = (jumps.find_motion_jumps,)
OF_SCENES: tuple[Doubt, ...] = (
    *DOUBTS,
    course.find_slivers,
    course.find_large_weight,
    course.find_short_steps,
    course.find_numerical_damping,
)
NOTES: tuple[Doubt, ...] = (  # facts, no doubts
    *(pins.find_free_fall, pins.find_free_turn, course.find_flat_start),
    # The end of a run says whether these matter: see `Verdict`.
    *(jumps.find_motion_jumps, course.find_fast_waves),
)


def find_warnings(run: PlannedRun, doubts: Iterable[Doubt] = DOUBTS) -> Iterator[str]:
    for doubt in doubts:
        yield from filter(None, doubt(run))
