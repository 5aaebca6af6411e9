"""fecloth render DIR -o FILE: draw a run as a movie (.mp4, .gif) or a picture (.png).

The cloth shows a field of `frame_reader.field_values` or a checker pattern. Its shadow lies below,
and the camera is placed so that the whole motion fits. No display is needed,
only the extra [view]: PyVista, and imageio with its ffmpeg for .mp4.
"""

import errno
import io
import math
import os
import signal
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fecloth.errors import InputError
from fecloth.output import frame_reader
from fecloth.output.atomic_files import DiskFull, replace_file, replacing
from fecloth.output.obstacle_frames import Obstacles, read_obstacles
from fecloth.validation import known
from fecloth.view import checker_pattern
from fecloth.view.checker_pattern import CHECKS
from fecloth.view.web_page import View, colour_range, ground_of, unit_of, view_of

SUFFIXES = (".mp4", ".gif", ".png")
# Limits of the frame rate of a movie in real time: slower ones are slides, faster ones not seen.
SLOWEST_FPS = 5.0
FASTEST_FPS = 30.0
HALF_ANGLE = math.radians(15.0)  # of the camera
LIGHT = np.array([0.35, -0.5, 0.9]) / np.linalg.norm([0.35, -0.5, 0.9])
PAPER = "#e9ecef"
SHADOW = "#c3c8cd"
OBSTACLE = "#d9d4cb"
# Sampled values and positions of a frame, to fit colours and camera: all of a run take memory.
SAMPLES_PER_FRAME = 4000


@dataclass(frozen=True, eq=False)
class Shot:
    """Settings of all frames of a movie.

    Attributes
    ----------
    field
        A name that `frame_reader.field_values` takes, or "checks".
    view
        Direction of the camera.
    distance
        Distance of the camera [m].
    colours
        Values at the ends of the colour bar; None for the checker pattern.
    title
        What stands at the colour bar.
    ground
        Height of the ground [m].
    size
        Width and height [pixels].
    """

    field: str
    view: View
    distance: float
    colours: tuple[float, float] | None
    title: str
    ground: float
    size: tuple[int, int]


def render(
    folder: str | Path,
    target: str | Path,
    field: str = "larger_stretch",
    size: tuple[int, int] = (1280, 720),
    fps: float | None = None,
    time: float | None = None,
) -> Path:
    """Draw a run as a movie or a picture, and return the path of the file.

    Raises `InputError` for arguments out of range, for a folder without frames or a field that
    they lack, and if the packages of the extra [view] are not installed.

    Parameters
    ----------
    folder
        The folder of a run.
    target
        A .mp4 or .gif of all frames, or a .png of one frame.
    field
        An array of the frames, a key of `frame_reader.COMPONENTS`, or "checks" for squares along
        warp and weft.
    size
        Width and height [pixels], even numbers for a .mp4.
    fps
        Frames per second; by default in real time, from 5 to 30.
    time
        Time [s] of the frame of a .png; the nearest frame is drawn, by default the last frame.
    """
    target = Path(target)
    _check_arguments(target, size, fps, time)
    series = frame_reader.Series.open(folder)
    names = frame_reader.fields_of(series.read(0))
    known(f"field {field!r}", field, [*names, CHECKS])
    shot = _shot(series, field, size)
    frames: Sequence[int] = range(len(series.times))
    if target.suffix == ".png":
        frames = [series.at(time)]
    if fps is None:
        fps = SLOWEST_FPS
        if length := series.times[-1] - series.times[0]:
            real_time_fps = (len(frames) - 1) / length
            fps = float(np.clip(real_time_fps, SLOWEST_FPS, FASTEST_FPS))
    quiet = import_package("pyvista").vtk_verbosity("error")  # VTK warns without a display
    with quiet:
        _write(target, fps, size, _draw_frames(series, frames, shot))
    return target


def _check_arguments(target: Path, size, fps, time) -> None:
    """Raise `InputError` for arguments of `render` that are out of range or do not fit.

    Only a .mp4 needs even sides, because its colours are stored for squares of 2 × 2 pixels.
    """
    if target.suffix not in SUFFIXES:
        raise InputError(f"-o {target}", f"must end in {', '.join(SUFFIXES)}")
    is_odd = any(side % 2 for side in size)
    if min(size) < 16 or max(size) > 8192 or (target.suffix == ".mp4" and is_odd):
        allowed = "must be 16 to 8192 pixels, even for .mp4"
        raise InputError(f"size {size[0]}x{size[1]}", allowed)
    if fps is not None and not 0 < fps <= 240:
        raise InputError(f"fps = {fps:g}", "must be > 0 and at most 240")
    if time is not None and target.suffix != ".png":
        raise InputError("time", "applies only to a .png", str(target), "Omit it for a movie.")


def import_package(name: str):
    """Return a package of the extra [view]; raise `InputError` if it is not installed."""
    import importlib

    try:
        return importlib.import_module(name)
    except ImportError as error:
        remedy = 'Install it: in the clone, pip install ".[view]".'
        raise InputError(f"a picture needs the package {name}", remedy=remedy) from error


def _write(target: Path, fps: float, size, images: Iterator[np.ndarray]) -> None:
    """Write the images (h, w, 3) to a file; a failure leaves no partial file.

    The suffix of `target` says of which kind. Images of a .mp4 are written one by one; the
    others are gathered in memory.
    """
    if target.suffix == ".mp4":
        with replacing(target) as part:
            _encode(part, fps, size, images)
        return
    imageio = import_package("imageio.v2")
    file = io.BytesIO()
    movie = {}
    if target.suffix == ".gif":
        movie = {"duration": 1000 / fps, "loop": 0}
    with imageio.get_writer(file, format=target.suffix, **movie) as writer:
        for image in images:
            writer.append_data(image)
    replace_file(target, file.getvalue())


def _encode(part: Path, fps: float, size, images: Iterator[np.ndarray]) -> None:
    """Write the images (h, w, 3) to a .mp4 file `part` by ffmpeg.

    `size` is (w, h) in pixels. Raises OSError if ffmpeg fails: with the number of the system if
    the disk is full or the file too large, else with ffmpeg's message.
    """
    ffmpeg = import_package("imageio_ffmpeg").get_ffmpeg_exe()
    width, height = size
    source = f"-f rawvideo -pix_fmt rgb24 -s {width}x{height} -r {fps:g} -i pipe:0"
    movie = "-c:v libx264 -crf 10 -pix_fmt yuv420p -f mp4 -y"
    command = [ffmpeg, "-v", "error", *source.split(), *movie.split(), str(part)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        with suppress(BrokenPipeError):  # ffmpeg has ended; its message has the reason
            for image in images:
                process.stdin.write(image.tobytes())  # type: ignore[union-attr]  # it is a PIPE
        words = process.communicate()[1].decode(errors="replace").strip()
    if process.returncode:
        # The signal of a file beyond the limit of its size; Windows has none.
        too_large = process.returncode == -getattr(signal, "SIGXFSZ", 0)
        number = errno.EFBIG if too_large else DiskFull.errno_in(words)
        if number:
            raise OSError(number, os.strerror(number))
        raise OSError(f"ffmpeg ended with {process.returncode}: {words}")


def _shot(series: frame_reader.Series, field: str, size: tuple[int, int]) -> Shot:
    """Return the settings of all frames: colours and camera fit the whole motion.

    All frames are read once, and samples of their values and points are kept.
    """
    values = []
    points = []
    lows = []
    highs = []
    for i in range(len(series.times)):
        frame = series.read(i)
        if field != CHECKS:
            shown = frame_reader.field_values(frame, field)
            values.append(shown[:: 1 + len(shown) // SAMPLES_PER_FRAME])
        points.append(frame.points[:: 1 + len(frame.points) // SAMPLES_PER_FRAME])
        lows.append(frame.points.min(axis=0))
        highs.append(frame.points.max(axis=0))
    low = np.min(lows, axis=0)
    high = np.max(highs, axis=0)
    view = view_of(low, high)
    colours = None
    title = ""
    if values:
        # A few extreme triangles must not take all colours.
        colours = colour_range(frame_reader.clip_to_drawable(np.concatenate(values)))
        unit = frame_reader.unit_of_field(field)
        title = f"{field} [{unit}]" if unit else field
    width, height = size
    obstacles_at_ends = [read_obstacles(series.folder, i) for i in (0, len(series.times) - 1)]
    return Shot(
        field=field,
        view=view,
        distance=_camera_distance(view, np.concatenate(points), width / height),
        colours=colours,
        title=title,
        ground=ground_of(low, high, obstacles_at_ends),
        size=size,
    )


def _axes(view: View) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the unit vectors to the camera, to the right and up in the picture."""
    a = view.azimuth
    e = view.elevation
    to_camera = np.array([math.cos(e) * math.cos(a), math.cos(e) * math.sin(a), math.sin(e)])
    right = np.array([-math.sin(a), math.cos(a), 0.0])
    return to_camera, right, np.cross(to_camera, right)


def _camera_distance(view: View, points: np.ndarray, aspect: float) -> float:
    """Return the distance at which all points fit, with a margin for the colour bar."""
    to_camera, right, up = _axes(view)
    p = points - view.box.mean(axis=0)
    tan = math.tan(HALF_ANGLE)
    away = np.maximum(np.abs(p @ right) / (tan * aspect), np.abs(p @ up) / tan)
    return float(np.max(1.15 * away + p @ to_camera))


def _draw_frames(series: frame_reader.Series, frames, shot: Shot) -> Iterator[np.ndarray]:
    """Yield the pictures (h, w, 3), one for each number in `frames`.

    The first frame makes the meshes, and each frame moves their points.
    """
    pyvista = import_package("pyvista")
    first = series.read(frames[0])
    triangles = frame_reader.straight(first.cells)
    parts = len(triangles) // len(first.cells)  # triangles drawn for each cell: 1, or 4 for P2
    cloth = pyvista.PolyData.from_regular_faces(first.points.astype(float), triangles)
    shadow = cloth.copy()
    edges = frame_reader.rim(triangles)
    border = pyvista.PolyData(first.points.astype(float), lines=np.insert(edges, 0, 2, axis=1))
    _update_cloth(cloth, first, shot, parts)
    plotter = _make_plotter(pyvista, shot)
    plotter.add_mesh(shadow, color=SHADOW, lighting=False)
    _add_cloth(plotter, cloth, shot, pyvista)
    plotter.add_mesh(border, color="#1b2027", line_width=1.5, lighting=False)
    font_size = max(6, round(shot.size[1] / 75))
    unit = unit_of(series.folder)
    label = "t = " if unit == " s" else ""
    try:
        for i in frames:
            frame = series.read(i)
            _update_cloth(cloth, frame, shot, parts)
            border.points = cloth.points
            add_obstacles(plotter, read_obstacles(series.folder, i), pyvista)
            # Each point goes along the light until it meets the ground.
            drop = (cloth.points[:, 2:] - shot.ground) / LIGHT[2]
            shadow.points = cloth.points - drop * LIGHT
            style = {"font_size": font_size, "color": "#1b2027", "name": "time"}
            place = {"position": (0.02, 0.93), "viewport": True}
            plotter.add_text(f"{label}{frame.t:.3f}{unit}", **place, **style)
            yield plotter.screenshot(return_img=True)
    finally:
        plotter.close()


def add_obstacles(plotter, obstacles: Obstacles | None, pyvista) -> None:
    """Show these obstacles in place of the obstacles of the previous frame; None shows none."""
    if obstacles is None or not len(obstacles.points):
        plotter.remove_actor("obstacles")
        return
    points = obstacles.points.astype(float)
    mesh = pyvista.PolyData.from_regular_faces(points, obstacles.triangles)
    plotter.add_mesh(
        mesh,
        color=OBSTACLE,
        name="obstacles",  # replaces the mesh of this name
        reset_camera=False,
        smooth_shading=True,
        split_sharp_edges=True,
        ambient=0.35,
        diffuse=0.75,
    )


def _update_cloth(cloth, frame: frame_reader.Frame, shot: Shot, parts: int) -> None:
    """Give the mesh `cloth` the positions, the field and the normals of a frame.

    Each cell of the frame has `parts` triangles in the mesh: 1, or 4 for P2.
    """
    cloth.points = frame.points.astype(float)
    if shot.field == CHECKS:
        X = checker_pattern.material_coordinates(frame)
        # The texture has two squares along each side, and is repeated.
        cloth.active_texture_coordinates = X / (2 * checker_pattern.square_side(X))
    else:
        values = frame_reader.field_values(frame, shot.field)
        if len(values) == len(frame.points):
            cloth.point_data["shown"] = values
        else:
            cloth.cell_data["shown"] = np.repeat(values, parts)
    # consistent_normals is not needed: the triangles are oriented alike already.
    cloth.compute_normals(cell_normals=False, consistent_normals=False, inplace=True)


def _make_plotter(pyvista, shot: Shot):
    """Return a plotter with camera and background, on which the meshes are drawn."""
    plotter = pyvista.Plotter(off_screen=True, window_size=shot.size)
    plotter.set_background(PAPER)
    middle = shot.view.box.mean(axis=0)
    eye = middle + shot.distance * _axes(shot.view)[0]
    plotter.camera_position = [tuple(eye), tuple(middle), (0.0, 0.0, 1.0)]
    plotter.camera.view_angle = math.degrees(2 * HALF_ANGLE)
    return plotter


def _add_cloth(plotter, cloth, shot: Shot, pyvista) -> None:
    """Add the mesh `cloth` to the plotter, with the field of the shot or the checker pattern."""
    matter = {"ambient": 0.3, "diffuse": 0.7, "specular": 0.15, "specular_power": 20}
    if shot.field == CHECKS:
        texture = pyvista.Texture(checker_pattern.weave_texture())
        texture.repeat = texture.interpolate = texture.mipmap = True
        look = {"texture": texture}
    else:
        look = {"scalars": "shown", "cmap": "viridis", "clim": shot.colours}
        look |= {"interpolate_before_map": True, "scalar_bar_args": _colour_bar(shot)}
    actor = plotter.add_mesh(cloth, **matter, **look)
    # Phong's shading takes the normals that `_update_cloth` computes. The option smooth_shading
    # would draw a copy of the mesh, which does not move.
    actor.prop.interpolation = "phong"


def _colour_bar(shot: Shot) -> dict:
    """Return the arguments of the colour bar, for PyVista's ``scalar_bar_args``.

    It takes a third of the width of a wide picture, and up to 0.8 of a tall picture. The fonts
    have their usual size in a picture of 1280 × 720 pixels.
    """
    width, height = shot.size
    share = min(0.8, 0.34 * max(1.0, 16 / 9 * height / width))  # of the width
    # The fonts must fit into the height of the picture and into the width of the bar.
    scale = min(height / 720, share * width / (0.34 * 1280))
    return {
        "title": shot.title,
        "color": "#1b2027",
        "n_labels": 2,
        "fmt": "%.4g",
        "title_font_size": round(16 * scale),
        "label_font_size": round(13 * scale),
        "width": share,
        "height": 0.1,
        "position_x": 0.97 - share,
        "position_y": 0.02,
    }
