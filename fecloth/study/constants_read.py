"""Which constants of its fabrics a problem depends on: the ones that its terms read."""

from dataclasses import replace
from typing import Any

from fecloth.fabric.fabric import Fabric
from fecloth.fabric.priors import estimates
from fecloth.fabric.uncertainty import CONSTANTS, numbers_of
from fecloth.simulation.setup import Setup
from fecloth.study.problem import StudyProblem
from fecloth.terms import protocol


class NotingFabric(Fabric):
    """A fabric that notes in `noted` which of its constants are read."""

    noted: set[str]

    @classmethod
    def of(cls, fabric: Fabric) -> "NotingFabric":
        """Return a copy of a fabric of which nothing was read yet."""
        copy = object.__new__(cls)
        vars(copy).update(vars(fabric), noted=set())
        return copy

    def __getattribute__(self, name: str) -> Any:
        if name in CONSTANTS:
            vars(self)["noted"].add(name)
        return super().__getattribute__(name)


def numbers_read(problem: StudyProblem) -> list[str]:
    """Return the names of the numbers of a scene's fabrics that its terms read.

    They are as "fabric.tensile_stiffness.0". The areal density counts where the cloth moves. A
    function makes its own fabrics, whose numbers have no names: the list is empty.
    """
    fabrics = problem.source.fabrics
    if not fabrics:
        return []
    noted = _constants_read(problem.first)
    names = []
    for (prefix, fabric), constants in zip(fabrics.items(), noted, strict=True):
        numbers = numbers_of(vars(fabric))
        names += [f"{prefix}.{key}" for key in numbers if key.partition(".")[0] in constants]
    return names


def with_estimates(problem: StudyProblem) -> tuple[StudyProblem, dict[str, float]]:
    """Return the problem with the constants that its terms estimate written out.

    Beside it stand their standard uncertainties by name: the spread of published fabrics, see
    `fecloth/fabric/priors.py`. No result changes by it.
    """
    fabrics = problem.source.fabrics
    if not fabrics:
        return problem, {}
    values, deviations = {}, {}
    noted = _constants_read(problem.first)
    for (prefix, fabric), constants in zip(fabrics.items(), noted, strict=True):
        for key, (value, deviation) in estimates(fabric).items():
            if key in constants:
                values[f"{prefix}.{key}"] = value
                deviations[f"{prefix}.{key}"] = deviation
    return (problem.at(values, "estimates") if values else problem), deviations


def _constants_read(setup: Setup) -> list[set[str]]:
    """Return the constants of each fabric that the terms read where they are bound."""
    system = setup.system
    fabrics = tuple(NotingFabric.of(fabric) for fabric in system.panel.fabrics)
    panel = replace(system.panel, fabrics=fabrics)
    for term in system.terms:
        protocol.bound(term, panel, system.layout.slots)
    of_motion = set() if setup.is_static else {"areal_density"}
    return [fabric.noted | of_motion for fabric in fabrics]
