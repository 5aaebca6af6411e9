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

KEYS = ("title", "parameters", "fabric", "experiments", "starts", "refined", "specimens", "loss")
OF_EXPERIMENTS = ("scene", "data", "along", "quantity", "sigma", "offset", "fitted", "name")
NEEDED = ("scene", "data", "quantity")


def fit(
    path: str | Path, *, starts: int | None = None, trust_geo: bool = False, **shared: Any
) -> Fit:
    """Return the fit of a TOML file; paths in the file are relative to its folder.

    Its keys are the arguments of `fecloth.fit` and, in the tables [[experiments]], of
    `Experiment`, with `scene` for its problem.

    Parameters
    ----------
    path
        The TOML file.
    starts
        Number of starts, in place of the number in the file.
    trust_geo
        As for `fecloth.load_scene`.
    shared
        Arguments of `fecloth.study.of`, as for `fecloth.fit`.

    Raises
    ------
    SceneError
        For keys that are missing or unknown, beside the errors of `fit`.
    """
    path = Path(path)
    tables = toml_text.read(path)
    _check_keys(tables, KEYS, ("parameters", "experiments"), str(path))
    entries = tables["experiments"]
    if not (isinstance(entries, list) and all(isinstance(entry, dict) for entry in entries)):
        raise SceneError("experiments", "must be [[experiments]] tables", str(path))
    experiments = [_experiment(path, i, entry, trust_geo) for i, entry in enumerate(entries)]
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
        specimens=tables.get("specimens"),
        loss=tables.get("loss", "linear"),
        title=tables.get("title", path.stem),
        **shared,
    )


def _experiment(path: Path, number: int, table: Mapping[str, Any], trust_geo: bool) -> Experiment:
    """Return the experiment of a table; its scene and its data are beside the file."""
    where = f"{path}: experiments.{number}"
    _check_keys(table, OF_EXPERIMENTS, NEEDED, where)
    arguments = {key: value for key, value in table.items() if key != "scene"}
    arguments["data"] = path.parent / table["data"]
    scene = load_scene(path.parent / table["scene"], trust_geo=trust_geo)
    with errors_of(where, kind=SceneError):
        return Experiment(scene, **arguments)


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
