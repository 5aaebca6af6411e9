"""Measures specimens whose constants are known: runs on another mesh, and noise on the values."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

import fecloth as fc
from fecloth.simulation.probes import Observer

FINER = 6  # divides the step of the fit: the step of the data

Values = Mapping[str, float]


@dataclass(frozen=True, eq=False)
class Test:
    """A specimen, what is measured of it, and the meshes of the data and of the fit."""

    name: str
    specimen: Callable
    constants: tuple[str, ...]  # the arguments that a fit may seek
    columns: Mapping[str, str]  # quantity of the fit → column of a run
    probes: Sequence[fc.Probe]
    data_mesh: Mapping[str, Any]  # arguments of the specimen, h among them
    fit_mesh: Mapping[str, Any]
    at: Sequence[float] = ()  # parts of the loads, or times [s]; of an equilibrium: readings
    t_end: float | None = 1.0  # None of an equilibrium
    dt: float | None = None  # of the fit; the data have a quarter of it
    settings: Mapping[str, Any] = field(default_factory=dict)  # other arguments of the specimen

    def experiment(
        self, truth: Values, sought: Sequence[str], noise: float, rng: np.random.Generator
    ) -> fc.Experiment:
        """The experiment with data that are made with the true constants and `noise`.

        The standard uncertainty is `noise` times the largest change of a column. Constants that are
        not sought have their true values in the fit.
        """
        data: dict[str, np.ndarray] = {}
        sigma = {}
        if self.t_end is not None:
            data["t" if self.dt is None else "t [s]"] = np.asarray(self.at, dtype=float)
        for quantity, (values, largest) in self._values(truth).items():
            sigma[quantity] = max(noise, 1e-4) * largest
            unit = "N" if quantity.startswith("reaction") else "m"
            data[f"{quantity} [{unit}]"] = values + noise * largest * rng.normal(size=len(values))
        h = {key: value for key, value in self.fit_mesh.items() if key == "h"}
        others = {key: value for key, value in self.fit_mesh.items() if key != "h"}
        others |= {key: truth[key] for key in self.constants if key not in sought}
        return fc.Experiment(
            partial(self.specimen, **others, **self.settings),
            data,
            {quantity: quantity for quantity in self.columns},
            along=None if self.t_end is None else "t",
            sigma=sigma,
            name=self.name,
            dt=self.dt,
            t_end=self.t_end,
            probes=tuple(self.probes),
            **h,
        )

    def _values(self, truth: Values) -> dict[str, tuple[np.ndarray, float]]:
        """The exact values of each column, and its largest change."""
        own = {name: truth[name] for name in self.constants}
        steps = {} if self.dt is None else {"dt": self.dt / FINER}
        made = self.specimen(**own, **steps, **self.data_mesh, **self.settings)
        _, system, method, start = made
        with warnings.catch_warnings(action="ignore"):
            if self.t_end is None:
                return self._at_rest(system, start)
            run = fc.run(
                system, method, start, *steps.values(), t_end=self.t_end, probes=self.probes
            )
        columns = {}
        for quantity, column in self.columns.items():
            values = CubicSpline(run.times, run.observed[column])(self.at)
            columns[quantity] = values, float(np.ptp(run.observed[column]))
        return columns

    def _at_rest(self, system: fc.System, start: fc.State) -> dict[str, tuple[np.ndarray, float]]:
        """The values of an equilibrium, for each reading, and their changes from the flat cloth."""
        state = fc.equilibrium(system, start)
        row = Observer.bind(system, start, self.probes, shape=True).row_at_rest(state)
        flat = {}
        for probe in self.probes:
            place = (probe.weights(system.cloth) @ system.cloth.X)[0]
            flat |= {f"{probe.name}.{axis}": x for axis, x in zip("xy", place, strict=True)}
        return {
            quantity: (np.full(len(self.at), row[column]), abs(row[column] - flat.get(column, 0.0)))
            for quantity, column in self.columns.items()
        }
