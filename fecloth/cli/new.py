"""`fecloth new`: commented files to begin with, of a scene or of a specimen."""

import re
from argparse import Namespace
from importlib.resources import files
from pathlib import Path

from fecloth.errors import InputError


def write_specimen(options: Namespace) -> int:
    """Write NAME.toml and the files that belong to it, print what comes next, and return 0.

    The files are NAME.geo if it has a mesh, and for a test NAME_fit.toml and NAME.csv. Raises
    `InputError` for a wrong name, and for files that exist without --overwrite.
    """
    kind = options.test or options.kind  # the templates of this name
    target = Path(options.name)
    if target.suffix == ".toml":
        target = target.with_suffix("")
    if not re.fullmatch(r"[\w+-][\w .+-]*", target.name):
        allowed = "must be a file name of letters, digits, spaces, _, +, - and ."
        raise InputError(f"NAME = {options.name!r}", allowed, "new")
    folder = files("fecloth.cli") / "specimens"
    templates = sorted(folder.iterdir(), key=lambda file: file.name)
    # For each file to write its template, as pendulum.toml for swing.toml.
    written = {
        target.with_name(target.name + template.name.removeprefix(kind)): template
        for template in templates
        if re.fullmatch(rf"{kind}(_fit)?\.\w+", template.name)
    }
    if not options.overwrite and (existing := [path for path in written if path.exists()]):
        raise InputError(f"{existing[0]} exists", "needs --overwrite", "new")
    target.parent.mkdir(parents=True, exist_ok=True)
    for path, template in written.items():
        text = template.read_text(encoding="utf-8").replace("NAME", target.name)
        path.write_text(text, encoding="utf-8")
        print(f"wrote {path}")
    next_command = f"fecloth run {target}.toml"
    if options.test:
        next_command += f"; your numbers, and fecloth fit {target}_fit.toml"
    print(f"next: {next_command}")
    return 0
