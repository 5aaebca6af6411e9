"""`fit`: closed forms, what is not told, wrong laws, offsets, starts, files and mistakes."""

import numpy as np
import pytest
from scipy.optimize import least_squares
from support.strips import grip_force, gripped
from support.wrong_calls import FIT as FILES

import fecloth as fc
from fecloth.scene.scene import load_scene
from fecloth.simulation.quantity import parse_quantity
from fecloth.study.budgeting.inputs import read_inputs
from fecloth.study.fitting import file as fit_file
from fecloth.study.fitting.search import choose_starts
from fecloth.study.fitting.specimens import known_reach
from fecloth.study.problem import StudyProblem

pytestmark = pytest.mark.stories

DRAWN = 0.1


def strip(h, stiffness=1000.0, B=1e-5, drawn=DRAWN):
    return gripped(h, stiffness, drawn=drawn, B=B)


def force(stiffness, drawn=DRAWN):
    return grip_force(stiffness, drawn)


def drawn_strip(values, **more):
    data = {"force [N]": values}
    return fc.Experiment(strip, data, quantity={"force": "reaction.right.x"}, h=0.25, **more)


def fit(*tests, **more):
    """The stiffness of these experiments, without a finer mesh."""
    return fc.fit(tests, {"stiffness": 900.0}, refined=False, **more)


def test_constant_and_interval_by_their_closed_form():
    """The mean of F counts: ln Y has the uncertainty σ/(F √n)."""
    values = force(1234.0) * np.array([0.99, 1.01, 1.0, 1.0])
    answer = fc.fit([drawn_strip(values, sigma=0.02 * force(1234.0))], {"stiffness": 900.0})
    assert answer.values["stiffness"] == pytest.approx(1234.0, rel=1e-5)
    half = 3.1824463 * 0.02 / 2  # the 97.5 % point of t with 3 degrees of freedom
    of_data = answer.intervals_of_data["stiffness"]
    assert of_data == pytest.approx(1234.0 * np.exp([-half, half]), rel=1e-3)
    assert np.isnan(answer.intervals["stiffness"]).all()  # of one strip
    assert "hold for these specimens only" in answer.verdict
    assert answer.covariance[0, 0] == pytest.approx((1234.0 * 0.01) ** 2, rel=1e-3)
    assert answer.misfit == pytest.approx(2 * 0.5**2 / 3, rel=1e-3)
    assert answer.identified == ("stiffness",)
    assert answer.numerical["stiffness"] == pytest.approx(0.0, abs=0.01)  # of an interval of ± 39
    assert answer.exit_status == 0


def drawn_strips(factors, **more):
    values = force(1000.0) * np.exp(factors)
    data = {"force [N]": values, "repeat": range(len(values))}
    return fc.Experiment(
        strip, data, {"force": "reaction.right.x"}, sigma="repeats", h=0.25, **more
    )


def test_the_interval_of_a_new_strip_by_its_closed_form():
    """Of ln Y: t √(τ² (1 + 1/R)), with τ of R strips and t of R − 1 degrees of freedom."""
    factors = np.array([-0.05, 0.02, 0.03])
    answer = fit(drawn_strips(factors))
    Y = 1000.0 * np.exp(factors).mean()
    tau = np.std(np.log(np.exp(factors) * 1000.0 / Y), ddof=1)
    assert answer.specimens == pytest.approx(tau, rel=1e-4)
    half = 4.3026527 * tau * np.sqrt(1 + 1 / 3)
    assert answer.intervals["stiffness"] == pytest.approx(Y * np.exp([-half, half]), rel=1e-4)
    assert answer.covariance[0, 0] == pytest.approx((Y * tau) ** 2 / 3, rel=1e-4)
    assert np.isnan(answer.law)
    assert answer.exit_status == 0


def test_a_spread_of_specimens_that_is_stated():
    """One strip and τ = 5 %: ± 1.96 · 5 % √2, beside the noise of 0.1 %."""
    test = drawn_strip([force(1000.0)], sigma="0.1 %")
    answer = fit(test, specimens="5 %")
    half = 1.9599640 * np.sqrt(2 * 0.05**2 + 0.001**2)
    assert answer.intervals["stiffness"] == pytest.approx(1000 * np.exp([-half, half]), rel=1e-5)


def test_a_strip_that_was_not_fitted_is_predicted_with_an_interval():
    """It is off by τ² (1/R + 1): three strips were fitted, and one more of the same is told."""
    factors = np.array([-0.05, 0.02, 0.03])
    other = drawn_strip([1.3 * force(1000.0)], sigma="1 %", fitted=False, name="other")
    tests = [drawn_strips(factors), other]
    answer = fit(*tests)
    (row,) = answer.predictions
    noise = 0.01 * 1.3 * force(1000.0) / row["predicted"]
    v = answer.specimens**2 * (1 + 1 / 3) + noise**2
    half = 4.3026527 * np.sqrt(v)
    ends = row["predicted"] * np.exp([-half, half])
    assert (row["from"], row["to"]) == pytest.approx(ends, rel=1e-3)
    assert row["measured"] == pytest.approx(1.3 * force(1000.0))
    assert "is not in the interval of a new specimen" in answer.verdict


@pytest.mark.parametrize("start", [100.0, 10000.0])
def test_a_start_ten_times_off_ends_at_the_same_place(start):
    answer = fc.fit([drawn_strip([force(1000.0)], sigma="1 %")], {"stiffness": start})
    assert answer.values["stiffness"] == pytest.approx(1000.0, rel=1e-4)


def test_a_constant_that_does_not_act_is_named_and_has_no_interval():
    experiment = drawn_strip([force(1000.0)], sigma="1 %")
    answer = fc.fit([experiment], {"stiffness": 900.0, "B": 1e-5}, refined=False)
    assert answer.identified == ("stiffness",)
    assert np.isnan(answer.intervals["B"]).all()
    assert np.isnan(answer.numerical["B"])
    assert answer.values["B"] == pytest.approx(1e-5)
    assert "these tests do not tell B" in answer.verdict
    assert "B = 1e-05, no interval" in answer.verdict
    assert answer.exit_status == 1


def test_two_strips_that_want_two_stiffnesses_show_a_wrong_law():
    def slack(h, stiffness=1000.0):
        return strip(h, 1.2 * stiffness)

    first = drawn_strip(3 * [force(1000.0)], sigma="1 %", name="first")
    data = {"force [N]": 3 * [force(1000.0)]}
    second = fc.Experiment(
        slack, data, quantity={"force": "reaction.right.x"}, h=0.25, sigma="1 %", name="second"
    )
    answer = fit(first, second)
    assert answer.law_fails
    assert "the law is wrong, not the constants" in answer.verdict
    Y = 1000 * 2.2 / 2.44  # of the least sum (Y − 1000)² + (1.2 Y − 1000)²
    wanted = Y * np.exp(-(1.2 * Y - 1000) / (1.2 * Y))  # by the derivative
    assert answer.values["stiffness"] == pytest.approx(Y, rel=1e-4)
    assert f"second wants stiffness = {wanted:.3g}, not {Y:.3g}" in answer.verdict
    assert answer.verdict.count("second wants") == 1
    assert np.isnan(answer.intervals["stiffness"]).all()
    assert answer.exit_status == 1


def test_without_sigma_2_percent_are_assumed_and_said():
    answer = fc.fit([drawn_strip([force(1000.0)])], {"stiffness": 900.0})
    assert answer.remarks == ("data: no sigma is given, so 2 % of the largest value is assumed",)


SCENE, FIT = FILES["strip.toml"], FILES["FIT.toml"]


@pytest.fixture
def folder(tmp_path):
    """A scene, points that begin 10 mm before the strip is taut, and FIT.toml."""
    places = np.linspace(0.01, 0.09, 9)
    rows = [f"{1e3 * (a + 0.01):.9g},{force(800.0, a):.9g}" for a in places]
    (tmp_path / "tension.csv").write_text("extension [mm],force [N]\n" + "\n".join(rows))
    (tmp_path / "strip.toml").write_text(SCENE)
    (tmp_path / "FIT.toml").write_text(FIT)
    return tmp_path


def test_curve_with_an_offset_from_a_file(folder):
    answer = fit_file.fit(folder / "FIT.toml", cache=folder)
    warp, weft = (f"fabric.tensile_stiffness.{i}" for i in (0, 1))
    assert answer.values[warp] == pytest.approx(800.0, rel=1e-5)
    assert answer.offsets["tension.csv"] == pytest.approx(0.01, rel=1e-4)
    assert answer.identified == (warp,)
    assert np.isnan(answer.intervals[weft]).all()
    assert "taken as given, and not measured: areal_density = 0.2, shear" in answer.remarks[0]
    assert "do not tell tensile_stiffness.1: a strip under tension along that" in answer.verdict
    assert answer.fabric["shear_stiffness"] == 300.0
    unknown = ("poisson_ratio", "shear_stiffness", "tensile_stiffness.0", "tensile_stiffness.1")
    assert answer.fabric["uncertainty"] == dict.fromkeys(unknown, "unknown")


def test_a_published_fabric_gives_what_is_not_fitted(folder):
    text = FIT.replace("areal_density = 0.2\nshear_stiffness = 300.0", 'preset = "denim-wang"')
    text = text.replace('"fabric.tensile_stiffness.1" = 600.0', "")
    (folder / "FIT.toml").write_text("refined = false\n" + text)
    answer = fit_file.fit(folder / "FIT.toml")
    known = fc.Fabric.preset("denim-wang")
    assert answer.fabric["shear_stiffness"] == known.shear
    assert answer.fabric["tensile_stiffness"][1] == known.tensile[1]


def test_the_fitted_fabric_serves_a_scene_with_its_uncertainty(folder):
    """Stated constants keep their uncertainty; what the fit does not tell stays unknown."""
    stated = 'shear_stiffness = 300.0\nuncertainty = { shear_stiffness = "5 %" }'
    text = FIT.replace("shear_stiffness = 300.0", stated)
    (folder / "FIT.toml").write_text('specimens = "4 %"\nrefined = false\n' + text)
    answer = fit_file.fit(folder / "FIT.toml")
    answer.report(folder)
    fabric = fc.Fabric.read(folder / "fitted.toml")
    assert fabric.tensile[0] == pytest.approx(800.0, rel=1e-4)
    # twice of it covers 95 %
    deviation = 1.9599640 / 2 * np.sqrt(answer.covariance[0, 0])
    known = {"tensile_stiffness.0": pytest.approx(deviation), "shear_stiffness": 15.0}
    assert fabric.uncertainty.standard(fabric) == known
    assert fabric.uncertainty.specimen == pytest.approx(1.9599640 / 2 * 0.04)
    scene = SCENE.partition("[fabric]")[0] + '[fabric]\nfile = "fitted.toml"\n'
    scene += SCENE[SCENE.index("[[terms]]") :]
    (folder / "next.toml").write_text(scene)
    measured = {"reaction.grip.x": (60.0, 0.1)}
    known = fc.budget(folder / "next.toml", measured=measured)
    assert known.agrees[0] is None
    assert known.specimen[0] == pytest.approx(1.9599640 / 2 * 0.04 * known.value[0])
    names = "fabric.tensile_stiffness.1, fabric.poisson_ratio is not known"
    assert f"no verdict on the model; the uncertainty of {names}" in known.verdict
    exact = {"fabric.tensile_stiffness.1": 0.0, "fabric.poisson_ratio": 0.0}
    answer = fc.budget(folder / "next.toml", exact, measured)
    assert answer.agrees[0] is False
    assert "the model is wrong by" in answer.verdict
    # drawn by 50 of 100 mm: the force of the closed form, with its derivative
    half = fc.sensitivity(
        folder / "next.toml", "fabric.tensile_stiffness.0", "reaction.grip.x at grip.x = 5 cm"
    )
    assert half.value == pytest.approx(force(800.0, 0.05), rel=1e-3)
    assert half.elasticity == pytest.approx([1.0], rel=1e-3)


def test_a_fitted_curve_serves_a_scene_with_its_uncertainty_and_correlations(folder):
    """S = 1000 E, from two slopes; a constant of the fabric is fitted with them."""
    curve = 'warp = { stretch = [1.05, 1.1], stiffness = [1300.0, 700.0] }\nsides = "free"'
    table = SCENE.replace('type = "StVK"', f'type = "MembraneTable"\n{curve}')
    (folder / "strip.toml").write_text(table)
    places = np.linspace(0.0, 0.1, 11)
    rows = [f"{1e3 * a:.9g},{force(1000.0, a):.9g}" for a in places]
    (folder / "tension.csv").write_text("extension [mm],force [N]\n" + "\n".join(rows))
    text = FIT.partition("[parameters]")[2].replace("offset = true", "")
    text = text.replace('"fabric.tensile_stiffness.0" = 600.0\n', "")
    text = text.replace("fabric.tensile_stiffness.1", "fabric.tensile_stiffness")
    names = [f"terms.0.warp.stiffness.{i}" for i in (0, 1)]
    more = "".join(f'"{name}" = 900.0\n' for name in names)
    head = 'specimens = "4 %"\nrefined = false\n[parameters]\n'
    (folder / "FIT.toml").write_text(head + more + text)
    answer = fit_file.fit(folder / "FIT.toml")
    assert [answer.values[name] for name in names] == pytest.approx([1000.0, 1000.0], rel=1e-3)
    answer.report(folder)
    term = '[[terms]]\ntype = "Gravity"\n[[terms]]\ntype = "MembraneTable"\n'
    rest = SCENE[SCENE.index("[[pins]]") :]
    scene = SCENE.partition("[fabric]")[0] + '[fabric]\nfile = "fitted.toml"\n' + term
    (folder / "next.toml").write_text(scene + rest)
    read = load_scene(folder / "next.toml")
    assert read.terms[1].sides == "free"
    assert read.terms[1].warp["stiffness"] == tuple(answer.values[name] for name in names)
    inputs = read_inputs(StudyProblem.of(read), read.uncertain)
    assert inputs.names == [f"terms.1.warp.stiffness.{i}" for i in (0, 1)]
    widened = (1.9599640 / 2) ** 2
    assert inputs.covariance == pytest.approx(widened * answer.covariance[:2, :2], rel=1e-6)
    assert "fabric.tensile_stiffness" in inputs.unknown  # of the weft, which no strip tells
    own = "warp = { stretch = [1.05], force = [50.0] }\n"
    (folder / "next.toml").write_text(scene + own + rest)
    assert read_inputs(StudyProblem.of(folder / "next.toml"), {}).names == []
    assert load_scene(folder / "next.toml").uncertain == {}
    # correlated with a constant of the fabric, and replaced by the scene
    rho = '["terms.MembraneTable.warp.stiffness.0", "fabric.shear_stiffness", 0.3]'
    fitted = (
        (folder / "fitted.toml").read_text().replace("correlation = [", f"correlation = [\n{rho},")
    )
    (folder / "fitted.toml").write_text(fitted)
    (folder / "next.toml").write_text(scene + rest)
    pairs = load_scene(folder / "next.toml").uncertain["correlation"]
    assert ("terms.1.warp.stiffness.0", "fabric.shear_stiffness", 0.3) in map(tuple, pairs)
    (folder / "next.toml").write_text(scene.replace(term, "shear_stiffness = 70.0\n" + term) + rest)
    assert len(load_scene(folder / "next.toml").uncertain["correlation"]) == len(pairs) - 1


def test_command_writes_curves_and_the_fabric_and_goes_on_from_stored_runs(
    folder, capsys, run_command
):
    from fecloth.cli.main import main

    command = ["fit", str(folder / "FIT.toml"), "-o", str(folder / "out")]
    assert main(command) == 1  # the weft is not told
    first = capsys.readouterr()
    assert "tensile_stiffness.0 = 800" in first.out
    assert "[evaluation 1] misfit" in first.err
    written = {path.name for path in (folder / "out").iterdir()}
    assert {"fitted.toml", "points.csv", "report.html", "results.csv", "figure.png"} <= written
    stored = len(list((folder / "out" / "cache").iterdir()))
    assert run_command(*command, status=1).out == first.out
    assert len(list((folder / "out" / "cache").iterdir())) == stored


def test_an_experiment_that_is_compared_only(folder):
    text = FIT + FIT[FIT.index("[[exp") :].replace(
        'sigma = "1 %"', 'fitted = false\nname = "other"'
    )
    (folder / "FIT.toml").write_text("refined = false\n" + text)
    rows = list(fit_file.fit(folder / "FIT.toml").experiments)
    assert [row["fitted"] for row in rows] == ["yes", "no"]
    assert rows[1]["rms %"] < 0.1
    assert rows[1]["offset"] == pytest.approx(0.01, rel=0.01)


def test_a_place_at_the_end_of_the_reach_is_within_it(folder, monkeypatch):
    from fecloth.study.fitting import evaluation

    class Began(Exception):
        pass

    def begin(*_):
        raise Began

    monkeypatch.setattr(evaluation, "run_all", begin)
    (folder / "FIT.toml").write_text(FIT.replace("offset = true\n", ""))
    (folder / "tension.csv").write_text("extension [mm],force [N]\n50,20\n100,40\n")
    with pytest.raises(Began):
        fit_file.fit(folder / "FIT.toml")


def test_several_starts_say_how_many_agree():
    answer = fc.fit([drawn_strip([force(1000.0)])], {"stiffness": 900.0}, starts=3, refined=False)
    assert "3 of 3 starts end at these constants" in answer.remarks


@pytest.mark.parametrize("starts", [1, 3, 20])
def test_other_starts_lie_on_both_sides_between_a_third_and_three_times(starts):
    places = np.array(choose_starts(2, starts))
    assert places.shape == (starts, 2)
    assert not places[0].any()
    factors = np.exp(places[1:])
    assert ((factors >= 1 / 3) & (factors <= 3)).all()
    if starts > 1:
        assert ((factors.min(axis=0) < 1) & (factors.max(axis=0) > 1)).all()
    if starts == 20:
        assert factors.min(axis=0) == pytest.approx(1 / 3, rel=0.15)
        assert factors.max(axis=0) == pytest.approx(3, rel=0.15)


def test_the_reach_of_a_grip_is_known_before_the_run():
    def swinging(h):
        cloth = fc.Cloth.rectangle(1.0, 0.5, h, pattern="right")
        pin = fc.Pin("right", motion=lambda t: (0.03 * t, 0.0, 0.0))
        system = fc.System(cloth, fc.Fabric(0.2, 1000.0), [fc.StVK()], ["left", pin])
        return cloth, system, fc.BDF2(), system.rest()

    probes = [fc.Probe("grip", "right"), fc.Probe("middle", point=(0.5, 0.25))]
    setup = fc.study.of(swinging, h=0.25, dt=0.1, t_end=2.0, probes=probes).problem.first
    assert known_reach(setup, parse_quantity("grip.x")) == pytest.approx((0.0, 0.06))
    assert known_reach(setup, parse_quantity("middle.x")) is None
    assert known_reach(setup, None) == (0.0, 2.0)


# --- mistakes in the data -------------------------------------------------------------------------


def noisy(factors):
    """Twenty values of the force, with a scatter of 1 % that is known."""
    scatter = 0.01 * np.tile([1.0, -1.0, 0.5, -0.5], 5)
    return drawn_strip(force(1000.0) * (1 + scatter) * factors, sigma=0.01 * force(1000.0))


def test_one_point_far_off_is_named_and_the_law_is_not_blamed():
    factors = np.ones(20)
    factors[6] = 1.25
    answer = fit(noisy(factors))
    assert "far off the curve of force: point 7 (" in answer.verdict
    assert not answer.law_fails
    robust = fit(noisy(factors), loss="soft_l1")
    off, off_robust = (abs(each.values["stiffness"] - 1000.0) for each in (answer, robust))
    assert off > 10.0 > 3 * off_robust
    factors[:10] = 1.25  # the shape of the data: no single points
    wrong = fit(noisy(factors))
    assert wrong.law_fails
    assert "far off" not in wrong.verdict


def test_a_wrong_unit_is_named_from_a_start_far_off():
    answer = fit(noisy(1000.0))
    assert answer.values["stiffness"] == pytest.approx(1e6, rel=0.01)
    assert "is a unit wrong (mN written as N, or N as kN)?" in answer.verdict
    near = fc.fit([noisy(1.0)], {"stiffness": 30.0}, refined=False)
    assert near.values["stiffness"] == pytest.approx(1000.0, rel=0.01)
    near = fit(noisy(1.0))
    assert "unit" not in near.verdict


def test_a_search_that_has_not_converged_says_so_and_does_not_blame_the_law(monkeypatch):
    from fecloth.study.fitting import search as fits

    def soon(*given, **more):
        return least_squares(*given, **more | {"max_nfev": 1})

    monkeypatch.setattr(fits, "least_squares", soon)
    answer = fc.fit([noisy(1.0)], {"stiffness": 500.0}, refined=False)
    assert "the search has not converged" in answer.verdict
    assert not answer.law_fails
    assert answer.identified == ()
