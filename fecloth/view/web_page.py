"""fecloth view DIR: write one HTML file that shows the moving cloth in any browser, offline.

The page contains positions and field values of the frames as 16-bit numbers between their
extremes (an error of at most 1/131,070 of the range) in base64; page/viewer.js draws them with
WebGL 2. If the file of a long run would exceed `MOST_BYTES`, it contains every k-th frame and
says so.
"""

import base64
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from fecloth.errors import InputError, amount
from fecloth.output import frame_reader
from fecloth.output.atomic_files import replace_file
from fecloth.output.obstacle_frames import Obstacles, read_obstacles
from fecloth.quantities import toml_file
from fecloth.view import checker_pattern


@cache
def _environment() -> Any:
    from jinja2 import Environment, PackageLoader, StrictUndefined  # 50 ms, for pages alone

    loader = PackageLoader("fecloth.view", "page")
    return Environment(loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True)


def render(template: str, values: Mapping[str, object]) -> str:
    """Return a template with its values; texts are escaped, but not results of `render`."""
    from markupsafe import Markup

    return Markup(_environment().get_template(template).render(values))


MOST_BYTES = 60e6  # of frames in a page, which a browser has to load at once
SHOWN = (
    "larger_stretch",
    "smaller_stretch",
    "velocity",
    "displacement",
    "energy_density",
    "contact_pressure",
    "slip",
)
ROUND_OFF = 1e-9  # over the other end of a colour bar; an end that is smaller is 0
CLIPPED_PERCENT = 0.5  # of the values beyond each end of a colour bar, so that no peak sets it
# The camera is in front and to the side, and higher up if the cloth is flat.
AZIMUTH = math.radians(-62.0)
ELEVATION = math.radians(16.0)
ELEVATION_OF_FLAT = math.radians(35.0)
# Viridis by van der Walt and Smith (2015) at equal steps, between which viewer.js interpolates.
VIRIDIS = (
    "#440154",
    "#482475",
    "#414487",
    "#355f8d",
    "#2a788e",
    "#21918c",
    "#22a884",
    "#44bf70",
    "#7ad151",
    "#bddf26",
    "#fde725",
)


@dataclass(frozen=True)
class View:
    """Direction of a camera.

    Attributes
    ----------
    box
        (2, 3) two corners of the box that it looks at [m].
    azimuth, elevation
        Angles of the camera about the centre of the box [rad].
    """

    box: np.ndarray
    azimuth: float
    elevation: float


def view_of(low: np.ndarray, high: np.ndarray) -> View:
    """Return a view of the box between two corners (3,); a flat box is seen from higher up.

    A box is flat if from `ELEVATION` its front looks lower than its top.
    """
    width, depth, height = high - low
    elevation = ELEVATION
    if height < math.tan(ELEVATION) * max(width, depth):
        elevation = ELEVATION_OF_FLAT
    return View(np.array([low, high]), AZIMUTH, elevation)


def ground_of(low: np.ndarray, high: np.ndarray, obstacles: Iterable[Obstacles | None]) -> float:
    """Return the height of the ground [m]: below the cloth's box and below near obstacles."""
    size = float(np.linalg.norm(high - low))
    shown = [surface.points for surface in obstacles if surface and len(surface.points)]
    feet = [float(points[:, 2].min()) for points in shown]
    return max(min([low[2], *feet]), low[2] - 0.5 * size) - 0.03 * size


def write_view(folder: str | Path, fields: Sequence[str] = ()) -> Path:
    """Write ``folder``/view.html, which opens at the last frame, and return its path.

    It shows the `fields`, names that `frame_reader.field_values` takes, by default those of
    `SHOWN`. Raises `InputError` for a folder without frames, or an unknown field.
    """
    series = frame_reader.Series.open(folder)
    fields = fields or shown_fields(series.read(0))
    frames = select_frames(series, len(fields))
    unit = unit_of(series.folder)
    obstacles = [read_obstacles(series.folder, i) for i in frames]
    data = pack_frames((series.read(i) for i in frames), fields, unit, obstacles)
    count = len(data["times"])
    note = f"{amount(count, 'frame')}, {amount(data['cells'], 'triangle')}"
    if len(frames) < len(series.times):  # `select_frames` has left some out
        note += f" (of {len(series.times)} frames: the page with all would be too large)"
    page = fill_template("view.html", data, {"title": title_of(series.folder), "note": note})
    file = series.folder / "view.html"
    replace_file(file, page.encode())
    return file


def shown_fields(frame: frame_reader.Frame) -> list[str]:
    """Return the fields of `SHOWN` that a frame has."""
    available = frame_reader.fields_of(frame)
    return [name for name in SHOWN if name in available]


def select_frames(series: frame_reader.Series, fields: int) -> list[int]:
    """Return the indices of evenly spaced frames that fit into `MOST_BYTES`."""
    first = series.read(0)
    numbers = 3 * len(first.points) + fields * max(len(first.points), len(first.cells))
    bytes_of_frame = 2 * 4 / 3 * numbers  # two bytes each, in base64
    return series.spread(int(MOST_BYTES / bytes_of_frame))


def title_of(folder: Path) -> str:
    """Return the title of the scene that was run, or else the name of the folder."""
    return _scene_of(folder).get("title") or folder.resolve().name


def unit_of(folder: Path) -> str:
    """Return what follows a value of t in words: " s", of a static scene " of the loads"."""
    if "equilibrium" in _scene_of(folder):
        return " of the loads"
    return " s"


def _scene_of(folder: Path) -> dict:
    """Return the tables of the scene that was run; {} for other folders."""
    scene = folder / "scene.resolved.toml"
    if scene.is_file():
        return toml_file.parse(scene.read_text(encoding="utf-8"))
    return {}


def fill_template(template: str, data: dict, values: Mapping[str, object]) -> str:
    """Return a page of page/ with the data that viewer.js draws, and the values, escaped."""
    plain = json.dumps(data, ensure_ascii=False, allow_nan=False).replace("<", "\\u003c")
    return render(template, {**values, "data": plain}) + "\n"


def pack_frames(
    frames, fields: Sequence[str], unit: str = " s", obstacles: Sequence[Obstacles | None] = ()
) -> dict:
    """Return the data that viewer.js draws, for JSON, with arrays in base64.

    Raises `InputError` if there is no frame.

    Parameters
    ----------
    frames
        `Frame`s of one mesh.
    fields
        Names that `frame_reader.field_values` takes.
    unit
        What follows the time of a frame.
    obstacles
        The obstacles in each frame.
    """
    times = []
    positions = []
    values: dict[str, list[np.ndarray]] = {name: [] for name in fields}
    for frame in frames:
        times.append(frame.t)
        positions.append(frame.points)
        for name in fields:
            values[name].append(frame_reader.field_values(frame, name))
    if not times or not len(positions[0]):
        raise InputError("no frames", "a view needs at least one")
    points = frame_reader.clip_to_drawable(np.array(positions))
    low = points.min(axis=(0, 1))
    high = points.max(axis=(0, 1))
    view = view_of(low, high)
    triangles = frame_reader.straight(frame.cells)  # the same in all frames
    return {
        "colours": [[byte / 255 for byte in bytes.fromhex(colour[1:])] for colour in VIRIDIS],
        "shades": checker_pattern.SHADES,
        "times": times,
        "unit": unit,
        "start": len(times) - 1,  # the first frame is often flat
        "nodes": points.shape[1],
        "cells": len(frame.cells),
        "low": low.tolist(),
        "high": high.tolist(),
        "ground": ground_of(low, high, obstacles),
        "azimuth": view.azimuth,
        "elevation": view.elevation,
        "points": _to_16_bits(points, low, high),
        "triangles": _to_base64(triangles.astype("<u4")),
        "rim": _to_base64(frame_reader.rim(triangles).astype("<u4")),
        "fields": [_field(name, np.array(values[name]), points.shape[1]) for name in fields],
        "checks": _checks(frame),
        "obstacles": _obstacles(obstacles),
    }


def _obstacles(frames: Sequence[Obstacles | None]) -> list[dict]:
    """Return the points and triangles of obstacles as base64, and from which frame on they show.

    `frames` are the obstacles in each frame. They are packed again only where they move.
    """
    packed: list[dict] = []
    for i, obstacles in enumerate(frames):
        if obstacles is None:
            continue
        points = _to_base64(obstacles.points.astype("<f4"))
        if not packed or packed[-1]["points"] != points:
            triangles = _to_base64(obstacles.triangles.astype("<u4"))
            packed.append({"from": i, "points": points, "triangles": triangles})
    return packed


def _checks(frame: frame_reader.Frame) -> dict | None:
    """Return the material coordinates of the nodes in squares, and the side of a square [m]."""
    if "displacement" not in frame.point_data:
        return None
    X = checker_pattern.material_coordinates(frame)
    side = checker_pattern.square_side(X)
    return {"side": side, "material": _to_base64((X / side).astype("<f4"))}


def _field(name: str, values: np.ndarray, nodes: int) -> dict:
    """Return what viewer.js needs of a field: its name and unit, its values and their range.

    `values` are (frames, count), with one value for each of the `nodes` or for each cell. "low"
    and "high" are the extremes of all values, and "shown" the ends of the colour bar, between
    which all but a few values lie.
    """
    values = frame_reader.clip_to_drawable(values)
    low = float(values.min())
    high = float(values.max())
    return {
        "title": name,
        "unit": frame_reader.unit_of_field(name),
        "per": "node" if values.shape[1] == nodes else "cell",
        "count": values.shape[1],
        "low": low,
        "high": high,
        "shown": colour_range(values),
        "values": _to_16_bits(values, low, high),
    }


def colour_range(values: np.ndarray) -> tuple[float, float]:
    """Return the ends of a colour bar: all but a few of the values lie between them.

    An end that is round-off beside the other one is 0.
    """
    percents = [CLIPPED_PERCENT, 100 - CLIPPED_PERCENT]
    low, high = (float(end) for end in np.percentile(values, percents))
    round_off = ROUND_OFF * max(abs(low), abs(high))
    return low if abs(low) > round_off else 0.0, high if abs(high) > round_off else 0.0


def _to_16_bits(values, low, high) -> str:
    """Return numbers as base64 of 16-bit fractions between `low` and `high`."""
    span = np.subtract(high, low)
    span = np.where(span > 0, span, 1.0)
    return _to_base64(np.round((values - low) / span * 65535).astype("<u2"))


def _to_base64(array: np.ndarray) -> str:
    return base64.b64encode(np.ascontiguousarray(array).tobytes()).decode("ascii")
