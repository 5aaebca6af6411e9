"""`fecloth new`: commented files to begin with, of a scene or of a specimen."""

import re
from pathlib import Path
from typing import Annotated, Literal

from fecloth.errors import InputError


def new(
    name: Annotated[str, "of the files: NAME.toml and others", "NAME"],
    *,
    kind: Annotated[Literal["cloth", "drop", "static", "geo"], "of the scene (cloth)"] = "cloth",
    test: Annotated[
        Literal["tension", "cantilever", "drape"] | None,
        "a specimen with its fit, in place of a scene",
    ] = None,
    pedestal: Annotated[bool, "of --test drape: laid onto its support, with contact"] = False,
    overwrite: Annotated[bool, "replace files of these names"] = False,
) -> int:
    """Write a commented scene to begin with, or a specimen with its fit and example data.

    The files are NAME.toml, NAME.geo if it has a mesh, and for a test NAME_fit.toml and NAME.csv.
    Raises `InputError` for a wrong name, for --pedestal without --test drape, and for files that
    exist without --overwrite.
    """
    stem = test or kind  # of the templates
    target = Path(name)
    if target.suffix == ".toml":
        target = target.with_suffix("")
    if not re.fullmatch(r"[\w+-][\w .+-]*", target.name):
        allowed = "must be a file name of letters, digits, spaces, _, +, - and ."
        raise InputError(f"NAME = {name!r}", allowed, "new")
    folder = Path(__file__).with_name("specimens")
    # The template of each ending of a file, as pendulum.toml for swing.toml.
    templates = {path.name.removeprefix(stem): path for path in sorted(folder.glob(f"{stem}[._]*"))}
    if pedestal:
        if test != "drape":
            raise InputError("--pedestal", "needs --test drape", "new")
        templates[".toml"] = folder / "pedestal.toml"
        del templates[".geo"]  # the whole disc in place of the ring
    written = {target.with_name(target.name + end): path for end, path in templates.items()}
    if not overwrite and (existing := [path for path in written if path.exists()]):
        raise InputError(f"{existing[0]} exists", "needs --overwrite", "new")
    target.parent.mkdir(parents=True, exist_ok=True)
    for path, template in written.items():
        text = template.read_text(encoding="utf-8").replace("NAME", target.name)
        path.write_text(text, encoding="utf-8")
        print(f"wrote {path}")
    next_command = f"fecloth run {target}.toml"
    if test:
        next_command += f"; your numbers, and fecloth fit {target}_fit.toml"
    print(f"next: {next_command}")
    return 0
