"""What all studies of a problem share: the problem, opened once, and how its cases run."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from fecloth.errors import InputError
from fecloth.quantities.arguments import checks_arguments
from fecloth.quantities.units import LENGTH, TIME
from fecloth.scene.scene import Scene
from fecloth.simulation.doubts.doubt import Doubt
from fecloth.simulation.probes import Probe
from fecloth.study.problem import StudyProblem
from fecloth.study.runs import Runs, print_doubts, refuse_huge
from fecloth.study.work import LONGEST


@dataclass(frozen=True, eq=False, repr=False)
class Opened:
    """A problem that is open for studies.

    Attributes
    ----------
    problems
        The problem; several only for `compare`.
    given
        How cases run.
    takes_usual_limit
        Whether each study chooses the longest time of a case, because none was given.
    """

    problems: tuple[StudyProblem, ...]
    given: Runs
    takes_usual_limit: bool

    @classmethod
    @checks_arguments
    def of(
        cls,
        problem: Scene | str | Path | Callable | Sequence[Scene | str | Path | Callable],
        *,
        h: Annotated[float | None, LENGTH] = None,
        dt: Annotated[float | None, TIME] = None,
        t_end: Annotated[float | None, TIME] = None,
        probes: Sequence[Probe] = (),
        cache: str | Path | None = None,
        jobs: int = 1,
        scheduler: str | None = None,
        time_limit: Annotated[float | Literal["auto"] | None, TIME] = "auto",
        most_seconds: Annotated[float | None, TIME] = LONGEST,
        fresh: bool = False,
        **settings: object,
    ) -> Self:
        """Open a problem for studies: each study is a method of what this returns.

        The functions of the same names, as `fecloth.study.converge`, take these arguments,
        too, and open the problem for one study.

        Parameters
        ----------
        problem
            A scene, its path, or a function of h and dt (either may be missing) and of
            `settings` that returns cloth, system, method and start. For `compare` also a list
            of several.
        h, dt, t_end, probes
            Of a function's problem: first edge length [m], step [s], end [s] (without it the
            equilibrium is the result) and probes.
        cache
            Folder where finished cases are stored, and from where all studies read them.
        jobs
            Number of processes of this machine, each with one thread.
        scheduler
            Address of a Dask scheduler that runs the cases, see `run_cases`.
        time_limit
            Longest CPU time of a case [s]; None for any. By default 60 s in `chart`, 120 s in
            `stability`, and any time in the others.
        most_seconds
            Time [s] above which a study does not start, by its order of magnitude, or stops
            after its first case, by what that took; None for any.
        fresh
            Whether each case is run, even if its result is stored.
        settings
            Further arguments of the function.

        Raises
        ------
        InputError
            For what is no problem, settings beside a scene, or a limit that is not positive.

        Examples
        --------
        >>> import fecloth as fc
        >>> def strip(h, stiffness=20.0):
        ...     cloth = fc.Cloth.rectangle(1.0, 0.25, h, pattern="right")
        ...     terms = [fc.StVK(), fc.Gravity((9.81, 0, 0))]
        ...     system = fc.System(cloth, fc.Fabric(0.2, stiffness), terms, pins=["left"])
        ...     return cloth, system, None, system.rest()
        >>> study = fc.study.of(strip, h=0.25, probes=[fc.Probe("tip", "right")])
        >>> study
        <Study of strip>
        >>> print(f"{study.converge('tip.x').value:.4f}")
        1.0450
        >>> print([f"{x:.3f}" for x in study.sweep("stiffness=20,80", "tip.x").table["tip.x"]])
        ['1.045', '1.012']
        >>> print(study.compare("stiffness=40,20", "tip.x").verdict[:37])
        tip.x: stiffness = 20 is 2.10744 ± 0.
        """
        sources: Any = problem
        if isinstance(problem, str) or not isinstance(problem, Sequence):
            sources = [problem]
        if not sources:
            raise InputError("problem = []", "must be at least one scene or function", "study")
        given = Runs(
            cache=cache,
            jobs=jobs,
            scheduler=scheduler,
            time_limit=None if time_limit == "auto" else time_limit,
            most_seconds=most_seconds,
            fresh=fresh,
        )
        problems = [
            StudyProblem.of(source, h, dt, t_end, probes, arguments=settings) for source in sources
        ]
        return cls(tuple(problems), given, takes_usual_limit=time_limit == "auto")

    @property
    def problem(self) -> StudyProblem:
        """The only problem; several are an `InputError`."""
        if len(self.problems) > 1:
            what = f"{len(self.problems)} problems"
            remedy = "Open a single problem."
            raise InputError(what, "only compare takes several", "study", remedy)
        return self.problems[0]

    def runs(self, usual_limit: float | None = None) -> Runs:
        """Return how cases run; `usual_limit` [s] holds for a case unless a limit was given."""
        if self.takes_usual_limit:
            return replace(self.given, time_limit=usual_limit)
        return self.given

    def begin(
        self, values: Mapping[str, Any] | None = None, usual_limit: float | None = None
    ) -> tuple[StudyProblem, Runs, tuple[Doubt, ...]]:
        """Return the problem, how its cases run, and the doubts about it, which are printed.

        A function gets those of the `values` without which it has no set-up; `usual_limit` is
        as for `runs`. Raise `InputError` for a problem that would take far too long.
        """
        problem = self.problem.completed(values or {})
        how = self.runs(usual_limit)
        refuse_huge(problem, how)
        return problem, how, print_doubts(problem)

    def __repr__(self) -> str:
        names = ", ".join(problem.name for problem in self.problems)
        return f"<{type(self).__name__} of {names}>"


def open_study(problem: Any, shared: Mapping[str, Any]) -> Opened:
    """Open a problem with the arguments that studies share.

    A problem that is open already is returned as it is; `shared` must be empty then, else
    `InputError` is raised.
    """
    if not isinstance(problem, Opened):
        return Opened.of(problem, **shared)
    if shared:
        name = next(iter(shared))
        remedy = f"What all studies share, and your function takes: fc.study.of(problem, {name}=…)."
        raise InputError(name, "is no argument of this study", "study", remedy)
    return problem
