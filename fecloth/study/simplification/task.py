"""A scene to simplify: its full run, the runs of its variants, and their changes."""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from fecloth import study
from fecloth.errors import FeclothError
from fecloth.scene.scene import load_scene
from fecloth.scene.toml_text import to_toml
from fecloth.study.simplification.cases import (
    COUNTED,
    Answer,
    answer,
    changes,
    data_of,
    interest_of,
    scene_of,
)
from fecloth.study.simplification.variants import PATIENCE


@dataclass(frozen=True, eq=False)
class Task:
    """A scene to simplify, with the result of the full scene and the options of its runs."""

    name: str
    data: dict
    tolerance: float
    options: argparse.Namespace
    repeats: int = 3
    known: bool = False

    @classmethod
    def of(cls, path: Path, options: argparse.Namespace) -> Task:
        data = data_of(load_scene(path))
        out = options.out if options.scene else options.out / path.stem
        own = argparse.Namespace(**vars(options) | {"out": out})
        repeats, known = 1 if options.quick else 3, not options.scene
        return cls(path.stem, data, options.tolerance, own, repeats, known)

    @property
    def run_options(self) -> dict:
        return study.run_options(self.options) | {"time_limit": self.options.time_limit}

    @cached_property
    def text(self) -> str:
        return to_toml(self.data)

    @cached_property
    def scene(self):
        return scene_of(self.text)

    @cached_property
    def interest(self):
        return interest_of(self.scene)

    @cached_property
    def full(self) -> Answer:
        (row,) = self.run([self.case("full", self.data)])
        study.require_results(self.options, f"Simplification of {self.name}", [row])
        return Answer.of(row)

    def case(self, name: str, data: dict, static: bool = False) -> dict:
        settings = {"scene": self.name, "variant": name, "text": to_toml(data)}
        return settings | {"static": static, "repeats": self.repeats}

    def run(self, cases: list[dict]) -> list[dict]:
        def label(case: dict) -> str:
            return f"{case['scene']}, {case['variant']}"

        return study.run_cases(cases, answer, **self.run_options, label=label)

    def limited_case(
        self, name: str, data: dict, static: bool = False, patience: float = PATIENCE
    ) -> dict:
        """Return the case of a variant, limited to `patience` times the full scene's seconds."""
        most = math.ceil(1 + patience * self.full.row["cpu_seconds"])
        return self.case(name, data, static) | {"most": most}

    def compare(self, row: dict) -> dict:
        """Return a row's change and saving against the full scene, or the cause of a failure."""
        line = {key: row.get(key) for key in ("scene", "variant", "status")}
        if row["status"] == "ok":
            try:
                each = changes(self.full, Answer.of(row), self.interest)
            except FeclothError as error:
                return line | {"status": "failed", "cause": str(error)}
            line |= {"change": max(each.values()), "of": max(each, key=each.get)}
            line["saved"] = 1 - row["cpu_seconds"] / self.full.row["cpu_seconds"]
            counts = ("cpu_seconds", "triangles", "steps", *COUNTED)
            line |= {name: row.get(name) for name in counts}
        return line | {"cause": row["cause"]}
