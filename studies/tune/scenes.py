"""The twelve scenes on which `fc.tune` is judged, and how their references are made.

Most are scenes of the repository, shortened or on another mesh, so that the study takes minutes.
The scene that `tune` starts from is as a user might write it: neither fine nor cheap.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from fecloth.scene.scene import Scene, scene_of

STUDIES = Path(__file__).parents[1]
NEEDS, OWN = "scenes/needs", "tune/scenes"
Changes = Mapping[str, object]


@dataclass(frozen=True)
class Tried:
    """A scene to tune.

    Attributes
    ----------
    file
        The TOML file, in `studies/`.
    changes
        Keys and their values there, as {"time.dt": 0.01}; None leaves a key or table out.
    quantities
        The quantities of interest; () for the quantities of the file.
    tolerance
        Relative error to tune to.
    fine
        Further changes for the reference, of second order.
    ratio
        The second run of the reference has h and dt divided by it.
    has_limit
        Whether finer meshes and steps converge to one result; else `tune` must refuse to prove.
    """

    name: str
    file: str
    tolerance: float
    changes: Changes = field(default_factory=dict)
    quantities: tuple[str, ...] = ()
    fine: Changes = field(default_factory=dict)
    ratio: float = 2.0
    has_limit: bool = True

    def scene(self, *more: Changes) -> Scene:
        """Return the scene, with further changes."""
        return scene_of(self.tables(*more))

    def tables(self, *more: Changes) -> dict:
        """Return the tables of the scene as they are written, without defaults."""
        path = STUDIES / self.file
        data = tomllib.loads(path.read_text(encoding="utf-8"))
        if "path" in data["cloth"]:
            data["cloth"]["path"] = str((path.parent / data["cloth"]["path"]).resolve())
        interest = {"interest": {"quantities": list(self.quantities)}} if self.quantities else {}
        own = {"title": self.name, "expect": None}
        for changes in ({**own, **self.changes, **interest}, *more):
            for key, value in changes.items():
                _change(data, key.split("."), value)
        return data


def _change(data, keys: list[str], value: object) -> None:
    """Set a value of nested tables and lists, or leave it out."""
    *parents, last = (int(key) if key.isdigit() else key for key in keys)
    for key in parents:
        data = data[key] if isinstance(key, int) else data.setdefault(key, {})
    if value is None:
        data.pop(last, None)
    else:
        data[last] = value


STATIC = {"time": None, "output": None, "solver": None, "equilibrium.load_steps": 1}
EXPLICIT = {"time.method": "central_difference", "time.dt": "auto", "mass": "lumped"}

TWELVE = (
    Tried(
        "strip",
        "scenes/hanging_strip.toml",
        0.01,
        STATIC,
        ("sag", "mean_displacement.z"),
        {"cloth.element": "P2", "cloth.h": 0.04},
    ),
    Tried(
        "dome",
        "scenes/inflated_disk.toml",
        0.003,
        {"output": None},
        ("middle.z", "reaction.rim.z"),
        {"cloth.h": 0.0125},
    ),
    Tried("awning", f"{OWN}/awning.toml", 0.003, fine={"cloth.h": 0.025}),
    Tried(
        "taut",
        f"{NEEDS}/taut.toml",
        0.01,
        fine={**EXPLICIT, "cloth.h": 0.025},
    ),
    Tried(
        "wind",
        f"{NEEDS}/wind.toml",
        0.03,
        {"time.dt": "auto", "time.rtol": 0.01},
        fine={"time.rtol": None, "time.dt": 1e-3, "cloth.h": 0.025},
    ),
    Tried(
        "cantilever",
        f"{NEEDS}/cantilever.toml",
        0.01,
        {"terms.1.type": "PlateBending", "pins": [{"where": "left", "clamp": True}]},
        fine={"cloth.h": 0.005, "time.dt": 0.01},
    ),
    Tried(
        "swing",
        "scenes/swing.toml",
        0.03,
        {"time.t_end": 0.5, "output": None},
        ("path of tip", "path of mean_displacement"),
        {"cloth.pattern": "right", "cloth.element": "P2", "cloth.h": 0.1, "time.dt": 1e-3},
    ),
    Tried(
        "trampoline",
        "scenes/trampoline.toml",
        0.003,
        {"cloth.h": 0.03, "output": None},
        ("path of mean_displacement.z",),
        {**EXPLICIT, "cloth.h": 0.0151},
    ),
    Tried(
        "flag",
        "scenes/benchmark_flag.toml",
        0.03,
        {
            "time.t_end": 0.2,
            "output": None,
            "terms": [
                {"type": "StVK"},
                {"type": "PlateBending"},  # without it, finer meshes have finer folds
                {"type": "StrainRateDamping", "time": 0.02},
                {"type": "Gravity"},
            ],
            "fabric.bending_rigidity": 5e-3,
        },
        ("fly", "path of mean_displacement.z"),
        {"cloth.element": "P2", "cloth.h": 0.05, "time.dt": 2e-3},
        2**0.5,
    ),
    Tried(
        "struck",
        f"{OWN}/struck.toml",
        0.03,
        fine={**EXPLICIT, "cloth.h": 0.0125, "cloth.element": "P1"},
    ),
    Tried(
        "pendulum",
        f"{OWN}/pendulum.toml",
        0.01,
        fine={"cloth.element": "P2", "cloth.h": 0.1, "time.dt": 5e-3},
    ),
    Tried(
        "folds",
        "scenes/benchmark_flag.toml",
        0.01,
        {"time.t_end": 0.2, "time.dt": 4e-3, "cloth.h": 0.1, "output": None},
        ("mean_displacement.z",),
        has_limit=False,
    ),
)
