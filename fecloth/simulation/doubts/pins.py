"""Warnings about pins that hold less than was probably meant."""

import re
from collections.abc import Iterator

import numpy as np

from fecloth.linalg.aggregation import rigid_motions
from fecloth.mesh.cloth import Cloth
from fecloth.simulation.doubts.doubt import Doubt, DoubtKind
from fecloth.simulation.doubts.planned_run import PlannedRun, attempt
from fecloth.simulation.doubts.signals import Signal, name_motion
from fecloth.simulation.doubts.units import is_stiff
from fecloth.simulation.load_steps import LoadSteps
from fecloth.system.pins import Motion, Pin, Slide
from fecloth.system.system import System
from fecloth.terms.loads.gravity import Gravity
from fecloth.terms.traits import has_kind, traits_of

LEAST_DROPPED = 0.01  # part of a motion along its own slide that is reported
# Over an edge; a region that covers more was meant to hold more than its one node.
REACH_OF_REGION = 0.25
LEAST_CORNER = 0.5  # rad between two edges of the border; less is a curved side
LONGEST_LEVER = 12.0  # bending lengths; a cloth that is longer hangs down from a clamp as well
# By how much interpolation moves nodes, least and most, over the extent of the cloth.
ERROR_OF_PLACES = (1e-6, 3e-3)
# Of the deviation from a uniform stretch; a wave of 6 nodes has it from node to node.
LEAST_ZIGZAG = 0.5
FEWEST_NODES = 6  # the deviation of fewer is rough in any case
INTERNAL = ("membrane", "bending", "damping")  # kinds of terms that leave a rigid motion alone
LEAST_TURNING = 0.1  # part of the load that turns the cloth about its pins


def find_idle_pins(run: PlannedRun) -> Iterator[Doubt]:
    """Doubt each pin that is moved in vain, and each region of one node."""
    return (doubt for doubt in _check_each_pin(run) if doubt)


def _check_each_pin(run: PlannedRun) -> Iterator[Doubt | None]:
    """Yield what each check says of each pin; None where there is nothing to say."""
    motions = {signal.name: signal for signal in run.signals}
    for name, (pin, nodes) in run.system.constraints.groups.items():
        yield _late_release(run, name, pin)
        if pin.motion is not None and pin.rotate is None:
            yield attempt(_constant_motion, run, name, pin, motions, otherwise=None)
        if isinstance(pin, Slide) and pin.moves:
            yield attempt(_dropped_motion, name, pin, motions[name_motion(name)], otherwise=None)
        if len(nodes) == 1:
            yield _one_node(run.system.cloth, name, pin, int(nodes[0]))


def _late_release(run: PlannedRun, name: str, pin: Pin) -> Doubt | None:
    """Warn of a pin that would let go only after the run."""
    if pin.until is None or pin.until < run.t_end or isinstance(run.steps, LoadSteps):
        return None
    words = (
        f"pin {name!r} holds to the end of the run, at {run.t_end:g} s, as until = "
        f"{pin.until:g} s is not before it"
    )
    return Doubt(DoubtKind.NO_EFFECT, words, "is it in another unit?")


def _constant_motion(
    run: PlannedRun, name: str, pin: Pin, motions: dict[str, Signal]
) -> Doubt | None:
    """Warn of a motion that is the same from the start to the end, and not zero by intent.

    In a run a motion that is zero may begin later. Load steps end at t = 1, where a motion that
    depends on t is not zero.
    """
    if not run.state.t < run.t_end:  # all loads act already: nothing will move
        return None
    _, places = motions[name_motion(name)].samples
    if isinstance(pin.motion, Motion):
        texts = [formula.text for formula in pin.motion.formulas]
    else:
        texts = ["t"]
    may_be_zero = not (isinstance(run.steps, LoadSteps) and re.search(r"\bt\b", " ".join(texts)))
    if (may_be_zero and not places.any()) or (places != places[0]).any():
        return None
    words = (
        f"pin {name!r}: its motion is the same at all t = {run.state.t:g} … {run.t_end:g}, so "
        "that its nodes stand still, as only the changes of a motion count"
    )
    return Doubt(DoubtKind.PINS, words, "multiply it by t")


def _dropped_motion(name: str, pin: Slide, motion: Signal) -> Doubt | None:
    """Warn of a slide that is moved along itself, where its nodes are free."""
    _, places = motion.samples
    moves = (places - places[0]).reshape(len(places), -1, 3)
    along = np.linalg.norm(moves @ pin.projector, axis=-1).max()
    most = np.linalg.norm(moves, axis=-1).max()
    if not along > LEAST_DROPPED * most:
        return None
    key = "direction" if pin.normal is None else "normal"
    words = (
        f"pin {name!r}: {100 * along / most:.0f} % of its motion of {most:.3g} m lies along "
        "its own slide, where the nodes are free, and has no effect"
    )
    remedy = f"leave {key} out to move the nodes, or move the slide across itself"
    return Doubt(DoubtKind.PINS, words, remedy)


def find_free_fall(run: PlannedRun) -> Iterator[Doubt]:
    """Note a cloth under gravity that no pin, air, obstacle or other force holds."""
    terms = run.system.terms
    traits = [traits_of(term) for term in terms if not isinstance(term, Gravity)]
    has_gravity = len(traits) < len(terms)
    is_held = len(run.system.constraints.nodes) or any(
        trait.kind not in INTERNAL or trait.damps == "motion" for trait in traits
    )
    if has_gravity and not is_held:
        words = "nothing holds the cloth, no pin, air or obstacle: it falls freely"
        yield Doubt(DoubtKind.PINS, words)


# --- a region that catches one node ------------------------------------------


def _one_node(cloth: Cloth, name: str, pin: Pin, node: int) -> Doubt | None:
    """Warn of a region that holds one node of a side, or was meant to hold more than one."""
    if not callable(pin.where):  # a list of one node, or the name of a node, is meant
        return None
    X, Y = cloth.X[node]
    near = np.unique(cloth.cells[(cloth.cells == node).any(axis=1)])
    edges = cloth.X[near[near != node]] - cloth.X[node]
    around = cloth.X[node] + REACH_OF_REGION * edges
    # A predicate of the user may know the nodes of the cloth alone.
    is_in_region = attempt(pin.where, around, otherwise=np.zeros(0, bool))
    if not (np.any(is_in_region) or _is_within_a_side(cloth, node)):
        return None
    edge = np.linalg.norm(edges, axis=1).min()
    words = (
        f"pin {name!r} holds one node only, at ({X:.3g}, {Y:.3g}) m, and the cloth turns about "
        f"it: the next one is {edge:.3g} m away"
    )
    remedy = (
        "Make the region larger to hold an edge, or "
        f"give the node by its number, {node}, if it is meant"
    )
    return Doubt(DoubtKind.PINS, words, remedy)


def _is_within_a_side(cloth: Cloth, node: int) -> bool:
    """Return whether the node lies on the border of the cloth and is no corner of it."""
    border = cloth.edge_sets.get("boundary", np.empty((0, 2), int))
    edges = border[(border == node).any(axis=1)]
    if len(edges) != 2:
        return False
    a, b = (cloth.X[edge[edge != node][0]] - cloth.X[node] for edge in edges)
    cosine = a @ b / np.linalg.norm(a) / np.linalg.norm(b)
    turn = np.pi - np.arccos(np.clip(cosine, -1, 1))
    return bool(turn < LEAST_CORNER)


# --- held nodes that start beside their places -------------------------------


def find_uneven_start(run: PlannedRun) -> Iterator[Doubt]:
    """Doubt held nodes that zigzag at the start, as after interpolation from another mesh.

    What a uniform stretch and a turn leave of their places is smooth where it is meant; errors
    of interpolation change from node to node, and are small.
    """
    cloth = run.system.cloth
    for name, (pin, nodes) in run.system.constraints.groups.items():
        off = _zigzag(cloth, nodes, run.state.x[nodes] @ (np.eye(3) - pin.projector))
        if ERROR_OF_PLACES[0] < off / cloth.extent < ERROR_OF_PLACES[1]:
            words = (
                f"pin {name!r} holds its nodes where they start, and they start up to "
                f"{1e3 * off:.3g} mm beside their neighbours' line, as after interpolation from "
                "another mesh"
            )
            remedy = "set x[nodes] to the places that the pin is to hold"
            yield Doubt(DoubtKind.START, words, remedy)


def _zigzag(cloth: Cloth, nodes: np.ndarray, x: np.ndarray) -> float:
    """Return how far nodes lie off the mean of their neighbours [m]; 0 if they lie smoothly.

    `nodes` (k,) are the nodes, at x (k, 3). A uniform stretch and a turn of the flat cloth are
    taken off first; only neighbours among the nodes count.
    """
    if len(nodes) < FEWEST_NODES:
        return 0.0
    affine = np.column_stack([np.ones(len(nodes)), cloth.X[nodes]])
    off = x - affine @ np.linalg.lstsq(affine, x, rcond=None)[0]
    pairs = _neighbours(cloth, nodes)
    sums = np.zeros_like(off)
    np.add.at(sums, pairs[:, 0], off[pairs[:, 1]])
    counts = np.bincount(pairs[:, 0], minlength=len(nodes))
    is_inner = counts > 1
    beside = off[is_inner] - sums[is_inner] / counts[is_inner, None]
    apart = np.linalg.norm(beside, axis=1).max(initial=0)
    if apart > LEAST_ZIGZAG * np.linalg.norm(off, axis=1).max():
        return float(apart)
    return 0.0


def _neighbours(cloth: Cloth, nodes: np.ndarray) -> np.ndarray:
    """Return the pairs (p, 2) of nodes on an edge, in both orders, as places in `nodes`."""
    edges = np.stack([cloth.parts, np.roll(cloth.parts, 1, axis=1)], axis=-1).reshape(-1, 2)
    place = np.full(len(cloth.X), -1)
    place[nodes] = np.arange(len(nodes))
    pairs = place[edges]
    pairs = pairs[(pairs >= 0).all(axis=1)]
    return np.unique(np.concatenate([pairs, pairs[:, ::-1]]), axis=0)


# --- a line of pins about which the cloth turns ------------------------------


def find_free_turn(run: PlannedRun) -> Iterator[Doubt]:
    """Note pins on a line if the load turns a cloth about it that a clamp would hold up."""
    system = run.system
    state = run.state
    fabrics = system.panel.fabrics
    rigidities = [max(fabric.bending) for fabric in fabrics if fabric.bending]
    bends = has_kind(system.terms, "bending") and rigidities
    if not bends or any(map(is_stiff, fabrics)) or system.panel.clamps is not None:
        return
    motion = rotation_about_pins(system, state.x)
    if motion is None:
        return
    f = system.force(state)
    reach = np.linalg.norm(motion, axis=1).max()  # of a rotation by 1 rad/s: a distance
    load = float(np.linalg.norm(f, axis=1).sum())
    if not abs(np.vdot(f, motion)) > LEAST_TURNING * load * reach:
        return
    length = (max(rigidities) * system.cloth.area / load) ** (1 / 3)
    if reach < LONGEST_LEVER * length:
        words = (
            f"the pins lie on a line, and the cloth turns about it like a door ({reach:.3g} m "
            f"wide), though it is stiff in bending over {length:.2g} m"
        )
        remedy = "to clamp it, write clamp = true in the pin and take PlateBending"
        yield Doubt(DoubtKind.PINS, words, remedy)


def rotation_about_pins(system: System, x: np.ndarray) -> np.ndarray | None:
    """Return the velocities of the one rotation that all pins allow, or None.

    They are (n, 3) [m/s] at 1 rad/s. There is none without pins, for a cloth that can turn about
    several axes or shift, and for one that starts at one point.
    """
    constraints = system.constraints
    size = np.ptp(x, axis=0).max()
    if not len(constraints.nodes) or not size:
        return None
    modes = rigid_motions(x / size)
    held = np.stack([constraints.held_part(mode).ravel() for mode in modes], axis=1)
    _, values, rows = np.linalg.svd(held, full_matrices=True)
    values = np.pad(values, (0, 6 - len(values)))
    free = rows[values <= 1e-6 * max(values[0], 1e-300)]
    if len(free) != 1:
        return None
    (motion,) = free  # parts of the three shifts and of the three turns
    turn = np.linalg.norm(motion[3:])
    if turn < 1e-6:
        return None
    return np.tensordot(motion, modes, 1) * size / turn
