"""The cases of the drape test: starts, meshes, constants, load steps, support.

How they are read was fixed with them, before the first comparison:

- value: the mean over the five starts on the finest mesh;
- start: the standard deviation over these starts (n − 1);
- space: half of the uncertainty that `estimate_uncertainty` gives for the means of the three
  meshes, with order 2;
- steps: the change of the mean over the `TAKEN` starts from 20 to 40 load steps, on the coarsest
  mesh;
- each constant: half of the distance between the means over the `TAKEN` starts, one standard
  deviation up and down, on the coarsest mesh. The place of rest depends on the stiffnesses over the
  weight alone, so the mass has the sum of these changes by a per cent;
- support: the change from the held edge to two disks with contact, on the middle mesh from the
  first start, over √3, as if every value between were as likely as another and beyond it as well;
- scatter: the measured values are single numbers; 2.4 points are the median over 25 fabrics.

`FEW`, three starts, were to give the parts of load steps and constants. To save time `TAKEN` is the
first of them alone. This was decided after the results of the first start had been seen, and before
those of the other two were.
"""

from __future__ import annotations

from collections.abc import Sequence

from studies.validation.drape.specimen import FEW, LOAD_STEPS, MORE_STEPS, STARTS, UNCERTAIN, H

MODELS = ("elastic", "friction")
TAKEN = FEW[:1]  # the starts that show the parts of the constants and of the load steps
QUICK_STEPS = 5  # of the elastic cloth in the quick form
COARSE = (0.05, 0.04, 0.032)  # edges of the triangles of the quick form [m]


def list_cases(fabrics: Sequence[str], quick: bool = False) -> list[dict]:
    """The settings of `specimen.drape` for all cases; with `quick` few and coarse ones."""
    if quick:
        return _few_cases(fabrics[0])
    cases: list[dict] = []
    for fabric in fabrics:
        for model in MODELS:
            case = {"fabric": fabric, "model": model}
            cases += [case | {"start": start, "h": h} for h in H for start in STARTS]
            coarse = [case | {"start": start, "h": H[0]} for start in TAKEN]
            changes = list_changes(list(UNCERTAIN), model)
            cases += [each | change for change in changes for each in coarse]
            cases.append(case | {"start": STARTS[0], "h": H[1], "support": "disks"})
    return cases


def _few_cases(fabric: str) -> list[dict]:
    """Elastic, two starts, one of them on three meshes, and a constant; with friction one start."""
    case = {"fabric": fabric, "model": "elastic", "start": STARTS[0], "steps": QUICK_STEPS}
    cases = [case | {"h": h} for h in COARSE] + [case | {"h": COARSE[-1], "start": STARTS[1]}]
    changes = list_changes(["bending_rigidity"], "elastic")[1:]  # without more load steps
    cases += [case | {"h": COARSE[0]} | change for change in changes]
    return [*cases, case | {"model": "friction", "h": COARSE[0], "steps": LOAD_STEPS}]


def list_changes(keys: Sequence[str], model: str) -> list[dict]:
    """More load steps, and each constant up and down by a standard deviation."""
    changes: list[dict] = [{"steps": MORE_STEPS}]
    for key in keys:
        if model == "friction" or key != "bending_hysteresis":
            up = UNCERTAIN[key]
            changes += [{"key": key, "factor": up}, {"key": key, "factor": 1 / up}]
    return changes
