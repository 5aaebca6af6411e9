"""`fecloth new`: commented files to begin with, of a scene or of a specimen."""

import re
from argparse import Namespace
from importlib.resources import files
from pathlib import Path

from fecloth.errors import InputError


def write_specimen(options: Namespace) -> int:
    """Write NAME.toml, of a test also NAME_fit.toml and NAME.csv, and NAME.geo if it has a mesh."""
    kind = options.test or options.kind
    target = Path(options.name)
    target = target.with_suffix("") if target.suffix == ".toml" else target
    if not re.fullmatch(r"[\w+-][\w .+-]*", target.name):
        allowed = "must be a file name of letters, digits, spaces, _, +, - and ."
        raise InputError(f"NAME = {options.name!r}", allowed, "new")
    written = {
        target.with_name(target.name + each.name.removeprefix(kind)): each
        for each in sorted((files("fecloth.cli") / "specimens").iterdir(), key=lambda e: e.name)
        if re.fullmatch(rf"{kind}(_fit)?\.\w+", each.name)
    }
    if not options.overwrite and (there := [path for path in written if path.exists()]):
        raise InputError(f"{there[0]} exists", "needs --overwrite", "new")
    target.parent.mkdir(parents=True, exist_ok=True)
    for path, template in written.items():
        text = template.read_text(encoding="utf-8").replace("NAME", target.name)
        path.write_text(text, encoding="utf-8")
        print(f"wrote {path}")
    if options.test:
        fit = f"; your numbers, and fecloth fit {target}_fit.toml"
    else:
        fit = ""
    print(f"next: fecloth run {target}.toml{fit}")
    return 0
