"""The settings that a chart runs: method, element, model, mesh and step of one problem."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

from fecloth.errors import InputError
from fecloth.integrators import EXPLICIT, METHODS, studied_by
from fecloth.integrators.protocol import method_of
from fecloth.scene.scene import Scene
from fecloth.scene.toml_text import to_toml
from fecloth.study.levels import Level
from fecloth.study.problems import FunctionProblem, Problem, SceneProblem
from fecloth.study.scene_text import scene_of
from fecloth.study.workload import Workload
from fecloth.suggest import closest, did_you_mean
from fecloth.terms import TRAITS
from fecloth.terms.traits import traits_of

ALL_METHODS: dict[str, Any] = {**METHODS, **EXPLICIT, "auto": None}
USUAL = (*studied_by("chart"), "auto")  # methods of a chart, besides the scene's own
ELEMENTS = ("P1", "P2")
MODELS = tuple(name for name, traits in TRAITS.items() if traits.kind == "membrane")
STEPS = (1.0, 2.0, 4.0)  # dt over that of a case
TOLERANCES = (1.0, 0.1, 0.01)  # times rtol
RTOL = 0.1  # 1/s, the largest, where the scene has none
P2_COST = 4.0  # nodes of P2 over those of P1 on the same triangles


@dataclass(frozen=True, eq=False)
class Setting:
    """One setting of a problem."""

    # Its cells in the table: method, element, model, and rtol [1/s] where it has one.
    names: dict[str, str | float]
    # What runs; None and the reason in `refusal` where the problem refuses the combination.
    problem: Problem | None
    level: Level
    refusal: str = ""

    @property
    def words(self) -> str:
        """The setting in words, for the progress lines."""
        first = ", ".join(str(value) for value in self.names.values() if value)
        return f"{first}, {self.level}" if str(self.level) != "the first level" else first

    def sizes(self) -> dict[str, float]:
        """Return h [m] and dt [s], as far as they are known before the run."""
        if self.problem is None:
            return {}
        h, first = self.problem.h, self.problem.first
        dt = None if first.is_static else first.steps.dt
        found = {"h": h and h / self.level.h, "dt": dt and dt / self.level.dt}
        return {name: value for name, value in found.items() if value}

    def size(self) -> Workload:
        """Predict the size of its run."""
        assert self.problem is not None
        size = self.problem.workload(self.level)
        factor = P2_COST if self.names["element"] == "P2" else 1.0
        return replace(size, triangles=factor * size.triangles)


def make_settings(
    opened: Problem,
    methods: Sequence[str] | None,
    elements: Sequence[str] | None,
    models: Sequence[str] | None,
    meshes: int,
) -> list[Setting]:
    """Return the settings of all combinations, each on its meshes and with its steps."""
    if isinstance(opened, SceneProblem):
        combinations = _of_scene(opened.scene, methods, elements, models)
    else:
        combinations = _of_function(opened, methods, elements, models)
    settings = [one for names in combinations for one in _settings(opened, names, meshes)]
    if not any(one.problem for one in settings):
        raise InputError(opened.name, f"refuses every setting: {settings[0].refusal}", "chart")
    return settings


def _of_scene(scene: Scene, methods, elements, models) -> list[dict]:
    """Return the combinations of a scene, each with a tolerance where its steps follow one."""
    own = [table.type for table in scene.terms if traits_of(table.make()).kind == "membrane"]
    model = own[0] if own else ""
    known = tuple(dict.fromkeys([*own, *MODELS]))
    element = scene.cloth.element
    if models and not model:
        raise InputError("the terms", f"have none of {', '.join(MODELS)} to replace", "chart")
    chosen = {
        "element": known_names("element", elements or (element, *ELEMENTS), ELEMENTS),
        "model": known_names("model", models or (model,), known) if model else [""],
    }
    if scene.equilibrium:
        if methods:
            raise InputError(f"methods = {methods!r}", "an equilibrium has no method", "chart")
        rules: list[dict] = [{"method": "equilibrium"}]
    else:
        own = scene.time.method.type
        names = known_names("method", methods or (own, *USUAL), ALL_METHODS)
        rules = [rule for name in names for rule in _rules(scene, name)]
    return [
        {**rule, "element": e, "model": m}
        for rule, e, m in product(rules, chosen["element"], chosen["model"])
    ]


def _rules(scene: Scene, method: str) -> list[dict]:
    """Return the method, with its tolerances if they choose the steps."""
    time = scene.time
    if method in EXPLICIT or (method != "auto" and time.dt != "auto"):
        return [{"method": method}]
    largest = time.rtol or RTOL
    return [{"method": method, "rtol": float(f"{largest * factor:.6g}")} for factor in TOLERANCES]


def _of_function(opened: FunctionProblem, methods, elements, models) -> list[dict]:
    """Return the combinations of a function's arguments `method`, `element` and `model`."""
    given = {"method": methods, "element": elements, "model": models}
    if methods and opened.t_end is None:
        raise InputError(f"methods = {methods!r}", "an equilibrium has no method", "chart")
    known = {name: list(values) if values else [""] for name, values in given.items()}
    return [dict(zip(known, one, strict=True)) for one in product(*known.values())]


def known_names(what: str, names: Sequence[str], known: Iterable[str]) -> list[str]:
    """Return the names as the scene writes them, each once; capitals do not count."""
    found = []
    for name in names:
        close = closest(name, known)
        if not close or _plain(close) != _plain(name):
            allowed = f"must be one of {', '.join(known)}"
            raise InputError(f"{what} {name!r}", allowed, remedy=did_you_mean(name, known))
        found.append(close)
    return list(dict.fromkeys(found))


def _plain(name: str) -> str:
    return name.lower().replace("_", "")


def _settings(opened: Problem, names: dict, meshes: int) -> list[Setting]:
    """Return a setting for each mesh and step; one with the reason if the problem refuses it."""
    try:
        variant = change(opened, names)
        first = variant.first
    except InputError as error:
        return [Setting(_shown(names), None, Level(), str(error).splitlines()[0])]
    shown = _shown(names) | {"element": first.cloth.element}
    if first.is_static:
        shown["method"] = "equilibrium"
    elif not shown["method"]:
        shown["method"] = type(method_of(first.steps)).__name__
    parts = [2.0**k for k in range(meshes)] if variant.can_refine("h") else [1.0]
    steps = STEPS if variant.can_refine("dt") and not first.is_static else (1.0,)
    return [Setting(shown, variant, Level(h, dt, None)) for h, dt in product(parts, steps)]


def _shown(names: dict) -> dict:
    """Return the cells of the table: methods by the names of their classes."""
    cls = ALL_METHODS.get(names["method"])
    method = "Auto" if names["method"] == "auto" else cls.__name__ if cls else names["method"]
    rest = {key: names[key] for key in ("element", "model", "rtol") if key in names}
    return {"method": method} | rest


def change(opened: Problem, names: dict) -> Problem:
    """Return the problem with another method, element, model, tolerance or dt."""
    if isinstance(opened, FunctionProblem):
        given = {key: value for key, value in names.items() if value}
        return replace(opened, settings={**opened.settings, **given})
    scene = opened.scene
    return SceneProblem(
        scene_of(to_toml(change_tables(scene, names)), scene.trusts_geo), opened.name
    )


def change_tables(scene: Scene, names: dict) -> dict[str, Any]:
    """Return the tables of a scene with another method, element, model, tolerance or dt."""
    data = tomllib.loads(scene.to_toml())
    if names["element"] != scene.cloth.element:
        data["cloth"]["element"] = names["element"]
        data.pop("mass", None)  # each element has its usual one
    for i, table in enumerate(scene.terms):
        is_membrane = traits_of(table.make()).kind == "membrane"
        if names["model"] and is_membrane and table.type != names["model"]:
            data["terms"][i] = {"type": names["model"]}
    if names["method"] != "equilibrium":
        _change_time(data, names)
    return data


def _change_time(data: dict, names: dict) -> None:
    """Set method and steps; explicit methods take their stable step and a lumped mass."""
    time = data["time"]
    own = time.get("method", "auto")
    if names["method"] != (own if isinstance(own, str) else own["type"]):
        time["method"] = names["method"]
    if names["method"] in EXPLICIT:
        data["mass"] = "lumped"
    if names["method"] in EXPLICIT or "rtol" in names:
        time["dt"] = "auto"
    if time.get("dt", "auto") == "auto" or "dt" in names:
        for key in ("rtol", "atol", "longest"):
            time.pop(key, None)
    time |= {key: names[key] for key in ("rtol", "dt") if key in names}
