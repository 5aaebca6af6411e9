"""The hash of the sources that a case's outcome depends on."""

from __future__ import annotations

import ast
import hashlib
from functools import cache
from pathlib import Path

import fecloth
from fecloth.study.processes import module_of


@cache
def source_of(file: str | Path) -> str:
    """Hash of fecloth's sources, the clock's, the file's, its imports' and the scenes beside it."""
    package, clock = Path(fecloth.__file__).parent, Path(__file__).with_name("timing.py")
    root, module = module_of(Path(file).resolve())
    folders = [root.joinpath(*module.split(".")[:k]) for k in range(module.count(".") + 1)]
    scenes = sorted(scene for at in folders for scene in (at / "scenes").rglob("*.toml"))
    own = (*sorted(_with_imports(Path(file))), *scenes, clock)
    digest = hashlib.sha256()
    for source in (*sorted(package.rglob("*.py")), *own):
        digest.update(source.read_bytes())
    return digest.hexdigest()


def _with_imports(file: Path) -> set[Path]:
    """The file and all that it imports, directly or not, from the folder that its package is in."""
    root, _ = module_of(file.resolve())
    found, waiting = set(), [file.resolve()]
    while waiting:
        source = waiting.pop()
        if source in found or not source.exists():
            continue
        found.add(source)
        for node in ast.walk(ast.parse(source.read_bytes())):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            if isinstance(node, ast.ImportFrom) and node.module:
                names = [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
            waiting += [root.joinpath(*name.split(".")).with_suffix(".py") for name in names]
    return found
