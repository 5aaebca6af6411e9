"""τ and κ from curves whose amplitudes are known, beside a generalised least squares of its own."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from fecloth.study.fitting.amplitude import read_curve
from fecloth.study.fitting.computed import Computed
from fecloth.study.fitting.discrepancy import Solved, find_discrepancy
from fecloth.study.fitting.evaluation import Column, Evaluation
from fecloth.study.fitting.measured import Measured

PLACES = np.linspace(0.1, 1.0, 8)
SIGMA = 1e-6  # hardly any noise: amplitudes are what tells


def column(name, slopes, amplitudes, fitted=True, offset=False):
    """A curve f = 2 x of problem `name`; ∂ ln f/∂u = slopes; measured is f exp(amplitude)."""
    count = len(amplitudes)
    f = np.tile(2 * PLACES, count)
    source = SimpleNamespace(fabrics={}, function=name, arguments={})
    experiment = SimpleNamespace(fitted=fitted, offset=offset, label=name)
    specimen = SimpleNamespace(experiment=experiment, problem=SimpleNamespace(source=source))
    measured = f * np.exp(np.repeat(amplitudes, len(PLACES)))
    points = Measured(
        "f", "f", "N", measured, np.full(f.shape, SIGMA), np.tile(PLACES, count),
        repeats=np.repeat(np.arange(count), len(PLACES)),
    )  # fmt: skip
    J = np.outer(f, slopes) / SIGMA
    along = np.full(f.shape, 2.0)
    return Column(specimen, points, (f - measured) / SIGMA, J, Computed(f, J, along))


def scale_of(columns, stated=None):
    unknowns = columns[0].jacobian.shape[1]
    return find_discrepancy(Evaluation(np.zeros(unknowns), {}, tuple(columns)), stated)


def test_the_amplitudes_of_specimens_and_their_slopes():
    curve = read_curve(column("warp", [1.0, 0.5], [0.02, -0.04]))
    assert curve.amplitudes == pytest.approx([0.02, -0.04])
    assert curve.slopes == pytest.approx([1.0, 0.5])
    assert curve.shape.residual == pytest.approx(np.zeros(16), abs=1e-6)


def test_the_amplitudes_of_repeats_that_were_averaged():
    """The amplitude of a repeat is the amplitude of the mean plus its own distance from it."""
    parts = np.array([0.02, -0.05, 0.06])
    mean = column("warp", [1.0], [np.log1p(parts.mean())])
    points = replace(mean.points, scatter=np.outer(parts - parts.mean(), 2 * PLACES))
    curve = read_curve(replace(mean, points=points))
    assert np.expm1(curve.amplitudes) == pytest.approx(parts, abs=1e-6)


def test_a_slack_hides_the_amplitude_of_a_straight_line_but_not_of_a_curve():
    assert read_curve(column("warp", [1.0], [0.02], offset=True)) is not None
    straight = column("warp", [1.0], [0.02], offset=True)
    flat = SimpleNamespace(changes=np.ones(8), along_slope=np.ones(8))
    assert read_curve(Column(**vars(straight) | {"computed": flat})) is None


def test_specimens_differ_by_the_deviation_within_each_direction():
    a, b = np.array([0.03, -0.01, 0.01]), np.array([0.05, -0.01])
    scale = scale_of([column("warp", [1.0, 0.0], a), column("weft", [0.0, 1.0], b)])
    squares = ((a - a.mean()) ** 2).sum() + ((b - b.mean()) ** 2).sum()
    assert scale.specimens == pytest.approx(np.sqrt(squares / 3))
    assert scale.experiments == 5
    assert np.isnan(scale.law)  # each direction has a constant of its own
    tau = scale.specimens
    assert scale.covariance(is_new=True) == pytest.approx(
        np.diag([tau**2 * (1 + 1 / 3), tau**2 * (1 + 1 / 2)]), rel=1e-4
    )
    assert scale.covariance(is_new=False) == pytest.approx(
        np.diag([tau**2 / 3, tau**2 / 2]), rel=1e-4
    )


def test_one_specimen_a_direction_tells_only_the_sum_of_both():
    """One constant, a and −a: left out, each is off by 2 a, with the variance 2 φ²."""
    a = 0.03
    columns = [column("0", [1.0], [a]), column("90", [1.0], [-a])]
    scale = scale_of(columns)
    assert np.isnan(scale.specimens)
    assert np.isnan(scale.law)
    assert scale.both == pytest.approx(np.sqrt(2) * a, rel=0.01)
    stated = scale_of(columns, stated=0.01)
    assert stated.law == pytest.approx(np.sqrt(2 * a**2 - 0.01**2), rel=0.01)
    assert scale_of(columns, stated=0.1).law == 0.0


def test_the_variance_of_a_prediction_by_its_definition():
    """Random specimens and laws: the spread of predicted less measured amplitudes is √v."""
    rng = np.random.default_rng(0)
    slopes = {"0": [1.0, 0.0], "45": [0.4, 0.7], "90": [0.1, 1.0], "70": [0.3, 0.8]}
    columns = [column(name, s, [0.0, 0.0]) for name, s in slopes.items()]
    scale = scale_of(columns, stated=0.02)
    object.__setattr__(scale, "law", 0.05)
    for name, other in (("30", [0.7, 0.4]), ("45", slopes["45"])):
        v = scale.variance(read_curve(column(name, other, [0.0], fitted=False)))
        A = np.array(list(slopes.values()))
        law = 0.05 * rng.standard_normal((4000, len(A)))
        means = law + 0.02 / np.sqrt(2) * rng.standard_normal(law.shape)
        u = means @ np.linalg.pinv(A).T
        own = law[:, 1] if name == "45" else 0.05 * rng.standard_normal(4000)
        off = own + 0.02 * rng.standard_normal(4000) - u @ np.array(other)
        assert np.sqrt(v) == pytest.approx(off.std(), rel=0.05)


def test_what_the_others_do_not_tell_has_no_variance():
    scale = scale_of([column("0", [1.0, 0.0], [0.01, -0.01]), column("1", [1.0, 0.0], [0.0, 0.01])])
    assert np.isnan(scale.variance(read_curve(column("90", [0.0, 1.0], [0.0], fitted=False))))
    assert np.isfinite(scale.variance(read_curve(column("2", [1.0, 0.0], [0.0], fitted=False))))


def test_curves_that_are_left_out_in_turn_are_off_as_their_step_says():
    curves = [read_curve(column(n, s, [a])) for n, s, a in (("0", [1.0], 0.1), ("1", [2.0], 0.0))]
    assert Solved.of(curves[:1], []).step == pytest.approx([np.expm1(0.1)])
    assert Solved.of(curves, []).moves[:, 0] == pytest.approx([1 / 5, 2 / 5])  # J⁺ of (1, 2)
