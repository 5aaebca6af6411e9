"""The gap of contact is a part of the error that `converge` states, beside mesh and time step."""

import math

import numpy as np
import pytest
from scipy.optimize import brentq

import fecloth as fc
from fecloth import study
from fecloth.study.problem import StudyProblem

KAPPA, GAP, DENSITY = 200.0, 4e-3, 0.2
SCENE = f"""
[cloth]
shape = "rectangle"
width = 0.2
height = 0.1
h = 0.1

[fabric]
areal_density = {DENSITY}
tensile_stiffness = 100.0

[[terms]]
type = "StVK"

[[terms]]
type = "Gravity"

[[terms]]
type = "Obstacle"
shape = {{ type = "Plane", point = [0, 0, 0], normal = [0, 0, 1] }}
gap = {GAP}
stiffness = {KAPPA}

[[pins]]
where = "boundary"
direction = [0, 0, 1]

[[probes]]
name = "corner"
point = [0.0, 0.0]

[start]
shift = [0, 0, "3.6 mm"]

[equilibrium]
tolerance = 1e-10
"""


def height(gap):
    """Where the pressure −κ b′(d/gap), b = −(s − 1)² ln s, carries the weight per area."""

    def surplus(s):
        return -KAPPA * (-2 * (s - 1) * math.log(s) - (s - 1) ** 2 / s) - DENSITY * 9.81

    return gap * brentq(surplus, 1e-6, 1 - 1e-9, xtol=1e-15)


def lay(h, gap=GAP):
    """The same as a function."""
    cloth = fc.Cloth.rectangle(0.2, 0.1, h)
    obstacle = fc.Obstacle(fc.shapes.Plane((0, 0, 0), (0, 0, 1)), gap, stiffness=KAPPA)
    fabric = fc.Fabric(DENSITY, 100.0)
    pins = [fc.Slide("boundary", direction=(0, 0, 1))]
    system = fc.System(cloth, fabric, [fc.StVK(), fc.Gravity(), obstacle], pins)
    x = np.column_stack([cloth.X, np.full(len(cloth.X), 0.9 * gap)])
    return cloth, system, fc.BackwardEuler(), system.state(x)


def test_a_sheet_on_a_table_lies_too_high_by_the_share_of_the_gap(tmp_path):
    """The height is s gap with one s for all gaps: as much is the error against a gap of 0."""
    path = tmp_path / "table.toml"
    path.write_text(SCENE)
    result = study.converge(path, "corner.z", levels=3, cache=None)
    assert result.value == pytest.approx(height(GAP), rel=1e-6)
    assert result.shares["gap"] == pytest.approx(height(GAP), rel=1e-4)
    assert result.uncertainty >= height(GAP)
    assert any("take a smaller gap" in line for line in result.remarks)


@pytest.mark.parametrize("by", [2.0, 5.0])
def test_a_level_divides_all_gaps_of_scenes_and_functions(by, tmp_path):
    path = tmp_path / "table.toml"
    path.write_text(SCENE)
    opened = [StudyProblem.of(path), StudyProblem.of(lay, h=0.1)]
    for problem in opened:
        term = problem.finer(gap=by).first.system.terms[-1]
        assert term.gap == pytest.approx(GAP / by, rel=1e-12)
        assert problem.first.system.terms[-1].gap == GAP
