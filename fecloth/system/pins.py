"""Pins and slides as a user writes them: their nodes, free directions and motion."""

import math
import re
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Annotated, Self, cast

import numpy as np

from fecloth import validation
from fecloth.errors import FeclothError, InputError, brief, errors_of, flag, is_number
from fecloth.mesh.cloth import Cloth
from fecloth.mesh.selection import Where
from fecloth.quantities.arguments import checks_arguments
from fecloth.quantities.formula import Formula, FormulaVector
from fecloth.quantities.rotation import Rotation
from fecloth.quantities.sameness import same
from fecloth.quantities.time_function import DIFFERENCE_STEP, difference_quotient
from fecloth.quantities.units import TIME


@dataclass(frozen=True)
class Motion:
    """Displacement by three formulas of t, or of t and of a node's material point (X, Y) [m].

    Attributes
    ----------
    formulas
        Three formulas of t. All are of t, X and Y where one of them has X or Y in it.
    X
        (k, 2) material points of the nodes [m], for formulas of X and Y.
    """

    formulas: tuple[Formula, ...]
    X: np.ndarray | None = field(default=None, compare=False)

    @classmethod
    def read(cls, parts: Sequence[str | float], name: str = "motion") -> Self:
        """Return the motion of three formulas or numbers; `name` is what errors call it.

        The formulas are of t, or of t, X and Y if one of them has X or Y in it. Raises
        `InputError` for anything else than three formulas or numbers.
        """
        if isinstance(parts, str) or not isinstance(parts, Sequence) or len(parts) != 3:
            raise _refused(parts, name)
        if not all(is_number(part) or isinstance(part, str) for part in parts):
            raise _refused(parts, name)
        texts = [part if isinstance(part, str) else repr(float(part)) for part in parts]
        by_place = any(re.search(r"\b[XY]\b", text) for text in texts)
        variables = ("t", "X", "Y") if by_place else ("t",)
        return cls(tuple(Formula(text, variables) for text in texts))

    @property
    def by_place(self) -> bool:
        """Whether the motion differs from node to node."""
        return "X" in self.formulas[0].variables

    def __call__(self, t: float | np.ndarray) -> np.ndarray:
        """Displacement (3,) or (k, 3) [m]; of times (m,) one for each, to the same bits."""
        return self._evaluate(self._components, t)

    def velocity(self, t: float | np.ndarray) -> np.ndarray:
        """The exact derivative of the displacement by t, of the same shape [m/s]."""
        return self._evaluate(self._rates, t)

    def check(self, times: np.ndarray) -> None:
        """Raise `InputError` if the motion or its velocity is not finite at times of a run.

        `times` (m,) [s] ascend. The derivative of the formulas may have no value after the
        start; then the places are checked at which a difference quotient needs the motion.
        """
        self(times)  # raises where it is not finite
        start = times[0]
        later = times[1:]
        try:
            self.velocity(later)
        except InputError:  # the velocity is then a difference quotient
            self(np.maximum(later - DIFFERENCE_STEP, start))
            self(later + DIFFERENCE_STEP)

    @cached_property
    def _components(self) -> FormulaVector:
        return FormulaVector(self.formulas)

    @cached_property
    def _rates(self) -> FormulaVector:
        return self._components.derivative("t")

    def _evaluate(self, components: FormulaVector, t) -> np.ndarray:
        """Return the values of three formulas at t: (3,) or, for X and Y of k nodes, (k, 3).

        At times (m,) they are (m, 3) or (m, k, 3). Raises `InputError` for formulas of X and Y
        without the material points of nodes.
        """
        if not self.by_place:
            variables = np.array(t, float).reshape(1, -1)
        elif self.X is None:
            raise InputError("a motion of X and Y", "has values at the nodes of a System only")
        else:
            variables = np.empty((3, np.size(t), len(self.X)))
            variables[0] = np.reshape(t, (-1, 1))
            variables[1:] = self.X.T[:, None]
        values = components(variables.reshape(len(variables), -1))
        return values.reshape(*np.shape(t), *variables.shape[2:], 3)


def _refused(parts: object, name: str) -> InputError:
    """Return the error for a motion or a velocity that is not three formulas or numbers."""
    kinds = ["three formulas of t", "a function of t"]
    first, second = kinds if name == "motion" else reversed(kinds)
    allowed = f"must be {first}, or {second}, as in lambda t: [0, 0, 0.1 * t]"
    return InputError(f"{name} = {brief(parts)}", allowed)


@checks_arguments
@dataclass(frozen=True)
class Pin:
    """x(t) = x(t₀) + motion(t) − motion(t₀): nodes that stay where the run starts, or are moved.

    With `rotate` they turn about an axis, which the motion carries along: with p the point of
    the axis, u the motion and R the rotation, x(t) = p + u(t) + R(t) R(t₀)ᵀ (x(t₀) − p −
    u(t₀)).

    Source: the filter of Baraff and Witkin (1998), Large Steps in Cloth Simulation, section 5,
    in the form P A P + (I − P) with the projector P onto a node's free directions (Ascher and
    Boxerman 2003, On the modified conjugate gradient method in cloth simulation).

    Valid at any deformation, for a rigid support. A single pinned node is a softer support the
    finer the mesh is, as `PointForce` explains: pin edges. Steps must be short enough to
    sample a motion; a run with fixed steps warns of one that mostly acts between them.

    Parameters
    ----------
    where
        A node set's name, node indices, or a predicate on X.
    motion
        Displacement [m] as three formulas of t [s], X and Y [m], such as ``("0", "0",
        "0.1*sin(2*pi*t)")``, or as a function of time, ``motion(t) -> (3,)`` for all nodes or
        ``(k, 3)`` in the order of ``cloth.nodes(where)``. Only its changes count: x(t) = x(t₀)
        + motion(t) − motion(t₀). None: fixed.
    velocity
        Time derivative of the motion [m/s], as formulas or a function; if None, the derivative
        of a function is a central difference over 2e-5 s, one-sided where it would need a time
        before the start of the step. The derivative of formulas is exact.
    name
        Name of the group in reactions; if None, the set's name.
    clamp
        Whether to hold also the normal of the cloth, as it is where the run starts, along the
        edges of the boundary whose nodes are all pinned. Without it they are free to turn, as
        on a hinge. A clamp needs a bending term that can hold a normal: `PlateBending`.
    rotate
        `Rotation` that turns the nodes, and the normals of a clamp.
    without
        Nodes that the pin leaves out, as of `where`: ``Pin("left", without="top")``; or a list
        of node sets, ``Pin("top", without=["left", "right"])``.
    until
        Time [s] at which the pin lets go: its nodes go on with the velocity that they have. A
        step ends there, and the method begins anew, as after a start. None: it holds for ever.

    Pins may meet: a node of several pins and slides that do not move is held by all of them
    together. Pins that move must hold the node in the same directions and move it alike.

    Examples
    --------
    >>> Pin("left", motion=("0", "0", "0.1*t**2")).speed(0.5)
    array([0. , 0. , 0.1])
    """

    where: Where
    motion: Sequence[str | float] | Callable[[float], np.ndarray] | None = None
    velocity: Sequence[str | float] | Callable[[float], np.ndarray] | None = None
    name: str | None = None
    clamp: bool = False
    rotate: Rotation | None = None
    without: Where | Sequence[str] | None = field(default=None, kw_only=True)
    until: Annotated[float | None, TIME] = field(default=None, kw_only=True)

    def __post_init__(self):
        """Make a `Motion` of formulas; raise `InputError` for wrong values."""
        flag("clamp", self.clamp, self._label)
        if self.until is not None and not is_number(self.until):
            raise InputError(f"until = {self.until!r}", "must be a finite time [s]", self._label)
        if self.rotate is not None and not isinstance(self.rotate, Rotation):
            allowed = "must be a Rotation(point, axis, angle)"
            raise InputError(f"rotate = {self.rotate!r}", allowed, self._label)
        if self.motion is not None and not callable(self.motion):
            object.__setattr__(self, "motion", self._formulas(self.motion))
        if self.velocity is not None and not callable(self.velocity):
            object.__setattr__(self, "velocity", self._formulas(self.velocity, "velocity"))
        if self.velocity is not None and self.motion is None:
            raise InputError("velocity without a motion", "needs both", self._label)

    def _formulas(self, parts: Sequence[str | float], name: str = "motion") -> Motion:
        with errors_of(self._label):
            return Motion.read(parts, name)

    @property
    def _label(self) -> str:
        return f"{type(self).__name__}({self.where!r})"

    def nodes(self, cloth: Cloth) -> np.ndarray:
        """Return the nodes (k,) of a cloth that the pin holds.

        Raises `InputError` for nodes that the cloth does not have, and if none is left.
        """
        nodes = cloth.nodes(self.where)
        if self.without is None:
            return nodes
        left = nodes[~np.isin(nodes, self._left_out(cloth, self.without))]
        if not len(left):
            what = f"no node is left by without = {brief(self.without)}"
            raise InputError(what, "at least one is needed", self._label)
        return left

    @staticmethod
    def _left_out(cloth: Cloth, without: Where | Sequence[str]) -> np.ndarray:
        """Return the nodes (k,) that `without` names."""
        if isinstance(without, list | tuple) and without and isinstance(without[0], str):
            return np.concatenate([cloth.nodes(cast(str, name)) for name in without])
        return cloth.nodes(cast(Where, without))

    def agrees_with(self, other: "Pin") -> bool:
        """Return whether both may hold one node: at rest, or in the same directions moved alike.

        Functions that give each node a motion of its own are never alike.
        """
        if not (self.moves or other.moves):
            return True
        are_alike = (
            self.motion == other.motion  # the formulas, for whatever nodes
            and self.velocity == other.velocity
            and same(self.rotate, other.rotate)
        )
        by_row = not isinstance(self.motion, Motion | None) and self.displacement(0.0).ndim == 2
        return are_alike and not by_row and np.allclose(self.projector, other.projector)

    @property
    def moves(self) -> bool:
        """Whether the nodes are moved or turned."""
        return self.motion is not None or self.rotate is not None

    @property
    def projector(self) -> np.ndarray:
        """(3, 3) projector onto the free directions: there are none."""
        return np.zeros((3, 3))

    def at(self, X: np.ndarray) -> Self:
        """The pin on nodes at the material points X (k, 2) [m], which formulas may need."""
        pin = self
        if isinstance(self.motion, Motion) and self.motion.by_place:
            pin = replace(pin, motion=replace(self.motion, X=X))
        if isinstance(self.velocity, Motion) and self.velocity.by_place:
            pin = replace(pin, velocity=replace(self.velocity, X=X))
        return pin

    def sample(self, t: float, size: float) -> np.ndarray:
        """(k, 3) displacements and, where it turns, three arms of `size` that turn [m]."""
        rows = self.displacement(t).reshape(-1, 3)
        if self.rotate is None:
            return rows
        return np.vstack([rows, size * self.rotate.matrix(t)])

    def displacement(self, t: float) -> np.ndarray:
        """(3,) or (k, 3) [m]."""
        if not callable(self.motion):  # None: `__post_init__` makes formulas a `Motion`
            return np.zeros(3)
        is_formula = isinstance(self.motion, Motion)  # its values are finite and of this shape
        if is_formula:
            return self.motion(t)
        return self._checked(self.motion, t, "motion")

    def speed(self, t: float, since: float = -math.inf) -> np.ndarray:
        """Return the velocity at a time t, (3,) or (k, 3) [m/s].

        It is 0 without a motion, else the given velocity, else the derivative of the formulas,
        else a difference quotient of the motion. That takes no displacement before `since` [s].
        """
        if self.motion is None:
            return np.zeros(3)
        if callable(self.velocity):  # None otherwise: `__post_init__` makes formulas a `Motion`
            return self._checked(self.velocity, t, "velocity")
        if isinstance(self.motion, Motion):
            with suppress(InputError):  # not finite, as of sqrt(t)**3 at 0 by the chain rule
                return self.motion.velocity(t)
        return difference_quotient(self.displacement, t, since)

    def over_steps(
        self, begins: np.ndarray, ends: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray] | None:
        """Return the displacements over steps [m], and the speeds at their ends [m/s].

        `begins` and `ends` (s,) are the times of the steps [s]. Both results are (s, k, 3), or
        (s, 1, 3) if all nodes move alike. None if each time needs a call of its own: where a
        function of Python gives the motion or the velocity, or where the formulas have a value
        that is not finite.
        """
        motion = self.motion
        velocity = self.velocity
        if not isinstance(motion, Motion) or not isinstance(velocity, Motion | None):
            return None
        with suppress(InputError):
            speeds = velocity(ends) if velocity else motion.velocity(ends)
            before, after = motion(np.concatenate([begins, ends])).reshape(2, len(ends), -1, 3)
            return after - before, speeds.reshape(before.shape)
        return None

    def check_shape(self, value: np.ndarray, nodes: int) -> None:
        """Refuse a motion with another number of rows than the pin has nodes."""
        if value.ndim == 2 and len(value) not in (1, nodes):
            allowed = f"must be (3,) or ({nodes}, 3), a row for each node"
            raise InputError(f"a motion of shape {value.shape}", allowed, self._label)

    def _checked(self, function: Callable, t: float, name: str) -> np.ndarray:
        """Return the value of a user's function at t, (3,) or (k, 3).

        Raises `InputError`, which calls the function `name`, if the function raises an error or
        its value is of another shape or not finite.
        """
        allowed = "must be three finite numbers for a time t [s]"
        try:
            value = np.asarray(function(t), dtype=float)
        except FeclothError:  # it has its own message
            raise
        except Exception as error:  # whatever a user's function may raise
            raise InputError(f"{name}({t:g}): {error}", allowed, self._label) from error
        if value.shape[-1:] != (3,) or value.ndim > 2 or not np.isfinite(value).all():
            allowed = "must be three finite numbers (or three for each node)"
            raise InputError(f"{name}({t:g}) = {value!r}", allowed, self._label)
        return value


@checks_arguments
@dataclass(frozen=True)
class Slide(Pin):
    """Nodes that slide without friction along a line or in a plane, from where the run starts.

    The free directions of each node are the image of a projector P; the reaction lies in the
    image of I − P:

        P = d dᵀ             along the line of direction d     (rank 1)
        P = I − n nᵀ         in the plane of normal n          (rank 2)

    Source: as for `Pin`.

    Valid where `Pin` is; the line or plane keeps its direction and has no friction.

    Parameters
    ----------
    where, motion, velocity, name, without, until
        As for `Pin`; a motion moves the line or plane, so only its part across these counts.
    clamp
        On a line, as for `Pin`. In a plane the cloth meets the plane at a right angle, as beside
        its mirror image: a plane of symmetry.
    rotate
        Refused: only a `Pin` can turn the nodes.
    direction
        Direction of the line, of any length; give this or `normal`.
    normal
        Normal of the plane, of any length.

    Examples
    --------
    >>> Slide("left", normal=(0, 0, 2)).projector
    array([[1., 0., 0.],
           [0., 1., 0.],
           [0., 0., 0.]])
    """

    direction: tuple[float, float, float] | None = None
    normal: tuple[float, float, float] | None = None

    def __post_init__(self):
        """Raise `InputError` for a rotation, and unless one of the axes is given."""
        super().__post_init__()
        if self.rotate is not None:
            free = "direction" if self.normal is None else "normal"
            allowed = "exclude each other: nodes that slide do not turn"
            remedy = f"Leave out rotate; or {free}, to hold the nodes in all directions."
            raise InputError(f"rotate and {free} are given", allowed, self._label, remedy)
        if (self.direction is None) == (self.normal is None):
            given = "neither" if self.normal is None else "both"
            what = f"{given} of direction and normal"
            raise InputError(what, "needs one of them", self._label)
        _ = self.axis  # raises an error for a direction or a normal without a length

    @cached_property
    def axis(self) -> np.ndarray:
        """(3,) unit vector along the line, or across the plane."""
        name = "direction" if self.normal is None else "normal"
        return validation.direction(name, getattr(self, name), self._label)

    @property
    def projector(self) -> np.ndarray:
        """(3, 3) projector onto the line or the plane."""
        P = np.outer(self.axis, self.axis)
        return P if self.normal is None else np.eye(3) - P
