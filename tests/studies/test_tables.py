"""Findings of the studies of convergence and stability, from rows with known numbers."""

from studies.stability.__main__ import conclude_maps, conclude_swing


def cell(dt, outcome, **more):
    row = {"map": "courant, h", "method": "central_difference", "predicted": 1e-3, "status": "ok"}
    return row | {"dt": dt, "outcome": outcome} | more


def test_runs_that_contradict_the_predicted_limit_are_counted():
    good = [cell(0.7e-3, "ok"), cell(0.7e-3, "wrong"), cell(1.4e-3, "failed")]
    close = [cell(1.05e-3, "ok"), cell(0.95e-3, "failed")]
    (found,) = conclude_maps([*good, *close])
    assert (found.value, found.is_met) == (0, True)
    assert found.what.startswith("of 3 explicit runs on courant")
    others = [cell(2e-3, "ok", map="fold, h"), cell(2e-3, "ok", method="bdf2")]
    late = cell(2e-3, "time limit", status="time limit")
    bad = [cell(2e-3, "ok"), cell(2e-3, "wrong"), cell(0.5e-3, "failed")]
    (found,) = conclude_maps([*good, *others, late, *bad])
    assert (found.value, found.is_met) == (3, False)


def swing_cell(method, made, cause="", Y=1e4, steps=64):
    more = {"fabric.tensile_stiffness": Y, "steps": steps, "energy made": made, "cause": cause}
    return cell(0.0109, "", map="stiff_swing, stiffness", method=method) | more


def test_a_run_that_was_stopped_for_its_energy_made_some():
    stopped = "StepFailed: it moves: the method has made the rest"
    rows = [
        swing_cell("newmark", None, stopped),
        swing_cell("newmark", 0.01),
        swing_cell("bdf2", 0.01),
        swing_cell("bdf2", None, "Newton did not converge"),
        swing_cell("linearly_implicit_euler", 9.0),
        swing_cell("bdf2", 9.0, Y=1e5),
        swing_cell("bdf2", 9.0, steps=32),
        swing_cell("central_difference", 0.0),
    ]
    findings = conclude_swing(rows)
    assert findings[0].value == 4  # methods that were run
    met = [finding.is_met for finding in findings]
    assert met == [True, True, False, True, False, True]
    assert [finding.is_met for finding in conclude_swing(rows[:1])] == [False, True]
