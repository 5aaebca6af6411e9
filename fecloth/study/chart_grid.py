"""The settings that a chart runs: method, element, model, mesh and step of one problem."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import product
from typing import Any

from fecloth.errors import InputError, closest, did_you_mean
from fecloth.integrators import EXPLICIT, METHODS, studied_by
from fecloth.integrators.protocol import method_of
from fecloth.scene.scene import Scene
from fecloth.study.change import FIRST_LEVEL, Change, Level
from fecloth.study.problems import FunctionProblem, Problem, SceneProblem
from fecloth.study.run_problems import Point
from fecloth.study.status import REFUSED, failure
from fecloth.terms import TRAITS
from fecloth.terms.traits import traits_of

ALL_METHODS: dict[str, Any] = {**METHODS, **EXPLICIT, "auto": None}
USUAL = (*studied_by("chart"), "auto")  # methods of a chart, besides the scene's own
ELEMENTS = ("P1", "P2")
MODELS = tuple(name for name, traits in TRAITS.items() if traits.kind == "membrane")
STEPS_OF_SETTING = 3  # dt, dt/2, dt/4, or rtol, rtol/10, rtol/100: what each setting runs with
LARGEST_RTOL = 0.1  # tolerance of chosen steps where the scene has none [1/s]
P2_NODES = 4.0  # nodes of P2 over nodes of P1 on the same triangles: each edge has one more


Setting = Point | dict  # what runs, with the cells of its row; a row where it is refused


def make_settings(
    opened: Problem,
    methods: Sequence[str] | None,
    elements: Sequence[str] | None,
    models: Sequence[str] | None,
    meshes: int,
) -> list[Setting]:
    """Return the settings of all combinations of the names, on each mesh and with each step.

    A combination that the problem refuses is a row with the reason. Raises `InputError` for
    methods of an equilibrium, for an unknown name, and if every combination is refused.

    Parameters
    ----------
    opened
        The problem.
    methods, elements, models
        Names to combine; None for the usual ones.
    meshes
        Number of meshes: h, h/2, …
    """
    opened.refuse_methods(methods, "chart")
    if isinstance(opened, SceneProblem):
        combinations = _combine_for_scene(opened.scene, methods, elements, models)
    else:
        combinations = _combine_for_function(methods, elements, models)
    settings = []
    for names in combinations:
        settings += _make_settings(opened, names, meshes)
    refusals = [setting["cause"] for setting in settings if isinstance(setting, dict)]
    if len(refusals) == len(settings):
        raise InputError(opened.source, f"refuses every setting: {refusals[0]}", "chart")
    return settings


def _combine_for_scene(scene: Scene, methods, elements, models) -> list[dict]:
    """Return all combinations of method, element and model of a scene, as a dict of names each.

    Where the error of a method chooses its steps, the combination has a tolerance "rtol", too.
    Names that are None are chosen: the scene's own and the usual ones, but only its own model.
    Raises `InputError` for an unknown name, and for models of a scene that has no membrane.
    """
    own_models = [t.type for t in scene.terms if traits_of(t.make()).kind == "membrane"]
    if models and not own_models:
        raise InputError("the terms", f"have none of {', '.join(MODELS)} to replace", "chart")
    asked_elements = elements or (scene.cloth.element, *ELEMENTS)
    tried_elements = known_names("element", asked_elements, ELEMENTS)
    all_models = tuple(dict.fromkeys([*own_models, *MODELS]))  # each name once
    # by default only the model of the first membrane of the scene
    tried_models = known_names("model", models or own_models[:1], all_models)
    rules: list[dict] = [{"method": "equilibrium"}]
    if not scene.equilibrium:
        usual = scene.time.method.type, *USUAL
        names = known_names("method", methods or usual, ALL_METHODS)
        rules = [rule for name in names for rule in _list_rules(scene, name)]
    combinations = []
    # without a membrane there is one "model", the empty name, so that the product is not empty
    for rule, element, model in product(rules, tried_elements, tried_models or [""]):
        combinations.append({**rule, "element": element, "model": model})
    return combinations


def _list_rules(scene: Scene, method: str) -> list[dict]:
    """Return the rules by which a method steps, as dicts of "method" and perhaps "rtol".

    A method whose error chooses its steps has a rule for each of three tolerances, each a tenth
    of the one before. Any other method has one rule without a tolerance.
    """
    time = scene.time
    if method in EXPLICIT or (method != "auto" and time.dt != "auto"):
        return [{"method": method}]
    rules = []
    for k in range(STEPS_OF_SETTING):
        rtol = (time.rtol or LARGEST_RTOL) * 10.0**-k
        rules.append({"method": method, "rtol": float(f"{rtol:.6g}")})
    return rules


def _combine_for_function(methods, elements, models) -> list[dict]:
    """Return the combinations of a function's arguments `method`, `element` and `model`."""
    combinations = []
    for method, element, model in product(methods or [""], elements or [""], models or [""]):
        combinations.append({"method": method, "element": element, "model": model})
    return combinations


def known_names(
    what: str, names: Sequence[str], known: Iterable[str], allowed: str = "", where: str = ""
) -> list[str]:
    """Return the names as the scene writes them, each once.

    Capitals and underscores do not count, so that "BDF2" is "bdf2". Raises `InputError` for an
    unknown name.

    Parameters
    ----------
    what
        What the names are of, for the error: "method", "element" or "model".
    names
        Names as the user wrote them.
    known
        Names as the scene writes them.
    allowed, where
        What the error says is allowed, and where the name stands.
    """
    names_of_scene: dict[str, None] = {}  # a dict keeps the order, and each name once
    for name in names:
        nearest = closest(name, known)
        if not nearest or _plain(nearest) != _plain(name):
            allowed = allowed or f"must be one of {', '.join(known)}"
            raise InputError(f"{what} {name!r}", allowed, where, did_you_mean(name, known))
        names_of_scene[nearest] = None
    return list(names_of_scene)


def _plain(name: str) -> str:
    """Return a name without capitals and underscores."""
    return str(name).lower().replace("_", "")


def _make_settings(opened: Problem, names: dict, meshes: int) -> list[Setting]:
    """Return a setting for each mesh and step of one combination of `names`.

    If the problem refuses the combination, return one row with the reason.
    """
    method = names["method"]
    if method == "auto":
        method = "Auto"
    elif method in ALL_METHODS:
        method = ALL_METHODS[method].__name__
    setting_cells = {"method": method}
    for name in ("element", "model", "rtol"):
        if name in names:
            setting_cells[name] = names[name]
    try:
        variant = opened.changed(change_names(opened, names))
        first = variant.first
    except InputError as error:
        return [setting_cells | failure(REFUSED, error)]
    setting_cells["element"] = first.cloth.element
    if first.is_static:
        setting_cells["method"] = "equilibrium"
    elif not setting_cells["method"]:  # a function that has no argument for its method
        setting_cells["method"] = type(method_of(first.steps)).__name__
    divisors_of_h = [1.0]
    if variant.can_refine("h"):
        divisors_of_h = [2.0**k for k in range(meshes)]
    divisors_of_dt = [1.0]
    if variant.can_refine("dt") and not first.is_static:
        divisors_of_dt = [2.0**k for k in range(STEPS_OF_SETTING)]
    divisors = product(divisors_of_h, divisors_of_dt)
    # sharper=None leaves the tolerance of the solver as it is
    levels = [Level(h=h, dt=dt, sharper=None) for h, dt in divisors]
    return [_make_point(setting_cells, variant, level) for level in levels]


def _make_point(setting_cells: dict, variant: Problem, level: Level) -> Point:
    """Return the problem on a level, to run, with its words, predicted size and cells.

    `setting_cells` name the setting; h and dt of the level are added to them.
    """
    words = [str(value) for value in setting_cells.values() if value]
    if str(level) != str(FIRST_LEVEL):
        words.append(str(level))
    size = variant.workload(level)
    if setting_cells["element"] == "P2":  # the prediction is for P1
        size = replace(size, triangles=P2_NODES * size.triangles)
    cells = dict(setting_cells)
    if variant.h:
        cells["h"] = variant.h / level.h
    if not variant.is_static and variant.first.steps.dt:
        cells["dt"] = variant.first.steps.dt / level.dt
    return Point(variant, level, ", ".join(words), size, cells=cells)


def change_names(opened: Problem, names: dict) -> Change:
    """Return the change of a problem to another method, element, model, tolerance or dt.

    `names` has "method", "element" and "model", "" for the problem's own, and perhaps "rtol" or
    "dt". In a scene each membrane becomes a term of the model, with the model's defaults.
    """
    if isinstance(opened, FunctionProblem):  # its names are arguments of the function
        return Change(values={key: value for key, value in names.items() if value})
    scene = opened.scene

    def edit(tables: dict) -> dict:
        """Return the tables of the scene with these names; what is the same already stays."""
        if names["element"] != scene.cloth.element:
            tables["cloth"]["element"] = names["element"]
            tables.pop("mass", None)  # each element has its usual mass, lumped or consistent
        for i, table in enumerate(scene.terms):
            is_membrane = traits_of(table.make()).kind == "membrane"
            if names["model"] and is_membrane and table.type != names["model"]:
                tables["terms"][i] = {"type": names["model"]}
        if names["method"] != "equilibrium":
            _change_time(tables, names)
        return tables

    return Change(edits=(edit,))


def _change_time(tables: dict, names: dict) -> None:
    """Set the method and the steps in `tables` of a scene, which are changed in place.

    Explicit methods take their stable step and a lumped mass.
    """
    time = tables["time"]
    own_method = time.get("method", "auto")
    if not isinstance(own_method, str):
        own_method = own_method["type"]
    if names["method"] != own_method:
        time["method"] = names["method"]
    is_explicit = names["method"] in EXPLICIT
    if is_explicit:
        tables["mass"] = "lumped"  # so that a step solves no equations
    if is_explicit or "rtol" in names:
        time["dt"] = "auto"
    if time.get("dt", "auto") == "auto" or "dt" in names:
        # steps by their error take the defaults, not the scene's own keys
        for key in ("rtol", "atol", "longest"):
            time.pop(key, None)
    for key in ("rtol", "dt"):
        if key in names:
            time[key] = names[key]
