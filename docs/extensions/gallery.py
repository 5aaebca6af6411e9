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
    "trampoline": "--field speed --time 0.1 --size 640x480",
    "drum_on_plate": "--field height --time 0.15 --size 640x480",
    "swing": "--field speed --time 0.3 --size 640x480",
    "benchmark_flag": "--field checks --time 0.8 --size 640x480",
    "sag": "--field height --size 640x480",
    "hanging_strip": "--field larger_stretch --size 640x480",
    "lifted_strip": "--field checks --size 640x480",
    "sleeve": "--field checks --size 640x480",
    "cushion": "--field checks --size 640x480",
}


def commands(name: str) -> list[str]:
    """Return the commands that run a scene and draw it."""
    return [
        f"fecloth run studies/scenes/{name}.toml -o out/{name}",
        f"fecloth render out/{name} -o {name}.png {PICTURES[name]}",
    ]


def told(name: str) -> tuple[str, str]:
    """Return the title of a scene, and the first paragraph of the comment at its head."""
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
        """A section for each scene: its title, its picture, what it is and its commands."""

        def text(self) -> str:
            return "\n".join(section(name) for name in PICTURES)

    def section(name: str) -> str:
        title, words = told(name)
        title = f"{title[0].upper()}{title[1:]}"
        lines = [title, "-" * len(title), "", f".. image:: ../studies/scenes/{name}.png"]
        lines += ["   :width: 480px", f"   :alt: {title}", "", words, "", "::", ""]
        return "\n".join([*lines, *(f"   {line}" for line in commands(name)), ""])

    def setup(app: Sphinx) -> dict[str, bool]:
        app.add_directive("gallery", Gallery)
        return {"parallel_read_safe": True}
