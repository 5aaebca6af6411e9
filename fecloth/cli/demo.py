"""`fecloth demo`: the scenes of the gallery, which come with fecloth."""

import tomllib
from importlib import metadata
from pathlib import Path
from typing import Annotated

import fecloth
from fecloth.cli.options import Output, Overwrite, Reading
from fecloth.cli.runs import run

FOLDER = "studies/scenes"  # in a clone, and below share/fecloth of an installation


def demo(
    name: Annotated[str | None, "of a scene (default: list all)", "NAME"] = None,
    *,
    reading: Reading,
    output: Output = None,
    overwrite: Overwrite = False,
) -> int:
    """List the scenes that come with fecloth, or run one of them as `run` does.

    Raises `InputError` for a name that none of them has.
    """
    scenes = gallery()
    if name is None:
        for each, file in scenes.items():
            print(f"{each:18}{tomllib.loads(file.read_text(encoding='utf-8'))['title']}")
        print("next: fecloth demo flag")
        return 0
    from fecloth.validation import known

    known(f"scene {name!r}", name, scenes, "demo")
    return run(str(scenes[name]), reading=reading, output=output, overwrite=overwrite)


def gallery() -> dict[str, Path]:
    """Return the file of each scene by its name."""
    clone = Path(fecloth.__file__).parents[1] / FOLDER
    if clone.is_dir():
        files = list(clone.glob("*.toml"))
    else:
        installed = metadata.files("fecloth") or ()
        files = [Path(f.locate()).resolve() for f in installed if f.match(f"{FOLDER}/*.toml")]
    return {file.stem: file for file in sorted(files)}
