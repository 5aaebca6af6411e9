"""Checker pattern along warp and weft, which shows stretch and shear (`--field checks`)."""

import math

import numpy as np

from fecloth.errors import InputError
from fecloth.output.frame_reader import Frame

CHECKS = "checks"
SQUARES_ACROSS = 15  # wanted along the larger side of the cloth; sides are round numbers
# Where no, one or two dark threads cross.
SHADES = (250, 250, 248), (150, 173, 208), (38, 70, 128)
PIXELS = 64  # side of a square in the texture; more only sharpen the edges of squares


def square_side(X: np.ndarray) -> float:
    """Return a round side of a square [m] for material points (n, 2) [m]."""
    exponent = math.log10(np.ptp(X, axis=0).max() / SQUARES_ACROSS)  # of the side before rounding
    decade = math.floor(exponent)
    nearest = min((1, 2, 5, 10), key=lambda digit: abs(math.log10(digit) - (exponent - decade)))
    return float(f"{nearest}e{decade}")


def material_coordinates(frame: Frame) -> np.ndarray:
    """Return the material coordinates (n, 2) of a frame's nodes [m].

    Raises `InputError` for a frame without displacements.
    """
    if "displacement" not in frame.point_data:
        remedy = "`fecloth run` and `write_vtk` write it."
        what = "frames without a displacement"
        raise InputError(what, "do not tell where the flat cloth was", remedy=remedy)
    return (frame.points - frame.point_data["displacement"])[:, :2]


def weave_texture() -> np.ndarray:
    """Return the texture of one period, two by two squares: (2 PIXELS, 2 PIXELS, 3)."""
    dark = np.repeat([0, 1], PIXELS)
    return np.array(SHADES, np.uint8)[dark[:, None] + dark[None, :]]
