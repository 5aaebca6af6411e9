"""Runs of a scene and of simpler scenes, and their changes of the quantities of interest."""

from __future__ import annotations

import time
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar

from fecloth.errors import FeclothError, InputError
from fecloth.mesh.cloth import Cloth
from fecloth.scene.probe_tables import Interest
from fecloth.scene.scene import Scene
from fecloth.scene.toml_text import to_toml
from fecloth.simulation.quantity import Quantity
from fecloth.simulation.quantity_values import RunRecord, relative_difference, size_of
from fecloth.study.cases import run_cases
from fecloth.study.command import StudyFailed
from fecloth.study.measured_runs import columns_to_record, measure, record_of
from fecloth.study.run_problems import Runs
from fecloth.study.scene_text import WORDS, digest_of_files, scene_of
from fecloth.study.setups import Setup, setup_of_scene
from fecloth.study.simplification.outcome import Outcome
from fecloth.study.simplification.variants import PATIENCE, Variant, list_variants
from fecloth.study.status import FAILED, OK, TimeLimit, check_time_limit
from fecloth.terms.traits import traits_of

ENOUGH = 1.5  # CPU seconds of timing, after which the run is not repeated
SHORT = 0.5  # CPU seconds that every run may take


def run_variant(
    variant: str,
    text: str,
    digest: str,
    recorded: list,
    modes: int,
    repeats: int,
    most: float | None = None,
    trust_geo: bool = False,
) -> dict:
    """Run a scene and return the row of its fastest run.

    Parameters
    ----------
    variant
        Its name.
    text, digest
        TOML of the scene, and a hash of the files that it reads.
    recorded, modes
        As for `measure`.
    repeats
        Largest number of runs.
    most
        Largest CPU time of a run [s], without compiling.
    trust_geo
        As for `load_scene`.
    """
    return measure_fastest(setup_of_scene(text, trust_geo), recorded, modes, repeats, most)


def measure_fastest(
    setup: Setup, recorded: list, modes: int, repeats: int, most: float | None
) -> dict:
    """Run a setup up to `repeats` times and return the row of its fastest run."""
    rows = list[dict]()
    try:
        rows.append(measure(setup, recorded, modes, report=_limit(most)))
    except TimeLimit:  # what was compiled in that run is ready in the next
        rows.append(measure(setup, recorded, modes, report=_limit(most)))
    while len(rows) < repeats and sum(row["cpu_seconds"] for row in rows) < ENOUGH:
        rows.append(measure(setup, recorded, modes, report=_limit(most)))
    return min(rows, key=lambda row: row["cpu_seconds"])


def _limit(most: float | None) -> Callable[..., None]:
    """Return a report of steps that stops the run after `most` CPU seconds from now."""
    begin = time.process_time()

    def check(*_: object) -> None:
        check_time_limit()
        if most and time.process_time() - begin > most:
            raise TimeLimit(f"more than {most:g} CPU seconds")

    return check


def data_of(scene: Scene) -> dict:
    """Return the tables of a scene with all defaults and absolute paths."""
    return tomllib.loads(scene.to_toml())


@dataclass(frozen=True, eq=False)
class Original:
    """The scene to simplify, the quantities that count, and how it is run.

    `FunctionOriginal` is the same for a user's function.
    """

    problem: Any
    quantities: tuple[Quantity, ...]
    tolerance: float
    runs: Runs
    repeats: int = 3

    runner: ClassVar[Callable[..., dict]] = staticmethod(run_variant)
    reduced_file: ClassVar[str] = "reduced.toml"

    @property
    def name(self) -> str:
        return self.problem.name

    def list_variants(self) -> list[Variant]:
        """List all variants, terms first."""
        texts = tuple(one.text for one in self.quantities)
        known = {type(t).__name__: traits_of(t) for t in self.problem.first.system.terms}
        return list_variants(self.data, Interest(quantities=texts), known)

    def text(self, data: dict) -> str:
        """Return what the reduced file holds."""
        return to_toml(data)

    def reread(self, data: dict) -> dict:
        """Return the tables of a scene as they are read from its text."""
        return data_of(self._read(to_toml(data)))

    def mesh(self, row: Mapping) -> Cloth:
        """Return the cloth of a run."""
        return self._read(row["text"]).mesh()

    def _read(self, text: str) -> Scene:
        return scene_of(text, self.problem.scene.trusts_geo)

    @cached_property
    def data(self) -> dict:
        """The tables of the scene."""
        return data_of(self.problem.scene)

    @cached_property
    def full(self) -> dict:
        """The row of the scene.

        Raises
        ------
        StudyFailed
            If the scene itself fails.
        InputError
            If all quantities are zero: then nothing changes them.
        """
        (row,) = self._rows([self._case("the scene", self.data, None)], self.runs.fresh)
        if row["status"] != OK:
            raise StudyFailed(f"{self.name}: the scene itself fails: {row['cause']}")
        pairs = zip(self.quantities, self._records(row), strict=True)
        if not any(size_of(one, record) for one, record in pairs):
            names = ", ".join(one.text for one in self.quantities)
            remedy = "Name another with --quantity or in [interest]."
            raise InputError(f"{names} = 0", "cannot show what changes it", self.name, remedy)
        return row

    @cached_property
    def _full_records(self) -> list[RunRecord]:
        return self._records(self.full)

    def run(self, tried: Sequence[tuple[str, dict, float]], fresh: bool = False) -> list[Outcome]:
        """Run scenes, given by name, tables and largest CPU time over that of the scene."""
        seconds = self.full["cpu_seconds"]
        cases = [
            self._case(name, data, round(SHORT + patience * seconds, 1))
            for name, data, patience in tried
        ]
        rows = self._rows(cases, fresh or self.runs.fresh)
        return [self.compare(row) for row in rows]

    def run_one(self, name: str, data: dict, fresh: bool = False) -> Outcome:
        """Run one scene."""
        return self.run([(name, data, PATIENCE)], fresh)[0]

    def compare(self, row: Mapping) -> Outcome:
        """Return changes and saving of a row against the scene, or the cause of a failure."""
        named = Outcome(row["variant"], row["status"], str(row["cause"]))
        if row["status"] != OK:
            return named
        try:
            pairs = zip(self.quantities, self._full_records, self._records(row), strict=True)
            changes = {one.text: relative_difference(one, a, b) for one, a, b in pairs}
        except FeclothError as error:  # as where a signal has no period
            return replace(named, status=FAILED, cause=str(error))
        seconds = row["cpu_seconds"]
        saved = 1 - seconds / self.full["cpu_seconds"]
        sizes = row["triangles"], row["steps"]
        return Outcome(named.name, OK, "", changes, seconds, saved, *sizes)

    def _case(self, name: str, data: dict, most: float | None) -> dict[str, Any]:
        return {
            "variant": name,
            "recorded": sorted({c for one in self.quantities for c in columns_to_record(one)}),
            "modes": max((one.mode for one in self.quantities), default=0),
            "repeats": self.repeats,
            "most": most,
            **self.case_of(data),
        }

    def case_of(self, data: dict) -> dict[str, Any]:
        """Return what `runner` needs of the tables."""
        scene = self.problem.scene
        text = to_toml({key: value for key, value in data.items() if key not in WORDS})
        return {"text": text, "digest": digest_of_files(scene), "trust_geo": scene.trusts_geo}

    def _rows(self, cases: list[dict], fresh: bool) -> list[dict]:
        runs, function = self.runs, self.runner
        where = runs.cache, runs.jobs, runs.scheduler, runs.time_limit, fresh
        return run_cases(cases, function, *where, label=lambda case: case["variant"])

    def _records(self, row: Mapping) -> list[RunRecord]:
        needs = any(one.is_field for one in self.quantities)
        cloth = self.mesh(row) if needs else None
        return [record_of(row, one, cloth, self.problem.probes) for one in self.quantities]
