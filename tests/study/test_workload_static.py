"""The predicted size of a static scene."""

from pathlib import Path

from fecloth.scene.scene import load_scene
from fecloth.study.problem import StudyProblem
from fecloth.study.work import LOAD_STEP

SCENE = Path(__file__).parents[2] / "studies" / "scenes" / "inflated_disk.toml"


def test_load_steps_count_in_the_size_of_a_study():
    scenes = [load_scene(SCENE, [f"equilibrium.load_steps={n}"]) for n in (5, 10)]
    five, ten = (StudyProblem.of(scene).work for scene in scenes)
    assert (five.steps, ten.steps) == (5 * LOAD_STEP, 10 * LOAD_STEP)
    assert five.triangles == ten.triangles
