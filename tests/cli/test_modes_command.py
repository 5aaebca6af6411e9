"""`fecloth modes`: what it prints and writes, and its exit status."""

import math

import pytest

DRUM = """
cloth = { shape = "rectangle", width = 1.0, height = 1.0, h = 0.1, pattern = "cross" }
fabric = { areal_density = 0.2, tensile_stiffness = 10000.0, poisson_ratio = 0.3 }
terms = [{ type = "StVK" }]
pins = [{ where = "boundary" }]
start = { position = ["1.01 * X", "1.01 * Y", "0"] }
time = { t_end = 1.0 }
"""


@pytest.fixture
def scene(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "drum.toml"
    path.write_text(DRUM)
    return str(path)


@pytest.mark.stories
def test_it_prints_a_frequency_a_line(scene, run_command, tmp_path):
    printed = run_command("modes", scene, "-n", "3", "-o", "shapes")
    result = [float(line) for line in printed.out.splitlines()]
    tension = 1e4 / 0.7 * (1.01**2 - 1) / 2
    exact = [math.sqrt(tension / 0.2 * n) / 2 for n in (2, 5, 5)]
    assert result == pytest.approx(exact, rel=0.011)  # lumped: from below
    assert "stable: the lowest frequency is 18.8" in printed.err
    assert "open shapes/modes.pvd in ParaView" in printed.err
    assert len(list((tmp_path / "shapes" / "frames").glob("*.vtu"))) == 3


def test_it_warns_of_an_unstable_start(scene, run_command):
    squeezed = "start.position=['0.99 * X', '0.99 * Y', '0']"
    printed = run_command("modes", scene, "-n", "2", "--quiet", "--set", squeezed)
    assert all(float(line) < 0 for line in printed.out.splitlines())
    assert printed.err.startswith("warning: the state is unstable")
