"""The pictures of the scenes, with the commands that make them.

`python docs/extensions/gallery.py` makes all pictures anew, in `studies/scenes/`.
"""

import shlex
import subprocess
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[2]
SCENES = ROOT / "studies" / "scenes"
PICTURES = {  # of each scene: how it is drawn
    "flag": "--field checks --time 1.6 --size 960x540",
    "drape": "--field checks --size 640x480",
    "drop": "--field checks --size 640x480",
    "dome": "--field larger_stretch --size 640x480",
    "inflated_disk": "--field height --size 640x480",
    "trampoline": "--field velocity --time 0.1 --size 640x480",
    "drum_on_plate": "--field height --time 0.15 --size 640x480",
    "swing": "--field velocity --time 0.3 --size 640x480",
    "benchmark_flag": "--field checks --time 0.8 --size 640x480",
    "sag": "--field height --size 640x480",
    "hanging_strip": "--field larger_stretch --size 640x480",
    "lifted_strip": "--field checks --size 640x480",
    "sleeve": "--field checks --size 640x480",
    "cushion": "--field checks --size 640x480",
}

SEEN = {  # in each picture
    "flag": "A flag at a pole on its left. The wind drives waves that grow towards its end.",
    "drape": "A ring of cloth hangs in folds around its support, which is not drawn.",
    "drop": "A square sheet over a ball. Its corners hang down, with folds between them.",
    "dome": "A disk, clamped at its rim and blown up: the colours show that its stretch is even.",
    "inflated_disk": "A disk, held around and blown up. The colours show the height.",
    "trampoline": "A disk that is let go: rings run in from the rim. Colours: velocity.",
    "drum_on_plate": "A square, held around, that has fallen onto a plate below. Colours: height.",
    "swing": "A sheet, held along one edge, swings down. Colours: velocity.",
    "benchmark_flag": "A flag that falls beside its pole, and crumples.",
    "sag": "A square, held around, sags in its middle. Colours: height.",
    "hanging_strip": "A strip that hangs: the colours show that its stretch grows upwards.",
    "lifted_strip": "A heavy strip on the floor, whose right end is lifted.",
    "sleeve": "A tube, pressed together at its upper end: folds run down from there.",
    "cushion": "Two squares, sewn and blown up to a cushion with pointed corners.",
}


def commands(name: str) -> list[str]:
    """Return the commands that run a scene and draw it."""
    return [
        f"fecloth run studies/scenes/{name}.toml -o out/{name}",
        f"fecloth render out/{name} -o {name}.png {PICTURES[name]}",
    ]


def told(name: str) -> tuple[str, str]:
    """Return the title of a scene, and the comment at its head."""
    text = (SCENES / f"{name}.toml").read_text(encoding="utf-8")
    lines = []
    for line in text.splitlines():
        if not line.startswith("# "):
            break
        lines.append(line.removeprefix("# "))
    return tomllib.loads(text)["title"], " ".join(lines)


def main() -> None:
    for name in PICTURES:
        run, draw = commands(name)
        subprocess.run(shlex.split(run) + ["--overwrite", "--quiet"], cwd=ROOT, check=True)
        draw = draw.replace(f"-o {name}.png", f"-o studies/scenes/{name}.png")
        subprocess.run(shlex.split(draw), cwd=ROOT, check=True)


if __name__ == "__main__":
    main()
else:
    from generated import Generated
    from sphinx.application import Sphinx

    class Gallery(Generated):
        """A thumbnail of each scene that leads to its section, and these sections."""

        def text(self) -> str:
            cards = "\n".join(card(name) for name in PICTURES)
            sections = "\n".join(section(name) for name in PICTURES)
            return f".. grid:: 2 3 4 4\n   :gutter: 2\n\n{cards}\n\n{sections}"

    def heading(name: str) -> str:
        title, _ = told(name)
        return f"{title[0].upper()}{title[1:]}"

    def card(name: str) -> str:
        lines = [
            f".. grid-item-card:: {heading(name)}",
            f"   :img-top: ../studies/scenes/{name}.png",
        ]
        lines += [f"   :link: scene-{name}", "   :link-type: ref", f"   :img-alt: {SEEN[name]}"]
        lines += ["", f"   {SEEN[name]}", ""]
        return "\n".join(f"   {line}" for line in lines)

    def section(name: str) -> str:
        title, (_, words) = heading(name), told(name)
        lines = [f".. _scene-{name}:", "", title, "-" * len(title), ""]
        lines += [f".. figure:: ../studies/scenes/{name}.png", "   :width: 480px"]
        lines += [f"   :alt: {SEEN[name]}", "", f"   {SEEN[name]}", "", words, "", "::", ""]
        shown = [f"fecloth demo {name}", commands(name)[1]]
        return "\n".join([*lines, *(f"   {line}" for line in shown), ""])

    def setup(app: Sphinx) -> dict[str, bool]:
        app.add_directive("gallery", Gallery)
        return {"parallel_read_safe": True}
