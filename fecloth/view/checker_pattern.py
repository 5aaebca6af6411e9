"""The cloth as a checked weave (`fecloth render --field checks`): its squares lie along warp and
weft, so that what they have become shows stretch and shear."""

from __future__ import annotations

import math

import numpy as np

from fecloth.errors import InputError
from fecloth.output.frame_reader import Frame

CHECKS = "checks"
ACROSS = 15  # squares, about, across the larger side of the cloth
SHADES = (250, 250, 248), (150, 173, 208), (38, 70, 128)  # of no, one and two dark threads
PIXELS = 64  # a square's side in the picture that is laid on the cloth


def side(X: np.ndarray) -> float:
    """Side of a square [m], a round number, for material points (n, 2) [m].

    Examples
    --------
    >>> side(np.array([[0.0, 0.0], [1.5, 1.0]]))
    0.1
    """
    wanted = math.log10(np.ptp(X, axis=0).max() / ACROSS)
    decade = math.floor(wanted)
    nearest = min((1, 2, 5, 10), key=lambda digit: abs(math.log10(digit) - (wanted - decade)))
    return float(f"{nearest}e{decade}")


def material(frame: Frame) -> np.ndarray:
    """Material coordinates X (n, 2) [m] of a frame's nodes.

    Raises
    ------
    InputError
        If the frames do not hold the displacement.
    """
    if "displacement" not in frame.point_data:
        remedy = "Frames of `fecloth run` and `write_vtk` do."
        raise InputError(f"field {CHECKS!r}", "needs frames with a displacement", remedy=remedy)
    return (frame.points - frame.point_data["displacement"])[:, :2]


def weave() -> np.ndarray:
    """One repeat of the pattern, two squares each way: a picture (2 PIXELS, 2 PIXELS, 3).

    Examples
    --------
    >>> weave()[0, 0].tolist(), weave()[-1, -1].tolist()
    ([250, 250, 248], [38, 70, 128])
    """
    dark = np.repeat([0, 1], PIXELS)
    return np.array(SHADES, np.uint8)[dark[:, None] + dark[None, :]]
