"""The reference of the public names, from `fecloth/__init__.pyi` and the modules that it names.

Each name has a page of its own in `api/names`, which is written before the build. Each page of
`api/` lists the names that are defined in some packages. A public name that no page lists ends
the build.
"""

import inspect
import re
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any, get_type_hints

from generated import Generated
from sphinx.application import Sphinx
from sphinx.errors import ExtensionError

import fecloth

PAGES = Path(__file__).parents[1] / "api"


class Reference(Generated):
    """The names that are defined in the packages of the argument, such as `mesh fabric`."""

    required_arguments, optional_arguments = 1, 0

    def text(self) -> str:
        listed = [n for n, value in names().items() if package_of(n, value) in self.packages]
        rows = [f":doc:`{short(name)} <names/{short(name)}>`\n   {told(name)}" for name in listed]
        pages = [f"   names/{short(name)}" for name in listed]
        return "\n".join([*rows, "", ".. toctree::", "   :hidden:", "", *pages])

    @property
    def packages(self) -> list[str]:
        return self.arguments[0].split()


def short(name: str) -> str:
    """Return the name without the package in front."""
    return name.removeprefix("fecloth.")


def told(name: str) -> str:
    """Return the first sentence of the docstring of a public name."""
    words = " ".join(inspect.getdoc(names()[name]).split("\n\n")[0].split())
    return as_shown(re.split(r"(?<=\.)\s", words)[0])


def as_shown(line: str) -> str:
    """A line of a docstring with the bars of |x|, which would be a substitution."""
    return line if "``" in line else line.replace("|", "\\|")


def write_pages(app: Sphinx) -> None:
    """Write the page of each public name; a page that does not change is left as it is."""
    folder = PAGES / "names"
    folder.mkdir(exist_ok=True)
    texts = {}
    for name, value in names().items():
        title = short(name)
        texts[f"{title}.rst"] = f"{title}\n{'=' * len(title)}\n\n{entry(name, value)}"
    for file in folder.iterdir():
        if file.name not in texts:
            file.unlink()
    for file_name, text in texts.items():
        file = folder / file_name
        if not file.exists() or file.read_text(encoding="utf-8") != text:
            file.write_text(text, encoding="utf-8")


@cache
def names() -> dict[str, object]:
    """Return each public name as a reader writes it, without modules, and its value."""
    found = {}
    for name in fecloth.__all__:
        value = getattr(fecloth, name)
        if isinstance(value, ModuleType):
            found |= {f"fecloth.{name}.{key}": each for key, each in members(value).items()}
        else:
            found[f"fecloth.{name}"] = value
    return found


def members(module: ModuleType) -> dict[str, object]:
    """Return the names of a module that its `__all__` has, or else that it defines."""
    listed = getattr(module, "__all__", None) or [
        name
        for name, value in vars(module).items()
        if not name.startswith("_") and getattr(value, "__module__", "") == module.__name__
    ]
    values = {name: getattr(module, name) for name in listed}
    # a name that `fecloth` has, too, stands there
    return {key: each for key, each in values.items() if getattr(fecloth, key, None) is not each}


def package_of(name: str, value: object) -> str:
    """Return the package that defines it; of a constant the module that has the name."""
    module = getattr(value, "__module__", "") or ""
    return (module if module.startswith("fecloth.") else name).split(".")[1]


def entry(name: str, value: object) -> str:
    if inspect.isclass(value):
        return f".. autoclass:: {name}\n   :members:\n"
    if callable(value):
        return f".. autofunction:: {name}\n"
    return f".. py:data:: {name}\n   :value: {value!r}\n"


def require_all(app: Sphinx) -> None:
    """Raise an error if a public name stands on no page."""
    told = " ".join(file.read_text(encoding="utf-8") for file in PAGES.glob("*.rst"))
    packages = {word for line in re.findall(r"reference:: (.*)", told) for word in line.split()}
    missing = [n for n, value in names().items() if package_of(n, value) not in packages]
    if missing:
        raise ExtensionError(f"no page of docs/api has the package of {', '.join(missing)}")


def as_written(app: Sphinx, what: str, name: str, value: object, options: object, lines: list):
    """Show formulas as they are written: indented lines as a block, and the bars of |x|."""
    shown: list[str] = []
    end = next((i for i, line in enumerate(lines) if set(line) == {"-"}), len(lines))
    above, in_block = "", False  # the last line that is not empty and stands outside of a block
    for i, line in enumerate(lines):
        indented = line.startswith("    ") and i < end
        if indented and not in_block and not shown[-1] and not above.startswith(("-", "*")):
            shown += [] if above.endswith("::") else ["::", ""]
            in_block = True
        elif line and not indented:
            in_block, above = False, line
        shown.append(line if in_block else as_shown(line))
    lines[:] = shown


def plain_hints(app: Sphinx, function: Callable[..., Any], is_bound: bool) -> None:
    """Leave out of type hints what only checks of arguments read, as the range of a number."""
    with suppress(Exception):  # a name that is there for type checkers only
        function.__annotations__ = get_type_hints(function)


def setup(app: Sphinx) -> dict[str, bool]:
    app.add_directive("reference", Reference)
    app.connect("builder-inited", require_all)
    app.connect("builder-inited", write_pages)
    app.connect("autodoc-before-process-signature", plain_hints)
    app.connect("autodoc-process-docstring", as_written, priority=400)  # before numpydoc
    return {"parallel_read_safe": True}
