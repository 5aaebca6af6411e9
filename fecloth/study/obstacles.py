"""What may keep a quantity from converging under refinement."""

from collections.abc import Mapping

import numpy as np

from fecloth.mesh.cloth import Cloth
from fecloth.study.setups import Setup
from fecloth.terms import PointForce
from fecloth.terms.kinematics import principal_stretches
from fecloth.terms.traits import has_kind, traits_of

SLACK = 0.05  # strain across, relative to that along, below which a cloth is slack across
ROUND_OFF = 1e-9  # strain
FOLDED = 0.9  # least stretch below which a cloth has folds or wrinkles


def find_obstacles(setup: Setup, ends: Mapping[str, list[float]], x: np.ndarray) -> list[str]:
    """Return a sentence for each feature of a system that limits or prevents convergence in h.

    `ends` are the columns of the run at its start and end, `x` (n, 3) the positions at the end.
    """
    system, remarks = setup.system, []
    for name, (_, nodes) in system.constraints.groups.items():
        if len(nodes) == 1:
            remarks.append(
                f"the pin {name} holds a single point: a membrane has no finite stiffness there, "
                "and gives way by about log(1/h); pin an area or an edge"
            )
    if any(isinstance(term, PointForce) for term in system.terms):
        remarks.append(
            "a PointForce acts on a point, under which the deflection of a membrane grows like "
            "log(1/h); spread it over an area"
        )
    least = ends.get("least_stretch", [1.0])[-1]
    bends = has_bending(setup)
    if least < FOLDED:
        remarks.append(
            f"a triangle is compressed to {least:.2f} of its length: folds and wrinkles differ "
            "from mesh to mesh" + ("" if bends else ", without bending down to the edge length")
        )
    if any(traits_of(term).by_pattern for term in system.terms):
        remarks.append(
            "the bending of hinges depends on the pattern of the mesh; PlateBending converges on "
            "every mesh"
        )
    if not bends and not setup.is_static:
        remarks.append(
            "without bending the cloth may have kinks, which limit the order in h to 1.5 in L2 "
            "and to 0.5 in H1"
        )
    if setup.cloth.element == "P2" and not bends and is_slack_across(setup.cloth, x):
        remarks.append(
            "most of the cloth has tension in one direction only, so that nothing holds it between "
            "the lines of tension: there point values of quadratic triangles have order 2"
        )
    return remarks


def is_slack_across(cloth: Cloth, x: np.ndarray) -> bool:
    """Whether most of the cloth is stretched in one direction, and not across."""
    smaller, larger = np.median(principal_stretches(cloth, x) - 1, axis=0)
    return bool(larger > ROUND_OFF and smaller < SLACK * larger)


def has_bending(setup: Setup) -> bool:
    """Whether a term resists bending."""
    return has_kind(setup.system.terms, "bending")
