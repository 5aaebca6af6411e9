"""The cases of the drape test: starts, meshes, constants, load steps, support.

How they are read was fixed with them, before the first comparison:

- value: the mean over the five starts on the finest mesh;
- start: the standard deviation over these starts (n − 1);
- space: half of the uncertainty that `estimate_uncertainty` gives for the means of the three
  meshes, with order 2;
- steps: the change of the mean over `FEW` starts from 20 to 40 load steps, on the coarsest mesh;
- each constant: half of the distance between the means over `FEW` starts, one standard deviation
  up and down, on the coarsest mesh. The place of rest depends on the stiffnesses over the weight
  alone, so the mass has the sum of these changes by a per cent;
- support: the change from the held edge to two disks with contact, on the middle mesh from the
  first start, over √3, as if every value between were as likely as another and beyond it as well;
- scatter: the measured values are single numbers; 2.4 points are the median over 25 fabrics.

Begun with five folds, as measured, is shown beside it. It is no part of the prediction.
"""

from __future__ import annotations

from collections.abc import Sequence

from studies.validation.drape.specimen import FEW, MORE_STEPS, STARTS, UNCERTAIN, H

MODELS = ("elastic", "friction")
FOLDED = -5  # the start with five folds


def list_cases(fabrics: Sequence[str], quick: bool = False) -> list[dict]:
    """The settings of `specimen.drape` for all cases; with `quick` few of them, coarse ones."""
    starts, few, h = (STARTS[:2], FEW[:1], QUICK) if quick else (STARTS, FEW, H)
    cases: list[dict] = []
    for fabric in fabrics:
        for model in MODELS[quick:]:
            case = {"fabric": fabric, "model": model}
            shown = (starts[0], h[-1])
            pairs = [(start, size) for size in h for start in starts]
            cases += [
                case | {"start": s, "h": size, "shape": (s, size) == shown} for s, size in pairs
            ]
            coarse = [case | {"start": start, "h": h[0]} for start in few]
            cases += [each | change for change in _changes(model, quick) for each in coarse]
            if not quick:
                cases.append(case | {"start": FOLDED, "h": h[1]})
                cases.append(case | {"start": starts[0], "h": h[1], "support": "disks"})
    return cases


QUICK = (0.04, 0.032, 0.025)  # edges of the triangles [m]


def _changes(model: str, quick: bool) -> list[dict]:
    """More load steps, and each constant up and down by a standard deviation."""
    keys = ["bending_rigidity"] if quick else list(UNCERTAIN)
    if model == "elastic":
        keys.remove("bending_hysteresis")
    changes: list[dict] = [{"steps": MORE_STEPS}]
    for key in keys:
        up = UNCERTAIN[key]
        changes += [{"key": key, "factor": up}, {"key": key, "factor": 1 / up}]
    return changes
