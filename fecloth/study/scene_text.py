"""Scenes as TOML texts, which identify a case wherever it runs."""

from __future__ import annotations

import hashlib
import tempfile
import tomllib
from pathlib import Path

from fecloth.errors import SceneError
from fecloth.scene.scene import Scene, load_scene
from fecloth.scene.toml_text import to_toml

WORDS = ("title", "expect", "interest", "output")  # tables that change no result


def scene_of(text: str, trust_geo: bool = False) -> Scene:
    """Read the scene of a TOML text whose paths are absolute; errors name no file."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scene.toml"
        path.write_text(text, encoding="utf-8")
        try:
            scene = load_scene(path, trust_geo=trust_geo)
        except SceneError as error:
            raise SceneError(error.what, error.allowed, "", error.remedy) from None
    scene._source = "the scene"
    return scene


def text_of(
    scene: Scene,
    h: float | None = None,
    dt: float | None = None,
    sharper: float | None = None,
    rtol: float | None = None,
) -> str:
    """Return what a run of the scene depends on, with another h [m], dt [s] or tolerance.

    With `sharper` the tolerance of the nonlinear solver is one on the residual, divided by it: what
    "auto" leaves may be more than levels differ by. `rtol` [1/s] is that of chosen steps.
    """
    data = {key: value for key, value in tomllib.loads(scene.to_toml()).items() if key not in WORDS}
    if h is not None:
        data["cloth"]["h"] = h
    if dt is not None:
        data["time"]["dt"] = dt
    if rtol is not None:
        data["time"]["rtol"] = rtol
    if sharper is not None and scene.equilibrium:
        data["equilibrium"]["tolerance"] = data["equilibrium"]["tolerance"] / sharper
    elif sharper is not None:
        data["solver"]["tolerance"] = scene.solver.make().residual / sharper
    return to_toml(data)


def digest_of_files(scene: Scene) -> str:
    """Return a hash of the files that the scene reads: an edited mesh makes another case."""
    digest = hashlib.sha256()
    of_terms = (dict(term).get("path") for term in scene.terms)
    of_pieces = getattr(scene.cloth, "paths", ())
    for path in (getattr(scene.cloth, "path", None), scene.start.frame, *of_terms, *of_pieces):
        digest.update(Path(path).read_bytes() if path else b"-")
    return digest.hexdigest()[:12]
