"""Natural frequencies and modes of small vibration about a state."""

import math
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fecloth import validation
from fecloth.errors import FeclothWarning, InputError, amount
from fecloth.mesh.cloth import Cloth
from fecloth.nonlinear.eigenpairs import Eigenpairs, least_eigenpairs
from fecloth.nonlinear.iteration import ROUND_OFF_FACTOR
from fecloth.nonlinear.static_equation import StaticEquation
from fecloth.output.atomic_files import writing
from fecloth.output.frames import Frames
from fecloth.simulation.doubts.doubt import Doubt, DoubtKind
from fecloth.study.figures import COLUMNS, Figure, new_figure
from fecloth.study.result import StudyResult, Table
from fecloth.system.arguments import check_system
from fecloth.system.state import State
from fecloth.system.system import System

# The unbalanced forces over all forces: up to it a state counts as an equilibrium.
EQUILIBRIUM_FORCES = 0.01
SHOWN_DISPLACEMENT = 0.1  # largest displacement of a mode in the files over the cloth's extent


@dataclass(frozen=True, eq=False, repr=False)
class Modes(StudyResult):
    """The modes of lowest frequency, with `doubts` about the state.

    Attributes
    ----------
    title
        What was studied.
    verdict
        The answer in words.
    table
        One row for each run or level; see `Table`.
    doubts
        That the state is not in equilibrium, or unstable, or its stiffness not symmetric.
    remarks
        Sentences on what was noticed.
    system
        What vibrates.
    state
        The state about which it vibrates.
    frequencies
        (count,) [Hz], ascending. A negative frequency is −√(−ω²)/(2π) of an unstable
        mode, which grows by the factor e in 1/(2π |f|) seconds.
    eigenvalues
        (count,) ω² [1/s²].
    shapes
        (count, n, 3) u with u · M u = 1 [1/√kg], zero where pins hold.
    zero
        Frequency [Hz] up to which a mode counts as one without stiffness, such as the
        motion of a rigid body. Round-off hides whether its frequency is really 0.
    """

    system: System
    state: State
    frequencies: np.ndarray
    eigenvalues: np.ndarray
    shapes: np.ndarray
    zero: float

    @property
    def unstable(self) -> int:
        """Number of these modes that grow."""
        return int((self.frequencies < -self.zero).sum())

    def figure(self) -> Figure:
        """Return a Matplotlib figure of the shapes."""
        return draw_modes(self.system.cloth, self.frequencies, self.shapes)

    def notes(self) -> list[str]:
        """What the figure shows."""
        words = (
            "The colour is the displacement of a mode along the direction in which it moves "
            "most, over its largest one, on the flat cloth."
        )
        if len(self.frequencies) > MOST_PANELS:
            words += f" The figure shows the first {MOST_PANELS} modes, the table all."
        return [words]

    def write(self, folder: str | Path) -> Path:
        """Write a frame for each mode, for ParaView; return the .pvd file.

        The frame of time i shows mode i with a largest displacement of a tenth of the extent;
        its point array `shape`, 1 at most, is for `Warp By Vector` with another factor.
        """
        folder = Path(folder)
        cloth = self.system.cloth
        with writing(folder):
            folder.mkdir(parents=True, exist_ok=True)
        frames = Frames(folder / "modes", cloth, stem="frames/mode")
        for number, shape in enumerate(self.shapes, start=1):
            shape = shape / np.linalg.norm(shape, axis=1).max()
            x = self.state.x + SHOWN_DISPLACEMENT * cloth.extent * shape
            frame_state = State(t=float(number), x=x, v=0.0 * shape)
            frames.add(frame_state, ({"shape": shape}, {}))  # an array of points, none of cells
        return frames.opens

    def __repr__(self) -> str:
        shown = ", ".join(f"{f:.4g}" for f in self.frequencies[:6])
        if len(self.frequencies) > 6:
            shown += ", …"
        return f"<{amount(len(self.frequencies), 'mode')}: {shown} Hz; {self.verdict}>"


def modes(system: System, state: State, *, count: int = 6) -> Modes:
    """The `count` modes of lowest frequency of small vibrations about `state`.

        K u = ω² M u,   f = ω / 2π

    K = −∂f/∂x is the sum of all terms' exact tangents at the positions and the time of
    `state`, for v = 0, with tangents of low rank that couple all nodes (`Gas`). M is the mass
    of the system, lumped or consistent, and u is in the directions that pins and slides allow.
    Damping does not count. About a state that is no equilibrium the modes belong to the motion
    relative to the motion that begins there; find the equilibrium first.

    With the consistent mass frequencies converge from above: with h² on P1 and h⁴ on P2, of
    plates (`PlateBending`) with h² on both. Of a cloth from a file with a round border they
    converge with h² on P2, too, as its edges are straight; those of `Cloth.disk` are curved. One
    vector of a set with equal frequencies is as good as another.

    A tangent that is not symmetric, of `EdgeForce` with ``follow = True``, or of `Pressure`,
    `Drag`, `Wind` or `UserForce` with ``tangent = "exact"``, counts with its symmetric part, with
    a warning: flutter is not found, and whether the state is unstable is not known.

    Source: Ericsson and Ruhe (1980), The spectral transformation Lanczos method; the iteration
    is ARPACK's (Lehoucq, Sorensen and Yang 1998), by SciPy's `eigsh`.

    Parameters
    ----------
    system, state
        What vibrates and about which state.
    count
        Number of modes, less than the number of free degrees of freedom.

    Returns
    -------
    Modes
        With `frequencies` [Hz], `shapes` (count, n, 3), a `verdict`, and `write` for ParaView.

    Raises
    ------
    InputError
        For a count out of range.
    SolveFailed
        If the stiffness is not finite.

    Warns
    -----
    FeclothWarning
        If the state is unstable or no equilibrium, or a tangent is not symmetric.
    """
    check_system(system, state, "modes")
    free_directions = system.admissible.shape[1]
    if free_directions < 2:
        what = f"a system of {free_directions} free degrees of freedom"
        raise InputError(what, "must have at least 2", "modes", "Pin less of the cloth.")
    validation.whole("count", count, 1, "modes", most=free_directions - 1)
    # with the history of the terms, friction sticks where it holds
    system_at_rest = system.with_history(system.start_history(state))
    pairs = least_eigenpairs(system_at_rest, state, count)
    unbalanced = _unbalanced(system_at_rest, state)
    frequencies = _frequencies(pairs.values)
    zero = float(_frequencies(np.array([pairs.zero]))[0])  # up to it ω² may be round-off
    doubts = tuple(_find_doubts(pairs, unbalanced))
    for doubt in doubts:
        warnings.warn(str(doubt), FeclothWarning, stacklevel=2)
    rows = []
    for k in range(len(frequencies)):
        frequency = float(frequencies[k])
        eigenvalue = float(pairs.values[k])
        row = {"mode": k + 1, "frequency [Hz]": frequency, "eigenvalue [1/s²]": eigenvalue}
        rows.append(row)
    return Modes(
        title=f"Modes of {len(state.x)} nodes",
        verdict=_verdict(frequencies, zero),
        table=Table(tuple(rows)),
        system=system,
        state=state,
        frequencies=frequencies,
        eigenvalues=pairs.values,
        shapes=pairs.vectors,
        zero=zero,
        doubts=doubts,
    )


def _verdict(f: np.ndarray, zero: float) -> str:
    """Return whether modes grow or have no stiffness, and the lowest frequency of the others.

    `f` are the frequencies [Hz], ascending; below 0 a mode grows. Up to `zero` [Hz] round-off
    hides the stiffness.
    """
    unstable = int((f < -zero).sum())
    soft = int((f <= zero).sum())  # without stiffness, or unstable
    count = len(f)
    if unstable:
        return (
            f"unstable: {unstable} of the {count} lowest modes grow, the first by the factor e "
            f"in {1 / (2 * math.pi * abs(f[0])):.3g} s"
        )
    if soft == count:
        return f"none of the {count} lowest modes has any stiffness"
    lowest = f"the lowest frequency is {f[soft]:.4g} Hz"
    if soft == 1:
        return f"1 mode has no stiffness; of the others {lowest}"
    if soft:
        return f"{soft} modes have no stiffness; of the others {lowest}"
    return f"stable: {lowest}"


def _frequencies(eigenvalues: np.ndarray) -> np.ndarray:
    """Return ±√|ω²|/(2π) [Hz] with the sign of ω²."""
    size: np.ndarray = np.sqrt(np.abs(eigenvalues)) / (2 * math.pi)
    return np.copysign(size, eigenvalues)


def _unbalanced(system: System, state: State) -> float:
    """Return ‖f‖ of the free directions, at rest, over the sum of the sizes of all forces.

    It is 0 where the forces are round-off.
    """
    equation = StaticEquation(system, state)
    f, scale = equation.forces(equation.at(state.x))
    size = system.sums.norm(f)
    if size > ROUND_OFF_FACTOR * system.sums.norm(equation.round_off(state.x)):
        return size / scale
    return 0.0


def _find_doubts(pairs: Eigenpairs, unbalanced: float) -> Iterator[Doubt]:
    """Yield the reasons to doubt the modes: no equilibrium, instability, and asymmetry.

    `unbalanced` is the force that is not balanced over all forces.
    """
    if unbalanced > EQUILIBRIUM_FORCES:
        words = (
            f"the state is not in equilibrium ({100 * unbalanced:.2g} % of the forces are not "
            "balanced): the modes belong to the stiffness there"
        )
        remedy = (
            "find the equilibrium first, with fc.equilibrium, or [equilibrium] in place of [time] "
            "in a scene"
        )
        yield Doubt(DoubtKind.BALANCE, words, remedy)
    if pairs.is_unstable:
        rate = math.sqrt(-pairs.values[0])
        words = (
            f"the state is unstable: ω² = {pairs.values[0]:.3g} 1/s² < 0, so that a disturbance "
            f"grows by the factor e in {1 / rate:.3g} s; unstable modes have negative frequencies"
        )
        yield Doubt(DoubtKind.INSTABILITY, words)
    if not pairs.are_symmetric:
        words = (
            f"the stiffness is not symmetric (by {pairs.asymmetry:.1g} of its size): the modes are "
            "modes of its symmetric part, and flutter is not found"
        )
        yield Doubt(DoubtKind.TERMS, words)


MOST_PANELS = 12  # of the figure: four rows of three
PANEL_WIDTH = 2.6  # inches: three panels with a colour bar are as wide as other figures


def draw_modes(cloth: Cloth, frequencies: np.ndarray, shapes: np.ndarray) -> Figure:
    """Draw the first twelve shapes on the flat cloth.

    The colour is the displacement along the direction in which the mode moves most, relative to
    the largest one. The title of a panel is the frequency. `frequencies` are in Hz, `shapes` are
    (count, n, 3).
    """
    count = min(len(shapes), MOST_PANELS)
    columns = min(count, COLUMNS)
    rows = math.ceil(count / COLUMNS)
    width, height = np.ptp(cloth.X, axis=0)
    # as high as the cloth, but not too flat or too high to read, and 0.4 inches for the title
    panel_height = PANEL_WIDTH * min(max(height / width, 0.3), 2.0) + 0.4
    size = PANEL_WIDTH * columns + 0.6, max(panel_height * rows, PANEL_WIDTH)
    figure, axes = new_figure(rows, columns, size)
    axes = np.atleast_1d(axes).ravel()
    for axis, frequency, shape in zip(axes, frequencies, shapes, strict=False):
        # the first right singular vector is the direction in which the nodes move most
        direction = np.linalg.svd(shape, full_matrices=False)[2][0]
        u = shape @ direction
        u = u / u[abs(u).argmax()]
        colours = axis.tripcolor(
            cloth.X[:, 0],
            cloth.X[:, 1],
            cloth.triangles,
            u,
            cmap="RdBu_r",
            vmin=-1,
            vmax=1,
            shading="gouraud",
            rasterized=True,  # SVG has no colours between nodes
        )
        axis.set_title(f"{frequency:.4g} Hz", fontsize=10)
        axis.set_aspect("equal")
    for axis in axes:
        axis.axis("off")
    figure.colorbar(colours, ax=list(axes), label="displacement / largest", shrink=0.8)
    return figure
