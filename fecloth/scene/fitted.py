"""What the file of a fabric says of terms: fitted curves, and how uncertain their numbers are."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from fecloth.errors import InputError
from fecloth.quantities import toml_file
from fecloth.scene.toml_text import flatten_tables


def with_fitted_terms(data: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Return the tables of a scene with what the `file` of its [fabric] says of its terms.

    A [[terms]] of the file gives the term of this type the keys that the scene leaves out.
    [uncertain] of the file names numbers as "terms.TYPE.KEY"; they get the numbers that terms
    have in the scene, in [uncertain], whose own entries go before these. What the scene itself
    gives a term or a constant of the fabric loses the uncertainty of the file. A scene without
    such a file, and what is no table, is returned as it is: they are refused later.
    """
    fabric, terms = data.get("fabric"), data.get("terms")
    name = fabric.get("file") if isinstance(fabric, Mapping) else None
    if not (isinstance(name, str) and isinstance(terms, list | tuple)):
        return data
    try:
        file = toml_file.read(folder / name)
    except InputError:
        return data
    given = {term["type"]: term for term in file.get("terms", ())}
    new_terms = []
    prefixes = dict[str, str]()  # of keys in [uncertain], by those in the file
    for number, term in enumerate(terms):
        own = term if isinstance(term, Mapping) else {}
        fitted = given.get(own.get("type"), {})
        new_terms.append({**fitted, **own} if fitted else term)
        for key in fitted.keys() - own.keys():
            prefixes[f"terms.{own['type']}.{key}"] = f"terms.{number}.{key}"
    own_uncertain = data.get("uncertain", {})
    replaced = {f"fabric.{key}" for key in fabric} if isinstance(fabric, Mapping) else set()
    replaced |= dict(flatten_tables(own_uncertain)).keys()
    uncertain = _renamed(file.get("uncertain", {}), prefixes, replaced)
    return data | {"terms": new_terms, "uncertain": uncertain | own_uncertain}


def _renamed(
    uncertain: Mapping[str, Any], prefixes: Mapping[str, str], replaced: set[str]
) -> dict[str, Any]:
    """Return entries and correlations of terms by the names in the scene.

    Those of terms without a prefix are left out, and correlations of what is `replaced`.
    """

    def new_name(name: str) -> str:
        if name == "slack" or name.startswith("fabric."):
            return name
        of_key = [prefix for prefix in prefixes if f"{name}.".startswith(f"{prefix}.")]
        return prefixes[of_key[0]] + name.removeprefix(of_key[0]) if of_key else ""

    def is_kept(name: str) -> bool:
        parts = new_name(name).split(".")
        ends = range(1, len(parts) + 1)
        return not {".".join(parts[:end]) for end in ends} & {"", *replaced}

    entries = {new_name(name): u for name, u in uncertain.items() if new_name(name)}
    entries = {name: u for name, u in entries.items() if name != "correlation"}
    rows = uncertain.get("correlation", ())
    rows = [[*map(new_name, row[:2]), row[2]] for row in rows if all(map(is_kept, row[:2]))]
    return entries | ({"correlation": rows} if rows else {})
