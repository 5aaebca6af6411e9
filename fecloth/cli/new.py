"""`fecloth new`: the commented files of a specimen to begin with."""

import re
from argparse import Namespace
from importlib.resources import files
from pathlib import Path

from fecloth.errors import InputError


def write_specimen(options: Namespace) -> int:
    """Write NAME.toml, NAME_fit.toml, NAME.csv and, if the test has a mesh, NAME.geo."""
    target = Path(options.name)
    target = target.with_suffix("") if target.suffix == ".toml" else target
    if not re.fullmatch(r"[\w+-][\w .+-]*", target.name):
        allowed = "must be a file name of letters, digits, spaces, _, +, - and ."
        raise InputError(f"NAME = {options.name!r}", allowed, "new")
    written = {
        target.with_name(target.name + each.name.removeprefix(options.test)): each
        for each in sorted((files("fecloth.cli") / "specimens").iterdir(), key=lambda e: e.name)
        if re.fullmatch(rf"{options.test}(_fit)?\.\w+", each.name)
    }
    if not options.overwrite and (there := [path for path in written if path.exists()]):
        raise InputError(f"{there[0]} exists", "needs --overwrite", "new")
    target.parent.mkdir(parents=True, exist_ok=True)
    for path, template in written.items():
        text = template.read_text(encoding="utf-8").replace("NAME", target.name)
        path.write_text(text, encoding="utf-8")
        print(f"wrote {path}")
    print(f"next: fecloth run {target}.toml; your numbers, and fecloth fit {target}_fit.toml")
    return 0
