"""Import the files of studies, and hash the sources on which a result depends."""

import ast
import hashlib
import importlib
import sys
from functools import cache
from pathlib import Path

import fecloth


def load_function(file: str, name: str):
    """Import a file as a module of its package or folder, and return its function `name`."""
    root, module = module_of(Path(file))
    if str(root) not in sys.path:
        sys.path.insert(0, str(root))
    return getattr(importlib.import_module(module), name)


def module_of(file: Path) -> tuple[Path, str]:
    """Return the folder to import a file from, and the dotted name of its module."""
    folder = file.parent
    names = [file.stem]
    while (folder / "__init__.py").exists():
        names.insert(0, folder.name)
        folder = folder.parent
    return folder, ".".join(names)


@cache
def source_hash(file: str | Path) -> str:
    """Return the hash of all sources on which the results of a study's file depend.

    Contents count, paths do not: the hash covers the sources of fecloth, the file, the files it
    imports from the folder of its package, and the scenes in `scenes/` beside it or above it.
    It is kept from the first call, so that later edits do not change it.
    """
    root, module = module_of(Path(file).resolve())
    package_names = module.split(".")[:-1]
    scenes: list[Path] = []
    for k in range(len(package_names) + 1):  # from the folder of the package down to the file's
        folder = root.joinpath(*package_names[:k])
        scenes += (folder / "scenes").rglob("*.toml")
    fecloth_files = Path(fecloth.__file__).parent.rglob("*")
    sources = sorted(path for path in fecloth_files if path.suffix in (".py", ".toml"))
    digest = hashlib.sha256()
    for source in (*sources, *sorted(_imported_files(Path(file))), *sorted(scenes)):
        digest.update(source.read_bytes())
    return digest.hexdigest()


def _imported_files(file: Path) -> set[Path]:
    """Return the file and the files that it imports, directly or not.

    Only files in the folder of its package count: other packages are not the user's sources.
    """
    root, _ = module_of(file.resolve())
    files = set()
    files_to_read = [file.resolve()]
    while files_to_read:
        source = files_to_read.pop()
        if source in files or not source.exists():  # or it is in another package
            continue
        files.add(source)
        for node in ast.walk(ast.parse(source.read_bytes())):
            for name in _imported_names(node):
                files_to_read.append(root.joinpath(*name.split(".")).with_suffix(".py"))
    return files


def _imported_names(node: ast.AST) -> list[str]:
    """Return the dotted names that a statement imports, which may be modules."""
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    if isinstance(node, ast.ImportFrom) and node.module:
        return [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
    return []
