"""What a scene and a user's function have in common as problems, and what bounds their orders."""

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np

from fecloth.errors import InputError
from fecloth.mesh.cloth import Cloth
from fecloth.simulation.doubts.doubt import Doubt
from fecloth.simulation.quantity import Quantity, parse_quantity
from fecloth.simulation.setup import Setup
from fecloth.terms import PointForce
from fecloth.terms.kinematics import principal_stretches
from fecloth.terms.traits import has_kind, traits_of

Asked = str | Callable[..., float] | Quantity
ROUND = 0.5  # share of the corners of a boundary above which it is round


class CommonProblem:
    """What both kinds of problems derive from their name, first level and default `quantities`."""

    name: str
    source: str  # what errors name
    h: float | None  # edge length [m]
    dt: float | None  # fixed step [s]; None where there is none
    span: float | None  # length of the run [s]; None of an equilibrium
    first: Setup
    quantities: tuple[Quantity, ...]

    @property
    def is_static(self) -> bool:
        return self.first.is_static

    @property
    def is_explicit(self) -> bool:
        """Whether its steps solve no equations."""
        return not self.is_static and self.first.steps.traits.explicit

    def can_refine(self, what: str) -> bool:
        """Whether there is an h, or a fixed dt."""
        return (self.h if what == "h" else self.dt) is not None

    def refuse_methods(self, methods: Sequence[str] | None, study: str) -> None:
        """Raise `InputError` for methods of an equilibrium."""
        if methods and self.span is None:
            words = f"methods = {methods!r}", "an equilibrium has no method"
            raise InputError(*words, study, "Leave the methods out.")

    @cached_property
    def has_contact(self) -> bool:
        """Whether a term has a gap."""
        return has_kind(self.first.system.terms, "contact")

    @cached_property
    def doubts(self) -> tuple[Doubt, ...]:
        """Likely mistakes in the set-up, as before a run."""
        return tuple(self.first.doubts())

    def orders(self, quantity: Quantity) -> tuple[float, float]:
        """Return the theoretical orders in h and in dt."""
        if self.is_static:
            time = 1.0
        else:
            time = float(self.first.steps.traits.order or 1)
        return space_order(quantity, self.first), time

    def choose_quantities(self, asked: Asked | Sequence[Asked] | None) -> tuple[Quantity, ...]:
        """Return the quantities that are asked for, or the problem's own."""
        several = isinstance(asked, Sequence) and not isinstance(asked, str)
        listed: Any = self.quantities if asked is None else asked if several else (asked,)
        chosen = tuple(map(parse_quantity, listed))
        for quantity in chosen:
            self.check_quantity(quantity)
        if len({quantity.how == "mode" for quantity in chosen}) > 1 and not self.is_static:
            allowed = "needs a study of its own: a scene in time is not run for its modes"
            raise InputError("frequency(k) beside other quantities", allowed, self.source)
        return chosen

    def choose_quantity(self, asked: Asked | None) -> Quantity:
        """Return the quantity that is asked for, or the first of the problem's own."""
        return self.choose_quantities(self.quantities[:1] if asked is None else asked)[0]

    def check_quantity(self, quantity: Quantity) -> None:
        """Raise `InputError` for a quantity that the run does not have."""
        names = self.first.recording([quantity.column]).row().keys()
        quantity.require_known(sorted(names - {"t"}))


def quantities_of(probes: Sequence[str], static: bool) -> tuple[Quantity, ...]:
    """Return the usual quantities of a run with these probes."""
    names = [name if static else f"path of {name}" for name in probes]
    return tuple(parse_quantity(name) for name in names or ["displacement"])


def space_order(quantity: Quantity, setup: Setup) -> float:
    """Return the theoretical order in h, for a smooth solution.

    For linear triangles it is 2, for gradients 1; of quadratic triangles 3, of gradients 2,
    and 4 of energies, frequencies, areas, volumes and reactions. With bending or a round
    border of straight edges it is at most 2. `find_obstacles` says where point values have
    order 2 only.
    """
    is_gradient = quantity.norm == "h1" or quantity.name.endswith("stretch")
    if setup.cloth.element == "P1":
        return 1.0 if is_gradient else 2.0
    if has_bending(setup) or is_round(setup.cloth):
        return 2.0
    names = {*setup.system.names, "kinetic", "total", "area", "volume"}
    is_mean = quantity.how in ("mode", "period", "frequency") or quantity.column in names
    is_mean |= quantity.column.startswith(("reaction", "line_force"))
    return 2.0 if is_gradient else 4.0 if is_mean else 3.0


def border_of(cloth: Cloth) -> tuple[np.ndarray, np.ndarray]:
    """Return the edges of the border (b, 2), and by how much it turns at each node (n,), |sin|."""
    edges = np.concatenate([cloth.triangles[:, [i, (i + 1) % 3]] for i in range(3)]).astype(int)
    key = edges @ [len(cloth.X), 1]
    back = edges @ [1, len(cloth.X)]
    edges = edges[~np.isin(key, back)]  # of one triangle only, with the cloth on their left
    along = np.diff(cloth.X[edges], axis=1)[:, 0]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    arriving, leaving = np.zeros((2, len(cloth.X), 2))
    leaving[edges[:, 0]] = along
    arriving[edges[:, 1]] = along
    return edges, np.abs(arriving[:, 0] * leaving[:, 1] - arriving[:, 1] * leaving[:, 0])


def is_round(cloth: Cloth) -> bool:
    """Whether most corners of the border turn: a round shape, meshed with straight edges."""
    edges, turning = border_of(cloth)
    return bool(len(edges)) and float(np.mean(turning[edges[:, 0]] > 1e-3)) > ROUND


SLACK = 0.05  # strain across, relative to that along, below which a cloth is slack across
ROUND_OFF = 1e-9  # strain
FOLDED = 0.9  # least stretch below which a cloth has folds or wrinkles


def find_obstacles(setup: Setup, ends: Mapping[str, list[float]], x: np.ndarray) -> list[str]:
    """Return a sentence for each feature of a system that limits or prevents convergence in h.

    `ends` are the columns of the run at its start and end, `x` (n, 3) the positions at the
    end.
    """
    system = setup.system
    remarks = []
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
    return has_kind(setup.system.terms, "bending")
