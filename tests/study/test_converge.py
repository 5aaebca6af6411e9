"""`converge`: known answers, verdicts, shares of the error, cache, report, command."""

import os
import re
import subprocess
import sys

import numpy as np
import pytest
from support.scene_texts import STRING
from support.strips import TIP, scene_file
from support.strips import strip as hung

import fecloth as fc
from fecloth.errors import InputError
from fecloth.output.frame_reader import read_vtu
from fecloth.simulation.doubts.doubt import Doubt, DoubtKind
from fecloth.simulation.quantity import parse_quantity
from fecloth.simulation.setup import Setup
from fecloth.study import measured_runs
from fecloth.study.convergence import Convergence, judge
from fecloth.study.measured_runs import measure
from fecloth.study.orders import find_obstacles, is_round, space_order
from fecloth.study.problem import StudyProblem
from fecloth.study.uncertainty import UNSAFE, estimate_uncertainty
from studies.references.closed_forms import hanging_strip_tip

pytestmark = pytest.mark.stories

SCENE = STRING
scene = scene_file(SCENE, "string")


def strip(h, element="P1"):
    return hung(h, 5.0, pattern="cross", element=element)


def swing(h, dt):
    """A rigid pendulum of two nodes would do; a taut string has the exact period 2 L/c."""
    cloth = fc.Cloth.rectangle(1.0, 0.25, h, pattern="right")
    system = fc.System(cloth, fc.Fabric(0.2, 100.0), [fc.StVK()], pins=["left", "right"])
    x = system.rest().x * [1.1, 1, 1]
    v = np.column_stack([0 * cloth.X, 1e-3 * np.sin(np.pi * cloth.X[:, 0])])
    return cloth, system, fc.ImplicitMidpoint(), system.state(x, v)


def failing(h):
    if h < 0.2:
        raise InputError("h", "is too small for this test")
    return strip(h)


@pytest.mark.parametrize("element", ["P1", "P2"])
@pytest.mark.parametrize("levels", [3, 4])
def test_the_tip_of_a_hanging_strip_is_covered(element, levels):
    exact = 1 + hanging_strip_tip(1.0, 5.0, 0.2)
    result = fc.study.converge(strip, "tip.x", h=0.25, levels=levels, probes=TIP, element=element)
    assert abs(result.value - exact) <= result.uncertainty <= 30 * abs(result.value - exact)
    assert abs(result.limit - exact) < abs(result.value - exact)
    assert result.converges
    assert result.unit == "m"
    assert len(result.table) == levels


@pytest.mark.filterwarnings("ignore:the equilibrium is unstable")
def test_a_field_converges_with_its_order_and_its_uncertainty_covers_the_error():
    result = fc.study.converge(strip, "displacement in H1", h=0.25, levels=4)
    assert result.order == pytest.approx(1, abs=0.15)
    finest, reference = strip(0.25 / 8)[1], strip(0.25 / 8, "P2")[1]
    moved = [fc.equilibrium(each, each.rest()).x - each.rest().x for each in (finest, reference)]
    error = finest.cloth.h1_difference(reference.cloth, *moved)
    assert error <= result.uncertainty <= 5 * error


def test_period_of_a_string_by_h_dt_and_both():
    """T = 2 L √(ρ/S) λ of the reference: stress S = 105/2 Y/100 of the stretched strip."""
    speed = np.sqrt(100.0 * (1.1**2 - 1) / 2 / 0.2)
    exact = 2.0 / speed
    run = {
        "h": 0.125,
        "dt": 0.05 * exact,
        "t_end": 2.2 * exact,
        "probes": [fc.Probe("m", point=(0.5, 0.1))],
    }
    result = {}
    for refine in ("h", "dt", "both"):
        result[refine] = fc.study.converge(swing, "period of m.z", refine, 3, **run)
        study = result[refine]
        assert abs(study.value - exact) <= study.uncertainty, refine
        assert study.order == pytest.approx(2, abs=0.5)
    assert list(result["h"].shares) == ["mesh", "time step", "solver"]
    assert list(result["dt"].shares) == ["time step", "mesh", "solver"]
    assert list(result["both"].shares) == ["mesh and time step", "solver"]
    assert any("refine it too" in words for words in result["h"].notes())  # dt is coarse
    assert result["both"].uncertainty < 0.5 * result["dt"].uncertainty


def test_the_frequency_of_a_square_drum_is_covered():
    """f = √(S/ρ)/(√2 a) of a membrane with the tension S, stretched by 1.1."""

    def drum(h):
        cloth = fc.Cloth.rectangle(1.0, 1.0, h, pattern="right")
        system = fc.System(cloth, fc.Fabric(0.2, 100.0, 0.3), [fc.StVK()], ["boundary"])
        return cloth, system, fc.BDF2(), system.state(1.1 * system.rest().x)

    exact = np.sqrt(100 / 0.7 * (1.1**2 - 1) / 2 / 0.2 / 2)
    result = fc.study.converge(drum, "frequency(1)", h=0.25, levels=4)
    assert abs(result.value - exact) <= result.uncertainty <= 5 * abs(result.value - exact)
    assert (result.unit, result.theory) == ("Hz", 2.0)
    assert result.order == pytest.approx(2, abs=0.2)


def test_a_scene_and_its_cache(scene, tmp_path, capsys):
    first = fc.study.converge(scene, "energy.StVK", levels=3, cache=tmp_path)
    assert first.theory == 2
    assert "5 cases, up to 512 triangles" in capsys.readouterr().err
    again = fc.study.converge(fc.load_scene(scene), "energy.StVK", levels=3, cache=tmp_path)
    assert again.value == first.value
    assert "ok" not in capsys.readouterr().err  # nothing ran
    other = fc.study.converge(scene, "max middle.z", levels=3, cache=tmp_path)
    assert other.value > 0
    assert "h / 4: ok" in capsys.readouterr().err


def test_a_scene_at_rest(scene):
    """A taut strip with ν = 0 under a small load q: w = q L²/(8 S), at every node exact."""
    text = SCENE.partition("time = ")[0].replace(', velocity = ["0", "0", "sin(pi * X)"]', "")
    weight = '"StVK" }, { type = "Gravity", acceleration = [0, 0, -1e-3] }'
    scene.write_text(text.replace('"StVK" }', weight) + "[equilibrium]\n")
    result = fc.study.converge(scene, "sag", levels=3)
    exact = 0.2e-3 / 8 / (100 * (1.1**2 - 1) / 2)
    assert result.value == pytest.approx(exact, rel=1e-3)
    assert list(result.shares) == ["mesh"]


def test_a_trusted_geo_file_stays_trusted(scene, tmp_path):
    (tmp_path / "sheet.geo").write_text(
        """General.Terminal = 0; // needs trust
        Point(1) = {0, 0, 0, 0.2}; Point(2) = {1, 0, 0, 0.2}; Point(3) = {0.5, 1, 0, 0.2};
        Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 1};
        Curve Loop(1) = {1, 2, 3}; Plane Surface(1) = {1}; Physical Surface("cloth") = {1};
        """
    )
    text = re.sub("cloth = .*", 'cloth = { shape = "file", path = "sheet.geo", h = 0.4 }', SCENE)
    scene.write_text(re.sub("(pins|probes) = .*", "", text))
    with pytest.raises(InputError, match="--trust-geo"):
        fc.study.converge(scene, "area", levels=3)
    result = fc.study.converge(fc.load_scene(scene, trust_geo=True), "area", levels=3)
    assert result.table["triangles"][-1] > 2 * result.table["triangles"][0]


def test_the_error_of_chosen_steps_is_a_share(scene):
    """The estimate from rtol/10 is that against rtol/1000 within a factor of two."""
    chosen = fc.load_scene(scene, ["time.dt=auto", "time.rtol=0.05"])
    result = fc.study.converge(chosen, "max middle.z", levels=3)
    over = "time.rtol=0.05,5e-5"
    coarse, fine = fc.study.sweep(chosen, over, "max middle.z").table["max middle.z"]
    assert result.shares["time step"] == pytest.approx(abs(coarse - fine), rel=0.5)
    assert not any("estimates its error in time" in words for words in result.notes())


def test_a_cloth_without_tension_across_is_named_as_an_obstacle():
    """A strip that hangs between two edges; the same cloth held and stretched all around."""
    cloth = fc.Cloth.rectangle(1.0, 0.5, 0.25, pattern="right", element="P2")

    def words(pins, stretched, cloth=cloth):
        terms = [fc.StVK(), fc.Pressure(20.0)]
        mass = "consistent" if cloth.element == "P2" else "lumped"
        system = fc.System(cloth, fc.Fabric(0.2, 1000.0), terms, pins=pins, mass=mass)
        x = system.rest().x * [stretched[0], stretched[1], 1.0]
        setup = Setup(system, system.state(x))
        return " ".join(find_obstacles(setup, {"least_stretch": [1.0, 1.0]}, x))

    said = "tension in one direction only"
    assert said in words(["left", "right"], (1.02, 1.0))
    assert said not in words(["boundary"], (1.02, 1.01))
    linear = fc.Cloth.rectangle(1.0, 0.5, 0.25, pattern="right")
    assert said not in words(["left", "right"], (1.02, 1.0), linear)


def test_levels_that_fail_are_named():
    result = fc.study.converge(failing, "displacement", h=0.25, levels=3)
    assert result.verdict.startswith("not known: 2 of 3 levels failed; the first: h: is too small")
    assert result.table["h"] == [0.25, 0.125, 0.0625]
    assert not result.converges


@pytest.mark.parametrize(
    ("kind", "verdict"),
    [
        (DoubtKind.MOTION, "not known: 3 of 3 levels failed; the first: any words"),
        (DoubtKind.WRINKLES, "not known to converge: the finest run warns of any words"),
        (DoubtKind.OTHER, "no order to be seen"),
    ],
)
def test_runs_that_are_doubted_are_no_evidence(kind, verdict, monkeypatch):
    def warned(setup, *asked, **more):
        return measure(setup, *asked, **more) | {"doubts": [Doubt(kind, "any words").entry()]}

    monkeypatch.setattr(measured_runs, "measure", warned)
    result = fc.study.converge(hung, "tip.x", h=0.25, stiffness=40.0, levels=3, probes=TIP)
    assert result.verdict.startswith(verdict)
    assert (result.estimate is None) == (kind is DoubtKind.MOTION)
    if kind is DoubtKind.OTHER:  # without a limit the finest level has an error, too
        assert result.table[-1]["error"] == result.estimate.uncertainty / UNSAFE > 0
    compared = fc.study.compare(hung, "stiffness=40,80", "tip.x", h=0.25, probes=TIP)
    assert (compared.table["status"] == ["ok", "ok"]) == (kind is not DoubtKind.MOTION)
    notes = [words for words in compared.notes() if "not known to converge" in words]
    assert len(notes) == 2 * (kind is DoubtKind.WRINKLES)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ([1.3, 1.09, 1.025, 1.006], "converges as it should"),
        ([1.0, 1.1, 1.2, 1.3], "does not converge: no limit seen"),
        ([1.0, 1.2, 0.9, 1.1], "does not converge: the values go up and down"),
        ([1.0, 1.30, 1.50, 1.62], r"converges with order 0\.\d+, below the theory 2 \(folds\)"),
        ([2.0, 2.0, 2.0, 2.0], "converges: all levels give the same value"),
        ([1 + 1e-1, 1 + 1e-3, 1 + 1e-5, 1 + 1e-7], "not known to converge: .* follow no order"),
    ],
)
def test_verdicts(values, words):
    h = [0.8, 0.4, 0.2, 0.1]
    converges, verdict = judge(estimate_uncertainty(h, values, 2.0), values, ["folds"])
    assert re.search(words, verdict)
    assert converges == verdict.startswith("converges")
    assert ("Possible reasons: folds" in verdict) == (not converges)


@pytest.mark.parametrize(
    "values",
    [[1.01, 1.0, 1.0002, 0.9999], [1.0, 1.0001, 1.0003, 1.0006], [1.0, 1.001, 1.0, 1.0011]],
)
def test_small_differences_without_an_order_are_called_so(values):
    """Above half a per cent of the quantity they are named as before."""
    h, spread = [0.8, 0.4, 0.2, 0.1], np.ptp(values[-3:])
    for part, is_small in ((0.8, True), (1.25, False)):
        size = spread / (part * 0.005)
        converges, words = judge(estimate_uncertainty(h, values, 2.0), values, ["folds"], size)
        assert not converges
        assert words.startswith(f"no order to be seen within {0.5 * part:.2g} %") == is_small


def test_a_point_pin_is_named_as_an_obstacle():
    def corner(h):
        cloth = fc.Cloth.rectangle(1.0, 1.0, h, pattern="right")
        pin = fc.Pin(lambda X: np.hypot(*X.T) < 1e-9, name="corner")
        system = fc.System(cloth, fc.Fabric(0.2, 20.0), [fc.StVK(), fc.Gravity()], ["right", pin])
        return cloth, system, None, system.rest()

    setup = StudyProblem.of(corner, h=0.5).first
    x = setup.start.x
    (words,) = find_obstacles(setup, {"least_stretch": [1.0, 0.95]}, x)
    assert "pin corner holds a single point" in words


def test_theoretical_orders_know_round_borders_and_elements():
    round_, flat = fc.Cloth.disk(1.0, 0.2), fc.Cloth.rectangle(1.0, 1.0, 0.2)
    assert (is_round(round_), is_round(flat)) == (True, False)
    for element, expected in (("P1", (2, 1, 2)), ("P2", (3, 2, 4))):
        opened = StudyProblem.of(strip, h=0.25, arguments={"element": element})
        texts = ("displacement", "displacement in H1", "energy.StVK")
        result = [space_order(parse_quantity(t), opened.first) for t in texts]
        assert tuple(result) == expected


def test_report_figure_and_words(tmp_path):
    result = fc.study.converge(strip, "tip.x", h=0.25, levels=3, probes=TIP)
    page = result.report(tmp_path / "r")
    text = page.read_text()
    assert str(tmp_path) not in text
    assert result.verdict.split(":")[0] in text
    assert {p.name for p in page.parent.iterdir()} == {
        "report.html",
        "results.csv",
        "figure.png",
        "figure.svg",
        "finest.pvd",
        "finest.vtu.series",
        "finest_000000.vtu",
    }
    frame = read_vtu(page.parent / "finest_000000.vtu")
    right = frame.point_data["reference"][:, 0] == 1.0
    assert frame.points[right, 0].mean() == pytest.approx(result.value, rel=1e-9)
    assert len((page.parent / "results.csv").read_text().splitlines()) == 4
    assert repr(result).startswith("<Convergence of strip: converges")
    assert "\n" not in repr(result)
    assert "<table>" in result._repr_html_()
    assert isinstance(result, Convergence)


def test_import_keeps_the_threads_of_the_user():
    code = "import os, fecloth as fc; fc.study.converge; print(os.environ.get('OMP_NUM_THREADS'))"
    clean = {k: v for k, v in os.environ.items() if not k.endswith("NUM_THREADS")}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=clean)
    assert done.stdout.strip() == "None"
