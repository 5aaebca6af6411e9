"""The usual quantities of a problem, their theoretical orders, and what limits these."""

from collections.abc import Mapping, Sequence

import numpy as np

from fecloth.mesh.cloth import Cloth
from fecloth.simulation.quantity import Quantity, parse_quantity
from fecloth.simulation.setup import Setup
from fecloth.terms import PointForce
from fecloth.terms.kinematics import principal_stretches
from fecloth.terms.traits import has_kind, traits_of


def quantities_of(probes: Sequence[str], static: bool) -> tuple[Quantity, ...]:
    """Return the usual quantities of a run with these probes."""
    if not probes:
        return (parse_quantity("displacement"),)
    return tuple(parse_quantity(name if static else f"path of {name}") for name in probes)


def space_order(quantity: Quantity, setup: Setup) -> float:
    """Return the theoretical order in h, for a smooth solution.

    Linear triangles have order 2, and 1 for gradients. Quadratic triangles have order 3, 2 for
    gradients, and 4 for energies, frequencies, areas, volumes and reactions. With bending, or a
    round border of straight edges, the order is at most 2. A recovered stress counts as a value,
    not as a gradient: inside the cloth it has order 2 on P1 and 3 on P2, at a border less.
    `find_obstacles` says where point values have order 2 only. Numbers that are means, such as
    energies, have a higher order than values at a point.
    """
    is_gradient = quantity.norm == "h1" or quantity.name.endswith("stretch")
    if setup.cloth.element == "P1":
        return 1.0 if is_gradient else 2.0
    if has_bending(setup) or is_round(setup.cloth) or is_gradient:
        return 2.0
    mean_columns = {*setup.system.names, "kinetic", "total", "area", "volume"}
    is_mean = quantity.how in ("mode", "period", "frequency") or quantity.column in mean_columns
    if is_mean or quantity.column.startswith(("reaction", "line_force")):
        return 4.0
    return 3.0


def border_of(cloth: Cloth) -> tuple[np.ndarray, np.ndarray]:
    """Return the edges (b, 2) of the border, and |sin| of its turn at each node (n,).

    The edges are numbers of nodes, in the order in which a triangle on their left has them. The
    turn at a node is the angle between the two edges of the border there; it is 0 at all other
    nodes.
    """
    edges = np.concatenate([cloth.triangles[:, [i, (i + 1) % 3]] for i in range(3)]).astype(int)
    number = edges @ [len(cloth.X), 1]  # a number of its own for each pair of nodes
    number_of_reverse = edges @ [1, len(cloth.X)]
    # Two triangles have their common edge in opposite directions. An edge of the border belongs
    # to one triangle only, so that its reverse is no edge.
    edges = edges[~np.isin(number, number_of_reverse)]
    direction = np.diff(cloth.X[edges], axis=1)[:, 0]
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    arriving, leaving = np.zeros((2, len(cloth.X), 2))  # directions of both edges at a node
    leaving[edges[:, 0]] = direction
    arriving[edges[:, 1]] = direction
    return edges, np.abs(arriving[:, 0] * leaving[:, 1] - arriving[:, 1] * leaving[:, 0])


def is_round(cloth: Cloth) -> bool:
    """Whether the border turns at most of its nodes, as the mesh of a round shape does."""
    edges, turning = border_of(cloth)
    turns = turning[edges[:, 0]] > 1e-3  # a straight border turns by round-off only
    return bool(np.count_nonzero(turns) > len(turns) / 2)


# The median strain across the median strain of the larger direction: below it a cloth is slack
# across.
SLACK_STRAIN_RATIO = 0.05
# The least stretch of a triangle at the end of a run: below it a cloth has folds or wrinkles.
FOLDED_STRETCH = 0.9


def find_obstacles(setup: Setup, ends: Mapping[str, list[float]], x: np.ndarray) -> list[str]:
    """Return a sentence for each feature of a run that limits or prevents convergence in h.

    `ends` has the values of each column at the start and the end of the run, `x` (n, 3) are the
    positions at the end [m].
    """
    system = setup.system
    bends = has_bending(setup)
    remarks = []
    groups = system.constraints.groups.items()
    if lone := [name for name, (_, nodes) in groups if len(nodes) == 1]:
        holds = "the pin {} holds" if len(lone) == 1 else "each of the pins {} holds"
        remarks.append(
            f"{holds.format(', '.join(lone))} a single point: a membrane has no finite stiffness "
            "there, and gives way by about log(1/h); pin an area or an edge"
        )
    if any(isinstance(term, PointForce) for term in system.terms):
        remarks.append(
            "a PointForce acts on a point, under which the deflection of a membrane grows like "
            "log(1/h); spread it over an area, or along an edge by EdgeForce"
        )
    least_stretch = ends.get("least_stretch", [1.0])[-1]
    if least_stretch < FOLDED_STRETCH:
        remark = (
            f"a triangle is compressed to {least_stretch:.2f} of its length: folds and wrinkles "
            "differ from mesh to mesh"
        )
        if not bends:
            remark += ", without bending down to the edge length"
        remarks.append(remark)
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
            "most of the cloth has tension in one direction only, so that nothing holds it "
            "between the lines of tension: there point values of quadratic triangles have order 2"
        )
    return remarks


def is_slack_across(cloth: Cloth, x: np.ndarray) -> bool:
    """Whether most of the cloth is stretched in one direction, and not across."""
    smaller, larger = np.median(principal_stretches(cloth, x) - 1, axis=0)
    is_stretched = larger > np.sqrt(np.finfo(float).eps)  # more than by round-off
    return bool(is_stretched and smaller < SLACK_STRAIN_RATIO * larger)


def has_bending(setup: Setup) -> bool:
    """Whether a term resists bending."""
    return has_kind(setup.system.terms, "bending")
