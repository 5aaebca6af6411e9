"""What is doubtful before the first step: lists of checks, and the place that walks them.

A check is a function of a `PlannedRun` that yields a `Doubt` for each mistake that it notices.
"""

from collections.abc import Callable, Iterable, Iterator

from fecloth.simulation.doubts import course, jumps, pins, terms, units, unseen
from fecloth.simulation.doubts.doubt import Doubt
from fecloth.simulation.doubts.planned_run import PlannedRun

Check = Callable[[PlannedRun], Iterable[Doubt]]

OF_EQUILIBRIA: tuple[Check, ...] = (
    units.find_values_in_other_units,
    terms.find_no_membrane,
    terms.find_counted_twice,
    terms.find_springs_of_another_fabric,
    terms.find_ignored_poisson_ratio,
    terms.find_lowered_coupling,
    terms.find_unused_bending,
    terms.find_bending_unknown_to_hinges,
    terms.find_friction_without_plate,
    terms.find_uneven_edges,
    terms.find_gas_without_pressure,
    terms.find_gravity_upwards,
    terms.find_other_gaps,
    terms.find_cutting_edges,
    pins.find_idle_pins,
    course.find_slow_factors,
)
OF_RUNS: tuple[Check, ...] = (  # in the order of the warnings
    *OF_EQUILIBRIA,
    terms.find_damping_of_other_bending,
    pins.find_uneven_start,
    course.find_step_beyond_end,
    unseen.find_missed,
    unseen.find_missed_by_load_steps,
    unseen.find_short_pulses,
)
OF_MARCH: tuple[Check, ...] = (jumps.find_motion_jumps,)
OF_SCENES: tuple[Check, ...] = (
    *OF_RUNS,
    terms.find_no_terms,
    course.find_slivers,
    course.find_large_weight,
    course.find_short_steps,
)
# What a scene says as a note: facts, or causes of which the end of a run says whether they
# matter (see `Verdict`).
NOTES: tuple[Check, ...] = (
    pins.find_free_fall,
    pins.find_free_turn,
    course.find_flat_start,
    jumps.find_motion_jumps,
    course.find_fast_waves,
    course.find_numerical_damping,
)


def find_doubts(run: PlannedRun, checks: Iterable[Check] = OF_RUNS) -> Iterator[Doubt]:
    """Yield what the checks notice in a run before its first step."""
    for check in checks:
        yield from check(run)
