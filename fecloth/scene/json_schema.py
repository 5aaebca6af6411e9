"""The JSON schema of scene files, with which an editor completes and checks their keys.

Pydantic describes the tables as they are after reading. A file may also write a quantity as text
with a unit, a method or a fabric by its name, and a single expectation without a list; the schema
allows these too.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

from fecloth.fabric import presets
from fecloth.scene.fabric_table import FabricTable
from fecloth.scene.scene import Scene
from fecloth.scene.table_model import Table
from fecloth.scene.type_words import dimensions, phrase

FORMULAS = ("motion", "position", "velocity")  # keys with formulas, which may also be numbers


def json_schema() -> str:
    """Return the schema of scene files as JSON text."""
    schema = _without_null(Scene.model_json_schema())
    tables = schema["$defs"]
    for model in subclasses(Table):
        if model.__name__ in tables:
            _describe(tables[model.__name__], model)
    _allow_names(schema, tables)
    return json.dumps(schema, indent=2, ensure_ascii=False)


def subclasses(cls: type) -> Iterator[type[Any]]:
    """Yield all classes that derive from this one."""
    one: type[Any]
    for one in cls.__subclasses__():
        yield one
        yield from subclasses(one)


def _describe(table: dict[str, Any], model: type[Table]) -> None:
    """Say what each key takes, and allow text with a unit and numbers as formulas."""
    for key, field in model.model_fields.items():
        one: Any = table["properties"][key]
        one["description"] = phrase(field)
        if dimensions(field):
            one = _also(one, "number", "string")
        if key in FORMULAS:
            one = _also(one, "string", "number")
        table["properties"][key] = one


def _also(schema: Any, found: str, other: str) -> Any:
    """Return the schema with `other` allowed wherever it has the type `found`."""
    if isinstance(schema, list):
        return [_also(one, found, other) for one in schema]
    if not isinstance(schema, dict):
        return schema
    if schema.get("type") == found and "const" not in schema and "enum" not in schema:
        outer = {key: schema[key] for key in ("title", "default", "description") if key in schema}
        inner = {key: value for key, value in schema.items() if key not in outer}
        return outer | {"anyOf": [inner, {"type": other}]}
    return {key: _also(value, found, other) for key, value in schema.items()}


def _allow_names(schema: dict[str, Any], tables: dict[str, Any]) -> None:
    """Allow names of methods and fabrics, shorthands of [fabric], one expectation, [cloths]."""
    method = tables["Time"]["properties"]["method"]
    names = [tables[_name(one)]["properties"]["type"]["const"] for one in method["oneOf"]]
    method["anyOf"] = [{"enum": names}, *method.pop("oneOf")]
    fabric, published = tables["FabricTable"], {"enum": list(presets.names())}
    fabric["properties"] |= {"preset": published, "kes": {"type": "object"}}
    fabric["properties"]["fast"] = {"type": "object"}
    needed = {"required": fabric.pop("required")}
    fabric["anyOf"] = [needed, *({"required": [key]} for key in FabricTable.shorthands)]
    one_fabric = {"anyOf": [{"$ref": "#/$defs/FabricTable"}, published]}
    schema["properties"]["fabric"] = one_fabric
    schema["properties"]["fabrics"]["additionalProperties"] = one_fabric
    several = schema["properties"]["expect"]["additionalProperties"]
    either = {"anyOf": [{"$ref": "#/$defs/Expectation"}, several]}
    schema["properties"]["expect"]["additionalProperties"] = either
    schema["properties"]["cloths"] = tables["Pieces"]["properties"]["pieces"]
    schema["oneOf"] = [{"required": ["cloth"]}, {"required": ["cloths"]}]
    del schema["required"]


def _name(reference: dict[str, str]) -> str:
    return reference["$ref"].rsplit("/", 1)[1]


def _without_null(schema: Any) -> Any:
    """The schema without null, which TOML does not have."""
    if isinstance(schema, list):
        return [_without_null(one) for one in schema]
    if not isinstance(schema, dict):
        return schema
    schema = {key: _without_null(value) for key, value in schema.items() if value is not None}
    choices = [one for one in schema.get("anyOf", ()) if one != {"type": "null"}]
    if len(choices) == 1:
        return {key: value for key, value in schema.items() if key != "anyOf"} | choices[0]
    return schema | {"anyOf": choices} if choices else schema
