"""The settings that a chart runs: method, element, model, mesh and step of one problem."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import product
from typing import Any

from fecloth.errors import InputError, closest, did_you_mean
from fecloth.integrators import EXPLICIT, METHODS, studied_by
from fecloth.integrators.protocol import method_of
from fecloth.scene.scene import Scene
from fecloth.study.change import FIRST, Change, Level
from fecloth.study.problems import FunctionProblem, Problem, SceneProblem
from fecloth.study.run_problems import Point
from fecloth.study.status import REFUSED, failure
from fecloth.terms import TRAITS
from fecloth.terms.traits import traits_of

ALL_METHODS: dict[str, Any] = {**METHODS, **EXPLICIT, "auto": None}
USUAL = (*studied_by("chart"), "auto")  # methods of a chart, besides the scene's own
ELEMENTS = ("P1", "P2")
MODELS = tuple(name for name, traits in TRAITS.items() if traits.kind == "membrane")
STEPS = (1.0, 2.0, 4.0)  # dt over dt of a case
TOLERANCES = (1.0, 0.1, 0.01)  # times rtol
RTOL = 0.1  # 1/s, the largest, where the scene has none
P2_COST = 4.0  # nodes of P2 over nodes of P1 on the same triangles


Setting = Point | dict  # what runs, with the cells of its row; a row where it is refused


def make_settings(
    opened: Problem,
    methods: Sequence[str] | None,
    elements: Sequence[str] | None,
    models: Sequence[str] | None,
    meshes: int,
) -> list[Setting]:
    """Return the settings of all combinations, each on its meshes and with its steps."""
    asked = methods, elements, models
    opened.refuse_methods(methods, "chart")
    if isinstance(opened, SceneProblem):
        combinations = _of_scene(opened.scene, *asked)
    else:
        combinations = _of_function(opened, *asked)
    settings = [made for names in combinations for made in _settings(opened, names, meshes)]
    refusals = [setting["cause"] for setting in settings if isinstance(setting, dict)]
    if len(refusals) == len(settings):
        raise InputError(opened.source, f"refuses every setting: {refusals[0]}", "chart")
    return settings


def _of_scene(scene: Scene, methods, elements, models) -> list[dict]:
    """Return the combinations of a scene, each with a tolerance where its steps follow one."""
    own = [table.type for table in scene.terms if traits_of(table.make()).kind == "membrane"]
    if models and not own:
        raise InputError("the terms", f"have none of {', '.join(MODELS)} to replace", "chart")
    tried = known_names("element", elements or (scene.cloth.element, *ELEMENTS), ELEMENTS)
    listed = known_names("model", models or own[:1], tuple(dict.fromkeys([*own, *MODELS])))
    rules: list[dict] = [{"method": "equilibrium"}]
    if not scene.equilibrium:
        usual = scene.time.method.type, *USUAL
        names = known_names("method", methods or usual, ALL_METHODS)
        rules = [rule for name in names for rule in _rules(scene, name)]
    combinations = product(rules, tried, listed or [""])
    return [{**rule, "element": e, "model": m} for rule, e, m in combinations]


def _rules(scene: Scene, method: str) -> list[dict]:
    time = scene.time
    if method in EXPLICIT or (method != "auto" and time.dt != "auto"):
        return [{"method": method}]
    largest = time.rtol or RTOL
    return [{"method": method, "rtol": float(f"{largest * factor:.6g}")} for factor in TOLERANCES]


def _of_function(opened: FunctionProblem, methods, elements, models) -> list[dict]:
    """Return the combinations of a function's arguments `method`, `element` and `model`."""
    chosen = {"method": methods, "element": elements, "model": models}
    listed = product(*(list(values) if values else [""] for values in chosen.values()))
    return [dict(zip(chosen, names, strict=True)) for names in listed]


def known_names(
    what: str, names: Sequence[str], known: Iterable[str], allowed: str = "", where: str = ""
) -> list[str]:
    """Return the names as the scene writes them, each once; capitals do not count."""
    written: dict[str, None] = {}
    for name in names:
        close = closest(name, known)
        if not close or _plain(close) != _plain(name):
            allowed = allowed or f"must be one of {', '.join(known)}"
            raise InputError(f"{what} {name!r}", allowed, where, did_you_mean(name, known))
        written[close] = None
    return list(written)


def _plain(name: str) -> str:
    return str(name).lower().replace("_", "")


def _settings(opened: Problem, names: dict, meshes: int) -> list[Setting]:
    """Return a setting for each mesh and step; one with the reason if the problem refuses it."""
    cls = ALL_METHODS.get(names["method"])
    if names["method"] == "auto":
        method = "Auto"
    else:
        method = cls.__name__ if cls else names["method"]
    shown = {"method": method} | {n: names[n] for n in ("element", "model", "rtol") if n in names}
    try:
        variant = opened.changed(change_names(opened, names))
        first = variant.first
    except InputError as error:
        return [shown | failure(REFUSED, error)]
    shown["element"] = first.cloth.element
    if first.is_static:
        shown["method"] = "equilibrium"
    elif not shown["method"]:
        shown["method"] = type(method_of(first.steps)).__name__
    if variant.can_refine("h"):
        parts = [2.0**k for k in range(meshes)]
    else:
        parts = [1.0]
    steps = STEPS if variant.can_refine("dt") and not first.is_static else (1.0,)
    levels = [Level(h, dt, None) for h, dt in product(parts, steps)]
    return [_point(shown, variant, level) for level in levels]


def _point(shown: dict, variant: Problem, level: Level) -> Point:
    """Return what runs, with the setting in words and its predicted size."""
    words = [str(value) for value in shown.values() if value]
    words += [str(level)] if str(level) != str(FIRST) else []
    size = variant.workload(level)
    factor = P2_COST if shown["element"] == "P2" else 1.0
    size = replace(size, triangles=factor * size.triangles)
    dt = None if variant.is_static else variant.first.steps.dt
    sizes = {"h": variant.h and variant.h / level.h, "dt": dt and dt / level.dt}  # if known so far
    cells = shown | {name: value for name, value in sizes.items() if value}
    return Point(variant, level, ", ".join(words), size, cells=cells)


def change_names(opened: Problem, names: dict) -> Change:
    """Return the change to another method, element, model, tolerance or dt."""
    if isinstance(opened, FunctionProblem):
        return Change(values={key: value for key, value in names.items() if value})
    scene = opened.scene

    def edit(tables: dict) -> dict:
        if names["element"] != scene.cloth.element:
            tables["cloth"]["element"] = names["element"]
            tables.pop("mass", None)  # each element has its usual one
        for i, table in enumerate(scene.terms):
            is_membrane = traits_of(table.make()).kind == "membrane"
            if names["model"] and is_membrane and table.type != names["model"]:
                tables["terms"][i] = {"type": names["model"]}
        if names["method"] != "equilibrium":
            _change_time(tables, names)
        return tables

    return Change(edits=(edit,))


def _change_time(tables: dict, names: dict) -> None:
    """Set method and steps; explicit methods take their stable step and a lumped mass."""
    time = tables["time"]
    own = time.get("method", "auto")
    if names["method"] != (own if isinstance(own, str) else own["type"]):
        time["method"] = names["method"]
    is_explicit = names["method"] in EXPLICIT
    tables |= {"mass": "lumped"} if is_explicit else {}
    time |= {"dt": "auto"} if is_explicit or "rtol" in names else {}
    if time.get("dt", "auto") == "auto" or "dt" in names:
        for key in ("rtol", "atol", "longest"):
            time.pop(key, None)
    time |= {key: names[key] for key in ("rtol", "dt") if key in names}
