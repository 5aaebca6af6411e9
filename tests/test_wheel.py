"""The release: the wheel, built from the source distribution, works away from the clone."""

import os
import shutil
import subprocess
import sys
import sysconfig
import tomllib
import venv
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


OUTSIDE = {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")}


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """The file of the wheel."""
    pytest.importorskip("build")
    folder = tmp_path_factory.mktemp("dist")
    build = [sys.executable, "-m", "build", str(ROOT), "--outdir", str(folder)]
    subprocess.run(build, check=True, capture_output=True, timeout=300)
    (wheel,) = folder.glob("*.whl")
    assert wheel.stat().st_size < 1.5e6
    return wheel


@pytest.fixture(scope="module")
def installed(wheel, tmp_path_factory):
    """A function that runs a command with the wheel, in an environment and a folder of its own."""
    folder = tmp_path_factory.mktemp("wheel")
    venv.create(folder / "env", with_pip=False)
    paths = sysconfig.get_paths(vars={"base": str(folder / "env"), "platbase": str(folder / "env")})
    packages, scripts = Path(paths["purelib"]), Path(paths["scripts"])
    pip = [sys.executable, "-m", "pip", "--python", str(folder / "env"), "install", "-q"]
    subprocess.run([*pip, "--no-deps", str(wheel)], check=True, timeout=300, env=OUTSIDE)
    # the new environment takes the dependencies from this environment: nothing is downloaded
    (packages / "others.pth").write_text(sysconfig.get_paths()["purelib"], encoding="utf-8")
    (folder / "work").mkdir()

    def call(*command: str) -> str:
        python = scripts / Path(sys.executable).name
        answer = subprocess.run(
            [str(python), "-m", "fecloth", *command] if command[0] != "-c" else [python, *command],
            cwd=folder / "work", env=OUTSIDE, capture_output=True, text=True, timeout=300,
        )  # fmt: skip
        assert answer.returncode == 0, answer.stderr
        return answer.stdout

    call.packages, call.folder, call.prefix = packages, folder / "work", folder / "env"
    return call


@pytest.mark.stories
def test_the_wheel_makes_a_scene_a_run_pictures_and_a_study(installed):
    where = installed("-c", "import fecloth; print(fecloth.__file__)")
    assert Path(where.strip()).is_relative_to(installed.packages)
    assert PROJECT["version"] in installed("--version")
    installed("new", "pennant", "--kind", "geo")
    short = ["--set", "time.t_end=0.01", "--set", "cloth.h=0.2"]  # most of it is compilation
    installed("run", "pennant.toml", "--quiet", *short)
    installed("view", "out/pennant", "--no-open")
    installed("render", "out/pennant", "-o", "pennant.png", "--size", "160x120")
    installed("export", "out/pennant", "-o", "pennant.usda")
    values = "fabric.poisson_ratio=0.2,0.3"
    swept = installed("sweep", "pennant.toml", "--over", values, "--quantity", "tip.z", *short)
    assert swept.count("| ok |") == 2
    for name in ("pennant.png", "pennant.usda"):
        assert (installed.folder / name).stat().st_size > 1000
    assert "interlock" in installed("info", "--fabrics")
    made = {path.name for path in (installed.folder / "out/pennant").iterdir()}
    assert {"report.html", "view.html", "run.pvd"} <= made


@pytest.mark.stories
def test_the_wheel_has_the_scenes_of_the_gallery(installed):
    scenes = sorted(file.stem for file in (ROOT / "studies" / "scenes").glob("*.toml"))
    *lines, _ = installed("demo").splitlines()
    assert [line.split()[0] for line in lines] == scenes
    installed("demo", "flag", "--quiet", "--set", "cloth.h=0.2", "--set", "time.t_end=0.01")
    assert (installed.folder / "out" / "flag" / "run.pvd").exists()
    packed = [f for f in installed.prefix.rglob("share/fecloth/**/*") if f.is_file()]
    assert 0 < sum(file.stat().st_size for file in packed) < 300e3


@pytest.mark.study
@pytest.mark.parametrize("version", ["3.11", "3.12", "3.13"])
def test_a_clean_environment_runs_a_scene(version, wheel, tmp_path):
    """With the dependencies from the package index, in at most the size that README says."""
    python = shutil.which(f"python{version}")
    if not python or subprocess.run([python, "-c", ""]).returncode:
        pytest.skip(f"needs Python {version}")
    subprocess.run([python, "-m", "venv", "env"], cwd=tmp_path, check=True)
    scripts = tmp_path / "env" / ("Scripts" if os.name == "nt" else "bin")
    install = [scripts / "python", "-m", "pip", "install", "-q", "--no-compile", wheel]
    subprocess.run(install, check=True, timeout=600, env=OUTSIDE)
    files = [file for file in (tmp_path / "env").rglob("*") if file.is_file()]
    assert sum(file.stat().st_size for file in files) < 700e6
    short = ["--quiet", "--set", "cloth.h=0.2", "--set", "time.t_end=0.02"]
    demo = [scripts / "python", "-m", "fecloth", "demo", "flag", *short]
    subprocess.run(demo, cwd=tmp_path, check=True, timeout=600, env=OUTSIDE)
    assert (tmp_path / "out" / "flag" / "run.pvd").exists()


@pytest.mark.parametrize("shell", ["bash", "zsh"])
def test_the_shell_completes_commands_and_options(shell):
    shtab = pytest.importorskip("shtab")
    from fecloth.cli.main import _parser

    script = shtab.complete(_parser(), shell=shell)
    assert "converge" in script
    assert "--levels" in script
