"""The numbers of a problem that its results depend on."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from fecloth.errors import InputError, brief, did_you_mean, is_number
from fecloth.study.problem import StudyProblem

WHERE = "sensitivity"
Asked = str | Sequence[str] | Mapping[str, float]


@dataclass(frozen=True)
class Parameter:
    """A number of a problem: a key of a scene, or an argument of a function.

    Attributes
    ----------
    name
        The key, or the argument.
    value
        Its value.
    width
        The unit of its changes: |value|, or the scale that was given.
    """

    name: str
    value: float
    width: float

    def at(self, change: float) -> float:
        """Return the value after a change in units of the width."""
        return self.value + change * self.width


def choose_parameters(
    problem: StudyProblem, asked: Asked | None, scale: Mapping[str, float]
) -> tuple[Parameter, ...]:
    """Return the parameters that are asked for.

    If `asked` is None, return all numbers of fabric and terms, or all arguments of a function,
    that are not 0. A name that stands for several numbers, such as a list, gives a parameter for
    each. `scale` has the sizes of usual changes, by name. Raise `InputError` for a name that is
    no number of the problem or occurs twice, for a number that changes the mesh, the steps or
    the solver, for a value of 0 without a scale, for a scale of another name, and if there is
    no parameter.
    """
    if not isinstance(asked, str | Sequence | Mapping | None):
        raise InputError(f"parameters = {brief(asked)}", "must be names, or a mapping", WHERE)
    numbers = dict(problem.source.numbers())
    if asked is None:
        # a value of 0 has no usual change, so it is no parameter without a scale
        is_usual = problem.source.is_usual_parameter
        names = [name for name, value in numbers.items() if value and is_usual(name)]
        if not names:
            remedy = "Name parameters, with a scale for each value of 0."
            raise InputError("parameters = None", f"{problem.name} has none", WHERE, remedy)
    else:
        names = []
        for name in [asked] if isinstance(asked, str) else asked:
            names_of_items = [key for key in numbers if key.startswith(f"{name}.")]
            names += names_of_items or [name]  # the key of a list stands for all of its numbers
    if not names or len(set(names)) < len(names):
        raise InputError(f"parameters = {asked!r}", "must be names, each one once", WHERE)
    for name in sorted(set(scale) - set(names)):
        raise InputError(f"scale of {name!r}", "is of no parameter here", WHERE)
    return tuple(_make_parameter(problem, name, numbers, scale) for name in names)


def _make_parameter(
    problem: StudyProblem, name: str, numbers: Mapping[str, float], scale: Mapping[str, float]
) -> Parameter:
    """Return the parameter with this name.

    `numbers` are all numbers of the problem, `scale` the sizes of usual changes, both by name.
    Raise `InputError` for a number that changes the mesh, the steps or the solver, for an
    unknown name, and for a usual change that is not above 0, as of a value of 0 without a scale.
    """
    problem.source.refuse_parameter(name)
    if name not in numbers:
        all_names = ", ".join(numbers) or "no number"
        allowed = f"must be a number of the problem: {all_names}"
        raise InputError(f"parameter {name!r}", allowed, WHERE, did_you_mean(name, numbers))
    value = numbers[name]
    width = scale.get(name, abs(value))
    if not (is_number(width) and width > 0):
        what = f"parameter {name!r} = 0"
        if name in scale:
            what = f"scale of {name!r} = {width!r}"
        remedy = (
            f"Give the size of a usual change, as --scale {name}=0.01, in Python "
            f"scale={{{name!r}: 0.01}}."
        )
        raise InputError(what, "needs a change > 0 to compare with", WHERE, remedy)
    return Parameter(name, value, float(width))
