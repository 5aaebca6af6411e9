"""The picture at the head of the README: python studies/picture.py [FILE.png]

Runs the flag scene with a finer mesh and draws it at five times, coloured by the larger principal
stretch. Needs the [view] extra; works without a display.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import pyvista

from fecloth.runner import run_scene
from fecloth.scene import load

HERE = Path(__file__).parent
TIMES = (0.0, 0.24, 0.48, 0.72, 0.96)


def main(target: Path) -> None:
    scene = load(HERE / "scenes" / "flag.toml", ["cloth.h=0.03", "time.t_end=0.96"])
    with tempfile.TemporaryDirectory() as folder:
        outcome = run_scene(scene, Path(folder) / "run")
        draw(outcome.folder / "run.pvd", target)
    print(f"wrote {target}")


def draw(pvd: Path, target: Path) -> None:
    reader = pyvista.get_reader(pvd)
    plotter = pyvista.Plotter(off_screen=True, window_size=(1500, 470), lighting="three lights")
    plotter.set_background("white")
    for i, t in enumerate(TIMES):
        reader.set_active_time_value(min(reader.time_values, key=lambda s: abs(s - t)))
        cloth = reader.read()[0]
        cloth["larger principal stretch"] = cloth["principal_stretches"][:, 1]
        shift = (1.75 * i, 0.0, 0.0)
        plotter.add_mesh(
            cloth.translate(shift),
            scalars="larger principal stretch",
            cmap="viridis",
            clim=(0.995, 1.03),
            smooth_shading=True,
            show_scalar_bar=i == 0,
            scalar_bar_args={
                "color": "black",
                "title_font_size": 16,
                "label_font_size": 14,
                "position_x": 0.4,
                "position_y": 0.02,
                "width": 0.3,
                "height": 0.11,
            },
        )
        pole = pyvista.Line((*shift[:2], -0.7), (*shift[:2], 1.05))
        plotter.add_mesh(pole, color="black", line_width=3)
        plotter.add_point_labels(
            [(shift[0] + 0.3, 0.0, 1.25)], [f"t = {t:g} s"], shape=None, show_points=False
        )
    plotter.camera_position = [(4.0, -9.0, 2.0), (4.0, 0.5, 0.05), (0.0, 0.0, 1.0)]
    plotter.enable_parallel_projection()
    plotter.camera.parallel_scale = 1.35
    target.parent.mkdir(parents=True, exist_ok=True)
    plotter.screenshot(target)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else HERE / "flag.png")
