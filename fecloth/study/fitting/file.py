"""FIT.toml: the experiments and parameters of a fit in a file."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from fecloth.errors import SceneError, did_you_mean, errors_of
from fecloth.scene import toml_text
from fecloth.scene.scene import load_scene
from fecloth.study.fitting import fit as by_experiments
from fecloth.study.fitting.experiment import Experiment
from fecloth.study.fitting.result import Fit

KEYS = ("title", "parameters", "fabric", "experiments", "starts", "refined")
OF_EXPERIMENTS = ("scene", "data", "along", "quantity", "sigma", "offset", "fitted", "name")
NEEDED = ("scene", "data", "quantity")


def fit(
    path: str | Path, *, starts: int | None = None, trust_geo: bool = False, **shared: Any
) -> Fit:
    """Do the fit of a TOML file; its paths are relative to its folder.

    The keys are the arguments of `fit` and of `Experiment`, with `scene` for its problem. An
    argument `starts` replaces the one of the file.

    Raises
    ------
    SceneError
        For keys that are missing or unknown, beside the errors of `fit`.
    """
    path = Path(path)
    tables = toml_text.read(path)
    _check_keys(tables, KEYS, ("parameters", "experiments"), str(path))
    listed = tables["experiments"]
    if not (isinstance(listed, list) and all(isinstance(table, dict) for table in listed)):
        raise SceneError("experiments", "must be [[experiments]] tables", str(path))
    experiments = [_experiment(path, i, table, trust_geo) for i, table in enumerate(listed)]
    if starts is None:
        starts = tables.get("starts", 1)
    fabric = tables.get("fabric")
    if isinstance(fabric, dict) and "file" in fabric:
        fabric = fabric | {"file": str(path.parent.resolve() / fabric["file"])}
    return by_experiments.fit(
        experiments,
        toml_text.flatten(tables["parameters"]),
        fabric=fabric,
        starts=starts,
        refined=tables.get("refined", True),
        title=tables.get("title", path.stem),
        **shared,
    )


def _experiment(path: Path, number: int, table: Mapping[str, Any], trust_geo: bool) -> Experiment:
    """Return the experiment of a table; its scene and its data are beside the file."""
    where = f"{path}: experiments.{number}"
    _check_keys(table, OF_EXPERIMENTS, NEEDED, where)
    given = {key: value for key, value in table.items() if key != "scene"}
    given["data"] = path.parent / table["data"]
    scene = load_scene(path.parent / table["scene"], trust_geo=trust_geo)
    with errors_of(where, kind=SceneError):
        return Experiment(scene, **given)


def _check_keys(
    table: Mapping, known: tuple[str, ...], needed: tuple[str, ...], where: str
) -> None:
    """Raise `SceneError` for an unknown key, or for one that is missing."""
    for key in table:
        if key not in known:
            allowed = f"unknown key; must be one of {', '.join(known)}"
            raise SceneError(key, allowed, where, did_you_mean(key, known))
    for key in needed:
        if key not in table:
            raise SceneError(f"{key} is missing", f"needed are {', '.join(needed)}", where)
