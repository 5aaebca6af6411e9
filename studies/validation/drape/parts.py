"""The parts of a predicted drape coefficient, from the rows of all cases; `cases` has the rules."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fecloth.study.status import OK
from fecloth.study.uncertainty import estimate_uncertainty
from studies.validation.comparison import Comparison
from studies.validation.drape.specimen import DENSITY, LOAD_STEPS, MORE_STEPS, SCATTER, UNCERTAIN

ORDER = 2.0  # of the coefficient in h, expected
FOLDER = "drape"
AS_IS = {"key": "", "factor": 1.0, "steps": LOAD_STEPS, "support": "held"}  # where a case has none
ENDS = ("elastic", "laid", "shaken")


@dataclass(frozen=True)
class Prediction:
    """A predicted drape coefficient [points], its standard uncertainties, and folds by start."""

    fabric: str
    model: str  # "elastic", "laid" or "shaken"
    value: float
    space: float
    steps: float
    start: float
    constants: Mapping[str, float]  # signed: the change by a standard deviation up
    support: float
    means: Sequence[float]  # on the meshes, coarse to fine
    folds: Sequence[int]  # by start, on the finest mesh
    coefficients: Sequence[float] = ()  # by start, on the finest mesh

    @property
    def mass(self) -> float:
        """What the uncertainty of the mass changes."""
        # At rest the stiffnesses over the weight count, and nothing else. That of bending has the
        # rigidity along the bias in it.
        stiffnesses = {k: c for k, c in self.constants.items() if k != "bias_rigidity"}
        return DENSITY * abs(sum(c / math.log(UNCERTAIN[k]) for k, c in stiffnesses.items()))

    @property
    def input(self) -> float:
        """All constants, the mass and the support."""
        return math.hypot(*self.constants.values(), self.mass, self.support)

    def coefficient(self, measured: float) -> Comparison:
        """Beside the measured coefficient [%]."""
        return Comparison(
            FOLDER, self.fabric, f"drape coefficient, {self.model}", "%", self.value,
            time=self.steps, space=self.space, input=self.input, start=self.start,
            measured=measured, scatter=SCATTER,
        )  # fmt: skip

    def number_of_folds(self, measured: float) -> Comparison:
        """Beside the measured number of folds; without a verdict, as its scatter is not known."""
        spread = float(np.std(self.folds, ddof=1))
        return Comparison(
            FOLDER, self.fabric, f"folds, {self.model}", "", float(np.mean(self.folds)),
            start=spread, measured=measured, kind="shown",
        )  # fmt: skip


def predict(rows: Sequence[Mapping], fabric: str, end: str, steps: int = LOAD_STEPS) -> Prediction:
    """The prediction for a fabric that is "elastic", "laid" or "shaken"; NaN where a run failed."""
    # The quick form has fewer load steps, and no part of them.
    model = "elastic" if end == "elastic" else "friction"
    own = Own([r for r in rows if r["fabric"] == fabric and r["model"] == model], end, steps)
    sizes = sorted({row["h"] for row in own.rows}, reverse=True)
    h, few = sizes[0], sorted({r["start"] for r in own.rows if r.get("steps") == MORE_STEPS})
    means = [own.mean(h=size) for size in sizes]
    estimate = estimate_uncertainty(sizes, means, ORDER)
    values = own.values("coefficient", h=sizes[-1])
    ups = {row["key"]: row["factor"] for row in own.rows if row.get("factor", 0.0) > 1}
    changes = {
        key: (own.mean(h=h, key=key, factor=f) - own.mean(h=h, key=key, factor=1 / f)) / 2
        for key, f in ups.items()
    }
    more = own.mean(h=h, steps=MORE_STEPS) - own.mean(h=h, starts=few) if few else 0.0
    held, disks = (own.values("coefficient", h=sizes[1], support=s) for s in ("held", "disks"))
    return Prediction(
        fabric, end, means[-1],
        space=0.5 * estimate.uncertainty,
        steps=abs(more),
        start=float(np.std(values, ddof=1)),
        constants=changes,
        support=abs(disks[0] - held[0]) / math.sqrt(3) if disks else 0.0,
        means=means,
        folds=[int(n) for n in own.values("folds", h=sizes[-1])],
        coefficients=values,
    )  # fmt: skip


@dataclass(frozen=True)
class Own:
    """The rows of a fabric and a model, of which one end of friction counts."""

    rows: Sequence[Mapping]
    end: str
    steps: int = LOAD_STEPS

    def values(self, name: str, starts: Sequence[int] = (), **settings) -> list[float]:
        """A column of the cases with these settings, others as they are, by start."""
        wanted = AS_IS | {"steps": self.steps} | settings
        chosen = [
            row
            for row in sorted(self.rows, key=lambda row: row["start"])
            if all(row.get(k, AS_IS.get(k)) == v for k, v in wanted.items())
            and (not starts or row["start"] in starts)
        ]
        column = name if self.end == "elastic" else f"{self.end}_{name}"
        return [row[column] if row["status"] == OK else math.nan for row in chosen]

    def mean(self, **settings) -> float:
        """The mean coefficient of the cases with these settings."""
        return float(np.mean(self.values("coefficient", **settings)))
