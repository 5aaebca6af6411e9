"""What a scene says, as objects."""

from __future__ import annotations

from dataclasses import dataclass

from fecloth.mesh.cloth import Cloth
from fecloth.nonlinear.options import Newton
from fecloth.simulation.probes import Probe
from fecloth.system.state import State
from fecloth.system.system import System


@dataclass(frozen=True, eq=False)
class Built:
    """The objects of a scene, ready for `march`.

    Attributes
    ----------
    cloth, system, state, method, dt, t_end
        As `march` takes them; state is the start.
    newton, linear
        Options of the nonlinear solve, and the choice of the linear solver.
    probes
        For `run`.
    frame_steps, stops
        Steps between two frames of the output; or, where that is None, their times.
    frame_format
        "vtu" or "vtkhdf".
    note
        A line to say before the run, or "".
    restarts
        Steps (an int) or seconds between two restart files; None for none.
    """

    cloth: Cloth
    system: System
    state: State
    method: object
    dt: float | None
    t_end: float
    newton: Newton
    linear: str
    probes: tuple[Probe, ...]
    frame_steps: int | None
    stops: tuple[float, ...]
    frame_format: str = "vtu"
    note: str = ""
    restarts: int | float | None = None
