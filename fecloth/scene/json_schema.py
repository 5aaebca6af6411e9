"""The JSON schema of scene files, with which an editor completes and checks their keys.

Pydantic describes the tables as they are after reading. A file may also write a quantity as
text with a unit, a method or a fabric by its name, and a single expectation without a list;
the schema allows these, too.
"""

import json
from typing import Any

from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core import core_schema, to_jsonable_python

from fecloth.fabric import presets
from fecloth.scene.scene import Scene
from fecloth.scene.schedule import METHOD_TABLES
from fecloth.scene.tables import Shorthands


class SchemaOfFiles(GenerateJsonSchema):
    """Describes tables without null, which TOML does not have."""

    def nullable_schema(self, schema: core_schema.NullableSchema) -> JsonSchemaValue:
        return self.generate_inner(schema["schema"])

    def default_schema(self, schema: core_schema.WithDefaultSchema) -> JsonSchemaValue:
        described = super().default_schema(schema)
        return {key: value for key, value in described.items() if value is not None}

    def encode_default(self, default: Any) -> Any:
        return to_jsonable_python(default, exclude_none=True)


def json_schema() -> str:
    """Return the schema of scene files as JSON text."""
    schema = Scene.model_json_schema(schema_generator=SchemaOfFiles)
    _allow_names(schema, schema["$defs"])
    return json.dumps(schema, indent=2, ensure_ascii=False)


def _allow_names(schema: dict[str, Any], tables: dict[str, Any]) -> None:
    """Change the `schema` so that it also allows what a file may write in a shorter way.

    These are the names of methods and of fabrics, the shorthands of [fabric], one expectation
    without a list, and [cloths.NAME]. `tables` has the schema of each table by its name.
    """
    scene = schema["properties"]
    fabric = tables["FabricTable"]
    # The name of a method replaces its table.
    method = tables["Time"]["properties"]["method"]
    method["anyOf"] = [{"enum": list(METHOD_TABLES)}, *method.pop("oneOf")]
    published_names = {"enum": list(presets.names())}
    shorthands = Shorthands.model_json_schema(schema_generator=SchemaOfFiles)["properties"]
    fabric["properties"] |= shorthands | {"preset": shorthands["preset"] | published_names}
    # A table of a fabric needs all its required constants, or one shorthand in place of them.
    sets_of_required_keys = [fabric.pop("required")]
    sets_of_required_keys += [[key] for key in shorthands]
    fabric["anyOf"] = [{"required": keys} for keys in sets_of_required_keys]
    # The name of a published fabric replaces a whole table.
    fabric_or_name = {"anyOf": [{"$ref": "#/$defs/FabricTable"}, published_names]}
    scene["fabric"] = {"description": scene["fabric"]["description"], **fabric_or_name}
    scene["fabrics"]["additionalProperties"] = fabric_or_name
    one_expectation = {"$ref": "#/$defs/Expectation"}
    list_of_expectations = scene["expect"]["additionalProperties"]
    scene["expect"]["additionalProperties"] = {"anyOf": [one_expectation, list_of_expectations]}
    scene["cloths"] = tables["Pieces"]["properties"]["pieces"]
    # [cloth] is the only required table of a scene; now [cloths.NAME] may replace it.
    schema["oneOf"] = [{"required": ["cloth"]}, {"required": ["cloths"]}]
    del schema["required"]
