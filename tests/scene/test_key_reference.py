"""The reference of the keys, the JSON schema, and what `fecloth info` prints of them."""

import json
import tomllib
from functools import cache
from pathlib import Path

import pytest
from support import key_reference
from support.commands import commands_of

from fecloth.cli import main as cli
from fecloth.output.frame_reader import COMPONENTS
from fecloth.scene.cloth_tables import Disk
from fecloth.scene.json_schema import json_schema
from fecloth.scene.scene import Scene
from fecloth.scene.schedule import METHOD_TABLES
from fecloth.scene.table_model import Table
from fecloth.scene.tables import SHAPE_TABLES, TERM_TABLES, FabricTable, SolverTable
from fecloth.scene.type_words import fields, meaning
from fecloth.view.checker_pattern import CHECKS


def subclasses(cls):
    """All classes that derive from this one."""
    for derived in cls.__subclasses__():
        yield derived
        yield from subclasses(derived)


SCENES = sorted((Path(__file__).parents[2] / "studies" / "scenes").rglob("*.toml"))


@pytest.mark.parametrize("file", sorted(key_reference.pages()), ids=lambda file: file.parent.name)
def test_the_pages_are_up_to_date(file):
    expected = key_reference.pages()[file]
    assert file.read_text(encoding="utf-8") == expected, "run python tests/support/key_reference.py"


def test_every_table_is_in_the_reference():
    listed = {each for classes in key_reference.SECTIONS.values() for each in classes}
    listed |= {*TERM_TABLES.values(), *METHOD_TABLES.values(), *SHAPE_TABLES.values()}
    ours = {each for each in subclasses(Table) if each.__module__.startswith("fecloth.scene")}
    ours = {
        each for each in ours if vars(each).get("makes", Table).__module__.startswith("fecloth.")
    }
    bases = {each for each in ours if any(issubclass(other, each) for other in listed - {each})}
    pieces = {each for each in ours if each.__name__.endswith("Piece")}  # a shape and its start
    unnamed = {each.__name__ for each in ours - listed - bases - pieces}
    assert unnamed <= {"Scene"} | {each.__name__ for each in listed}


def is_made_for_a_user(table):
    """Whether another test has made this table for a term of its own, or a scene with such."""
    makes = vars(table).get("makes", Table)
    another_scene = issubclass(table, Scene) and table is not Scene
    return another_scene or not makes.__module__.startswith("fecloth.")


def test_every_key_has_a_meaning():
    without = {
        f"{table.__name__}.{key}"
        for table in subclasses(Table)
        if table.__module__.startswith("fecloth.scene") and not is_made_for_a_user(table)
        for key, field in (fields(table) | table.shorthands).items()
        if table is not FabricTable.__base__ and not meaning(field)
    }
    assert not without


def test_the_meaning_of_a_key_is_the_string_below_its_field():
    """Pydantic reads the strings from the source; a class made at run time has none there."""
    assert meaning(Scene.model_fields["mass"]).endswith('Explicit methods need "lumped".')
    assert meaning(SolverTable.model_fields["linear"]) == "The linear solver."
    assert meaning(Disk.model_fields["element"]) == "Linear (P1) or quadratic (P2) triangles."
    gravity = TERM_TABLES["Gravity"].model_fields["acceleration"]
    assert meaning(gravity) == "g, three components [m/s²]."
    assert meaning(TERM_TABLES["Gravity"].model_fields["type"]) == ""


@cache
def allows():
    """Whether tables fit the schema, by a reader of another author."""
    jsonschema = pytest.importorskip("jsonschema")
    return jsonschema.Draft202012Validator(json.loads(json_schema())).is_valid


@pytest.mark.parametrize("path", SCENES, ids=[path.stem for path in SCENES])
def test_the_schema_allows_the_scenes(path):
    assert allows()(tomllib.loads(path.read_text(encoding="utf-8")))


@pytest.mark.parametrize(
    "wrong",
    [
        {"cloth": {"shape": "disk", "radius": 1.0, "h": 0.1, "widht": 1.0}},
        {"time": {"method": "bdf3", "t_end": 1.0}},
        {"terms": [{"type": "Gravitation"}]},
        {"fabric": "interlok"},
    ],
)
def test_the_schema_refuses(wrong):
    data = tomllib.loads((SCENES[0].parent / "drape.toml").read_text(encoding="utf-8"))
    assert allows()(data)
    assert not allows()(data | wrong)


# --- fecloth info ---------------------------------------------------------------------------------


def test_info_prints_only_the_schema(run_command):
    printed = run_command("info", "--schema")
    assert json.loads(printed.out) == json.loads(json_schema())
    assert printed.err == ""


@pytest.mark.parametrize("name", TERM_TABLES)
def test_info_prints_the_parameters_of_a_term(name, run_command):
    out = run_command("info", "--terms", name).out
    assert f'type = "{name}"' in out
    for key in fields(TERM_TABLES[name]):
        assert f"\n{key}: " in out


def test_the_fields_of_a_picture_are_those_of_frames():
    actions = commands_of(cli._parser())["render"]._actions
    field = next(action for action in actions if action.dest == "field")
    assert field.help.endswith(f"; or {', '.join([*COMPONENTS, CHECKS])}")
