"""fecloth run … --watch: a window of PyVista that follows a run, with the extra [view]."""

import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np

from fecloth.errors import InputError
from fecloth.output.frame_reader import straight
from fecloth.output.obstacle_frames import find_obstacles
from fecloth.system.state import State
from fecloth.system.system import System
from fecloth.view.render import PAPER, add_obstacles, import_package

PAUSE = 0.04  # s of the clock between two pictures at least: a run is not to wait for its window
DISPLAYS = ("DISPLAY", "WAYLAND_DISPLAY")


def require_display() -> None:
    """Raise `InputError` where a window cannot open."""
    import_package("pyvista")
    if sys.platform == "linux" and not any(map(os.environ.get, DISPLAYS)):
        remedy = "Leave it out; fecloth view DIR shows the finished run in a browser."
        raise InputError("--watch", "needs a display, and none is set", remedy=remedy)


class Window:
    """A window with the cloth in the colours of its displacement since `start`."""

    def __init__(self, system: System, start: State):
        pyvista = import_package("pyvista")
        self._pyvista = pyvista
        self._system = system
        self._start = start.x.copy()
        triangles = straight(system.cloth.cells)
        self._cloth = pyvista.PolyData.from_regular_faces(start.x.copy(), triangles)
        self._cloth.point_data["displacement [m]"] = np.zeros(len(start.x))
        self._plotter = pyvista.Plotter(title="fecloth")
        self._plotter.set_background(PAPER)
        self._actor = self._plotter.add_mesh(self._cloth, cmap="viridis", show_edges=True)
        self._drawn_at = -np.inf
        self._draw(start)
        self._plotter.camera_position = "iso"
        self._plotter.show(interactive_update=True, auto_close=False)

    @property
    def is_open(self) -> bool:
        """Whether the user has not closed it."""
        return self._plotter.render_window is not None

    def follow(self, state: State) -> None:
        """Draw a state, unless the last picture has just been drawn."""
        if self.is_open and time.monotonic() - self._drawn_at >= PAUSE:
            self._draw(state)
            self._plotter.update()

    def _draw(self, state: State) -> None:
        """Move the cloth and the obstacles to a state."""
        self._drawn_at = time.monotonic()
        displacement = np.linalg.norm(state.x - self._start, axis=1)
        self._cloth.points = state.x.copy()
        self._cloth.point_data["displacement [m]"] = displacement
        self._actor.mapper.scalar_range = 0.0, max(displacement.max(), 1e-9)
        add_obstacles(self._plotter, find_obstacles(self._system, state.x, state.t), self._pyvista)
        self._plotter.add_text(f"t = {state.t:.4g}", name="time", font_size=10)

    def close(self) -> None:
        """Close it, if the user has not."""
        self._plotter.close()


@contextmanager
def watching(system: System, start: State) -> Iterator[Callable[[State], None]]:
    """Yield the function that draws a state; the window closes after the block."""
    window = Window(system, start)
    try:
        yield window.follow
    finally:
        window.close()
