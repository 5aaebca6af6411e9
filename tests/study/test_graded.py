"""Meshes graded by the error in space: recovered order, places that are found, refusals."""

import numpy as np
import pytest
from support.singular_corners import (
    CORNER,
    FABRIC,
    SMALL,
    corner_function,
    corner_gradient,
    hanging_l,
    taut_l,
)
from support.strips import scene_file

import fecloth as fc
from fecloth.simulation.setup import Setup
from fecloth.study.graded_meshes import choose_gradings

pytestmark = pytest.mark.stories

TIP = [fc.Probe("tip", "right")]


def solved(problem, *arguments):
    cloth, system, _, start = problem(*arguments)
    return cloth, Setup(system, start), fc.equilibrium(system, start)


def chosen(problem, h):
    _, setup, end = solved(problem, h)
    return choose_gradings(setup, end, h)


def test_order_at_a_reentrant_corner_is_recovered():
    """Exact: z = r^(2/3) sin(2θ/3). Uniform P1 meshes have order 2/3 in H1, graded ones 1."""
    gradings = chosen(taut_l, 0.1)
    assert [each.point for each in gradings] == [tuple(CORNER)]
    errors = {}
    for name, grading in (("uniform", ()), ("graded", gradings)):
        for h in (0.1, 0.05):
            cloth, _, end = solved(taut_l, h, "P1", grading)
            z = end.x[:, 2] / SMALL
            both = cloth.h1_error(z, corner_gradient), cloth.l2_error(z, corner_function)
            errors[name, h] = np.array(both)
    order = {k: np.log2(errors[k, 0.1] / errors[k, 0.05]) for k in ("uniform", "graded")}
    assert order["uniform"] == pytest.approx([2 / 3, 4 / 3], abs=0.1)
    assert order["graded"] == pytest.approx([1, 2], abs=0.1)


@pytest.mark.stories
def test_converge_says_what_the_grading_of_a_hanging_cloth_saves(tmp_path):
    result = fc.study.converge(hanging_l, "tip.y", h=0.1, levels=3, probes=TIP, grade=True)
    assert result.order == pytest.approx(2, abs=0.25)
    assert result.converges
    assert result.table["mesh"] == ["uniform"] * 3 + ["graded"] * 3
    rows = list(result.table)
    uniform, graded = rows[:3], rows[3:]
    assert graded[1]["error"] < uniform[2]["error"]  # of a third of its triangles
    assert graded[1]["triangles"] < 0.4 * uniform[2]["triangles"]
    assert "The grading saves a factor of" in result.verdict
    assert [each.point for each in result.gradings] == [tuple(CORNER)]
    finest = hanging_l(0.1 / 4, "P1", result.gradings)[0]
    assert len(finest.triangles) == graded[2]["triangles"]
    assert "uniform meshes" in (result.report(tmp_path).parent / "figure.svg").read_text()


def held(pins, element="P1"):
    cloth = fc.Cloth.rectangle(1.0, 1.0, 0.1, element=element)
    system = fc.System(cloth, FABRIC, [fc.StVK(), fc.Gravity()], pins)
    return Setup(system, system.rest()), fc.equilibrium(system, system.rest())


def test_places_are_the_ends_of_pins_and_not_single_points():
    setup, end = held(["left", fc.Pin(lambda X: (X[:, 0] > 0.99) & (X[:, 1] > 0.99))])
    points = [each.point for each in choose_gradings(setup, end, 0.1)]
    assert set(points) <= {(0.0, 0.0), (0.0, 1.0), (1.0, 0.0), None}
    assert points, "the ends of the left side"
    setup, end = held([fc.Pin(lambda X: (X[:, 0] < 0.01) & (X[:, 1] > 0.45)), "right"])
    points = [each.point for each in choose_gradings(setup, end, 0.1)]
    middle = [point for point in points if point and point[0] == 0 and 0.4 < point[1] < 0.6]
    assert middle, "the pin ends in the middle of the left side"


def test_an_even_error_is_not_graded():
    """A strip under its own weight without Poisson's ratio has stress linear in X only."""

    def strip(h, grading=()):
        cloth = fc.Cloth.rectangle(1.0, 0.5, h, grading=grading)
        terms = [fc.StVK(), fc.Gravity((9.81, 0, 0))]
        system = fc.System(cloth, fc.Fabric(0.2, 20.0), terms, pins=["left"])
        return cloth, system, None, system.rest()

    result = fc.study.converge(strip, "tip.x", h=0.25, levels=3, probes=TIP, grade=True)
    assert result.gradings == ()
    assert any("No grading saves 5 %" in line for line in result.notes())
    assert len(result.table) == 3


SCENE = """
cloth = { shape = "rectangle", width = 1.0, height = 0.5, h = 0.1 }
fabric = { areal_density = 0.2, tensile_stiffness = 50.0, poisson_ratio = 0.3 }
terms = [{ type = "StVK" }, { type = "Gravity", acceleration = [9.81, 0, 0] }]
pins = [{ where = "left" }]
probes = [{ name = "tip", where = "right" }]
interest = { quantities = ["tip.x"] }
[equilibrium]
"""


scene = scene_file(SCENE, "strip")


def graded_by(keys):
    """The scene with a table of [[cloth.grading]]."""
    return SCENE.replace("h = 0.1 ", f"h = 0.1, grading = [{{ {keys} }}] ")


def test_the_command_grades_a_scene_and_its_gradings_go_into_the_scene(
    scene, tmp_path, run_command
):
    arguments = ["converge", str(scene), "--grade", "--levels", "3", "-o", str(tmp_path / "out")]
    printed = run_command(*arguments).out
    assert "The grading saves a factor of" in printed
    assert "Graded: point = [0.0, 0.5], distance = " in printed
    first = next(line for line in printed.splitlines() if line.startswith("Graded: "))
    scene.write_text(graded_by(first.removeprefix("Graded: ").rstrip(".")))
    graded = fc.load_scene(scene).mesh()
    assert len(graded.triangles) > 1.1 * len(fc.Cloth.rectangle(1.0, 0.5, 0.1).triangles)
