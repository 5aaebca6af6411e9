"""The benchmark of whole commands: its scenes, and its rows from known runs."""

import numpy as np
import pytest

from fecloth.scene.scene import load_scene
from studies.evidence.benchmarks import commands
from studies.evidence.benchmarks.commands import Run, findings_of, missed_energy, page_of, row_of


def run_of(seconds, newton, x):
    return Run(seconds, {"newton": newton, "time_error": 0.01}, 0.001, np.array(x, float))


def test_each_scene_can_be_read_whole_and_short(tmp_path):
    scenes = commands.write_scenes(tmp_path)
    assert len(scenes) == 10
    for scene in scenes.values():
        whole = load_scene(scene.file, scene.settings)
        assert (whole.time is None) == (scene.file.name == "static_drape.toml")
        if scene.short:
            short = load_scene(scene.file, scene.settings + scene.short)
            assert short.time.t_end < whole.time.t_end


def test_a_row_has_the_ratio_and_the_distance_over_the_extent():
    before = run_of(10.0, 100, [[0, 0, 0], [2, 0, 0]])
    now = run_of(3.0, 103, [[0, 0, 0], [2, 0, 0.5]])
    row = row_of("flag", 0.33, before, now)
    assert (row["ratio"], row["apart"], row["Newton"]) == (0.3, 0.25, "100 → 103")
    assert [finding.is_met for finding in findings_of([row])] == [True, False]
    assert not findings_of([row_of("flag", 0.29, before, now)])[0].is_met
    page = page_of("6c98bcf9", 3, [row], (1.0, 7.5))
    assert page.startswith("# CPU seconds of whole commands, over those of commit 6c98bcf9\n")
    assert "1.0 at the start, 7.5 at the end" in page
    assert "| flag | 10 | 3 | 0.3 | 0.33 | 100 → 103 | 0.25 | 0.01 |" in page


def test_the_missed_energy_is_relative_to_the_largest_change():
    energies = [
        {"t": "0", "kinetic": "1", "Gravity": "50", "total": "51", "remainder": "0"},
        {"t": "9", "kinetic": "3", "Gravity": "46", "total": "49", "remainder": "-0.2"},
    ]
    assert missed_energy(energies) == pytest.approx(0.05)
