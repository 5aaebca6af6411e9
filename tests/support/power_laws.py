"""A problem for `tune` whose errors and seconds are powers of √triangles x and of the steps n."""

from dataclasses import dataclass, field, replace

import numpy as np

from fecloth.simulation.quantity import parse_quantity
from fecloth.study.run_problems import Runs
from fecloth.study.tuning.choices import Bench, Choice, Trial
from fecloth.study.tuning.curves import Curve, cost_curve, error_curve
from fecloth.study.tuning.prediction import Candidate, Prediction
from fecloth.study.tuning.space_errors import Mesh, SpaceErrors
from fecloth.study.tuning.time_errors import Rule, TimeErrors

SECONDS = 1e-6  # x² n


def trial(choice, value=1.0, seconds=None, spent=0.0, **row):
    """The run of a choice with h = 1/x on a unit square, whose quantity has this value."""
    x, n = 1 / choice.h, choice.steps or 1
    seconds = SECONDS * x**2 * n if seconds is None else seconds
    known = {"status": "ok", "triangles": x**2, "steps": n, "cpu_seconds": seconds}
    return Trial(choice, known | {"case_seconds": spent, "value": value} | row, (None,))


@dataclass(frozen=True, eq=False)
class PowerLaws(Bench):
    """The quantity 1 + space/x² + in_time/n², and a list of what was run."""

    opened: object = None
    quantities: tuple = (parse_quantity("tip.z"),)
    runs: Runs = field(default_factory=Runs)
    space: float = 1.0
    in_time: float = 10.0
    change: object = None  # function (trial) -> trial

    @property
    def ran(self):
        return self.done

    def run(self, choices, timed=False):
        trials = []
        for choice in choices:
            value = 1 + self.space * choice.h**2 + self.in_time / (choice.steps or np.inf) ** 2
            made = trial(choice, value)
            trials.append(self.change(made) if self.change else made)
        self.ran.extend(trials)
        return trials

    def distance(self, a, b):
        return np.array([abs(a.row["value"] - b.row["value"])])


def predict(space, in_time, pattern=""):
    """Return errors space/x² + in_time/n² and seconds 1e-6 x² n, as measured at three sizes."""
    x, n = [10.0, 20.0, 40.0], [32.0, 64.0, 128.0]
    theory = np.array([2.0])
    trials = tuple(trial(Choice("P1", pattern, 1.0 / s, "bdf2", 64)) for s in x)
    errors = error_curve(x, [np.array([space / s**2]) for s in x], theory, 0.0)
    cost = cost_curve(x, [SECONDS * s**2 for s in x], 1, 3.2)
    mesh = Mesh(trials[0].choice, errors, cost, trials)
    steps = error_curve(n, [np.array([in_time / s**2]) for s in n], theory, 0.0)
    seconds = cost_curve(n, [1e-4 * s for s in n], 0.5, 1.0)
    rule = Rule("bdf2", "steps", steps, seconds, trials)
    times = TimeErrors((rule,), trials[0], np.zeros(1), trials)
    return Prediction((mesh,), times, trials[0])


def listed(settings):
    """Return a prediction of settings that cannot be changed: (error, seconds) by name."""
    one, nothing = np.ones(1), np.array([[1e-12]])
    run = trial(Choice("P1", "", 1.0), seconds=1.0)
    mesh = Mesh(
        Choice("P1", ""), Curve(one, nothing, 0.0, 0.0), Curve(one, one[None], 0, 0), (run,)
    )
    rules = tuple(
        Rule(
            name, "limit", Curve(one, error * one[None], 0, 0), Curve(one, s * one[None], 0, 0), ()
        )
        for name, (error, s) in settings.items()
    )
    return Prediction((mesh,), TimeErrors(rules, run, np.zeros(1), ()), run)


class Listed(PowerLaws):
    """Runs of listed settings; a verifying run has half of the error."""

    def __init__(self, settings):
        super().__init__()
        object.__setattr__(self, "settings", settings)

    def run(self, choices, timed=False):
        for choice in choices:
            error, seconds = self.settings[choice.method]
            value = 1 + error / (choice.steps or 1)
            self.ran.append(trial(replace(choice, h=1.0), value, seconds))
        return self.ran[-len(choices) :]


def candidate(prediction, x, n, space, in_time, seconds=None):
    """The setting of x and n with these predicted errors."""
    seconds = SECONDS * x**2 * n if seconds is None else seconds
    errors = np.array([space]), np.array([in_time])
    return Candidate(prediction.meshes[0], prediction.times.rules[0], x, n, *errors, seconds)


def known_run(prediction, x, error, n=10_000):
    """What is known of the error in space: the best run has this x, and this error of its own."""
    choice = replace(prediction.meshes[0].choice, h=1 / x, steps=n)
    best = trial(choice, 1 + 1 / x**2)
    return SpaceErrors(prediction.meshes, best, np.array([error]))
