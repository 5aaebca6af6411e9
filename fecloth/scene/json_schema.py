"""The JSON schema of scene files, with which an editor completes and checks their keys.

Pydantic describes the tables as they are after reading. A file may also write a quantity as text
with a unit, a method or a fabric by its name, and a single expectation without a list; the schema
allows these, too.
"""

import json
from collections.abc import Iterator
from typing import Any

from fecloth.fabric import presets
from fecloth.scene.scene import Scene
from fecloth.scene.schedule import METHOD_TABLES
from fecloth.scene.table_model import Table
from fecloth.scene.tables import Shorthands
from fecloth.scene.type_words import dimensions


def json_schema() -> str:
    """Return the schema of scene files as JSON text."""
    schema = _without_null(Scene.model_json_schema())
    tables = schema["$defs"]
    for model in subclasses(Table):
        properties = tables.get(model.__name__, {}).get("properties", {})
        for key in properties:
            if dimensions(model.model_fields[key]):
                properties[key] = _allow_units(properties[key])
    _allow_names(schema, tables)
    return json.dumps(schema, indent=2, ensure_ascii=False)


def subclasses(cls: type) -> Iterator[type[Any]]:
    """Yield all classes that derive from this one."""
    derived: type[Any]
    for derived in cls.__subclasses__():
        yield derived
        yield from subclasses(derived)


def _allow_units(schema: Any) -> Any:
    """Return the schema of a key with text allowed in place of each number."""
    if isinstance(schema, list):
        return [_allow_units(item) for item in schema]
    if not isinstance(schema, dict):
        return schema
    if schema.get("type") == "number":
        return schema | {"type": ["number", "string"]}
    return {key: _allow_units(value) for key, value in schema.items()}


def _allow_names(schema: dict[str, Any], tables: dict[str, Any]) -> None:
    """Allow names of methods and fabrics, shorthands of [fabric], one expectation, [cloths]."""
    scene, fabric = schema["properties"], tables["FabricTable"]
    method = tables["Time"]["properties"]["method"]
    method["anyOf"] = [{"enum": list(METHOD_TABLES)}, *method.pop("oneOf")]
    published = {"enum": list(presets.names())}
    shorthands = _without_null(Shorthands.model_json_schema())["properties"]
    fabric["properties"] |= shorthands | {"preset": shorthands["preset"] | published}
    required = fabric.pop("required"), *([key] for key in shorthands)
    fabric["anyOf"] = [{"required": keys} for keys in required]
    one_fabric = {"anyOf": [{"$ref": "#/$defs/FabricTable"}, published]}
    scene["fabric"] = {"description": scene["fabric"]["description"], **one_fabric}
    scene["fabrics"]["additionalProperties"] = one_fabric
    either = {"anyOf": [{"$ref": "#/$defs/Expectation"}, scene["expect"]["additionalProperties"]]}
    scene["expect"]["additionalProperties"] = either
    scene["cloths"] = tables["Pieces"]["properties"]["pieces"]
    schema["oneOf"] = [{"required": ["cloth"]}, {"required": ["cloths"]}]
    del schema["required"]


def _without_null(schema: Any) -> Any:
    """The schema without null, which TOML does not have."""
    if isinstance(schema, list):
        return [_without_null(item) for item in schema]
    if not isinstance(schema, dict):
        return schema
    schema = {key: _without_null(value) for key, value in schema.items() if value is not None}
    choices = [choice for choice in schema.get("anyOf", ()) if choice != {"type": "null"}]
    if len(choices) == 1:
        return {key: value for key, value in schema.items() if key != "anyOf"} | choices[0]
    return schema | {"anyOf": choices} if choices else schema
