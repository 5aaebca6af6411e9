"""Scenes and meshes that were spoilt at random: each is built, or refused in words."""

import copy
import tempfile
import tomllib
from pathlib import Path

import pytest
from support.drawn import drawn
from support.tiers import in_turn

import fecloth as fc
from fecloth.scene import toml_text
from fecloth.scene.scene import load_scene

SCENES = Path(__file__).parents[2] / "studies" / "scenes"
NAMES = ("swing", "hanging_strip", "dome")
ODD = [0, -1, True, "", "nonsense", [], [1.0, "x"], {}, {"type": "StVK"}, "../x"]
HOW = ["delete", "misspell", "scale", "replace"]


def values(st):
    return st.one_of(st.sampled_from(ODD), st.floats(), st.integers(-(10**12), 10**12))


def small_scene(name):
    """The tables of a scene, with a coarse mesh."""
    scene = tomllib.loads((SCENES / f"{name}.toml").read_text())
    scene["cloth"]["h"] = 0.25
    return scene


def scenes_and_places(st):
    """A scene's name and the path of one of its keys or items."""

    def of(name):
        paths = sorted(places(small_scene(name)), key=str)
        return st.tuples(st.just(name), st.sampled_from(paths))

    return st.sampled_from(NAMES).flatmap(of)


def places(data, path=()):
    """The path of every key and item of nested tables."""
    items = data.items() if isinstance(data, dict) else enumerate(data)
    for key, value in items:
        yield (*path, key)
        if isinstance(value, (dict, list)) and value:
            yield from places(value, (*path, key))


def spoilt(data, path, how, value):
    """A copy in which the place is deleted, misspelt, off by powers of ten or replaced."""
    data = copy.deepcopy(data)
    at = data
    for key in path[:-1]:
        at = at[key]
    old = at[path[-1]]
    if how == "delete":
        del at[path[-1]]
    elif how == "misspell" and isinstance(at, dict):
        at[f"{path[-1]}x"] = at.pop(path[-1])
    elif how == "scale" and isinstance(old, float):
        at[path[-1]] = old * 10.0 ** (len(str(value)) - 9)
    else:
        at[path[-1]] = value
    return data


def refused(make):
    """The words in which it was refused, "" if it was not."""
    try:
        make()
    except fc.InputError as error:
        return str(error)
    return ""


@pytest.mark.stories
@drawn(
    lambda st: [scenes_and_places(st), st.sampled_from(HOW), values(st)],
    max_examples=100,
    derandomize=True,
)
def test_corrupted_scene_is_built_or_refused_with_a_message(scene_and_place, how, value):
    name, path = scene_and_place
    try:
        text = toml_text.to_toml(spoilt(small_scene(name), path, how, value))
    except (TypeError, ValueError, AttributeError):
        return  # no TOML says that
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "scene.toml"
        file.write_text(text)
        refusal = refused(lambda: load_scene(file).build())
        assert refusal == "" or len(refusal) > 20
        assert list(Path(folder).iterdir()) == [file]


ODD_TEXTS = ["5 m", "0 s", "-1e999 N/m", "1e-9 us", ["1 cm", 0, "1 g"], "3 1/s", "2 t", "5 µ", "²"]


@pytest.mark.parametrize(("name", "text"), in_turn(NAMES, ODD_TEXTS))
def test_text_with_a_unit_at_any_key_is_read_or_refused_with_a_message(name, text, tmp_path):
    scene = tomllib.loads((SCENES / f"{name}.toml").read_text())
    file = tmp_path / "scene.toml"
    refusals = []
    for path in places(scene):
        file.write_text(toml_text.to_toml(spoilt(scene, path, "replace", text)), encoding="utf-8")
        refusals.append(refused(lambda: load_scene(file)))
    assert all(refusal == "" or len(refusal) > 20 for refusal in refusals)
    assert any("one of the units" in refusal for refusal in refusals)


@pytest.mark.stories  # each file is read by a process of its own
@drawn(
    lambda st: [st.integers(0, 10**6), st.integers(0, 255), st.booleans()],
    max_examples=10,
    derandomize=True,
)
def test_corrupted_mesh_file_is_read_or_refused_with_a_message(cut, byte, twice):
    source = next(iter(sorted((Path(__file__).parents[2] / "meshes").glob("*.msh"))))
    raw = bytearray(source.read_bytes())
    raw[cut % len(raw)] = byte
    if twice:
        raw = raw[: cut % len(raw)]
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "bad.msh"
        file.write_bytes(raw)
        refusal = refused(lambda: fc.Cloth.read(file))
    assert refusal == "" or "bad.msh" in refusal
