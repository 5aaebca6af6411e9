"""studies/choose.py on made-up tables: what they support is printed, what they do not is told."""

import csv
import doctest
import re
import subprocess
import sys
from pathlib import Path

import choose
import choose_tables
import pytest
from choose import RULES, judged, left_out, page, short
from choose_tables import Tables
from harness.reports import markdown

STUDIES = Path(choose.__file__).parent
SPREAD = "stretch: spread over patterns"
MADE = "on the stiff swing at 9.7 ms: energy made of what moved"
STEADY = "Largest dt [s] that is stable and right, with all smaller ones"
CELLS = "of 173 explicit cells on courant and sliver, against what was foretold"
SPACE, SOLVED = "Space and model, at fine steps", "Linear solvers, CPU seconds"


def rows_of(columns, *rows):
    return [dict(zip(columns.split(", "), row, strict=True)) for row in rows]


def limits(*rows):
    return rows_of("model, pattern, over StVK's limit", *rows)


def simpler(*rows):
    return rows_of("variant, change, saved", *rows)


def numbers(value):
    return rows_of("number, value", ("gravity / bending stiffness", value))


def reports():
    """Study to findings and tables: all that the rules read, with numbers that support them."""
    law = (("NeoHookean", "unstructured", 0.97), ("StVK", "unstructured", 1.0))
    soft = ("BaraffWitkin p = 1/2", "unstructured", 0.85)
    return {
        "models": {
            f"StVK, {SPREAD}": 0.00125,
            f"Springs structural, {SPREAD}": 0.2461,
            "BaraffWitkin as published, shear: goes with h to the power": 2.0,
            "biquadratic springs from StVK, all scenes, relative": 8e-15,
            "stretch: force [N]": limits(law[0], ("NeoHookean", "unstructured", 0.8), soft),
            "drape: sag [m]": limits(*law),
            "swing: mean depth [m]": limits(("NeoHookean", "right", 0.9997)),
            "Stiffness against the direction of a pull": rows_of(
                "model, pattern, highest / lowest", ("Springs van_gelder", "right", 4.0)
            ),
            "Cost": rows_of(
                "model, over StVK",
                ("StVK", 9.0),  # of a coarser mesh
                ("StVK", 1.0),
                ("Springs structural", 1.06),
                ("Springs biquadratic", 1.32),
            ),
            "Bending": rows_of("scene, model, change by bending", ("drape", "StVK", -0.0002314)),
            "Bending carried by hinges": rows_of(
                "pattern, along, value",
                ("right", 40, 0.5),
                ("right", 80, 0.83),
                ("cross", 80, 1.11),
                ("equilateral", 80, 0.93),
                ("unstructured", 80, 0.94),
            ),
        },
        "needs/cantilever": {
            "Numbers": numbers(10.37),
            "One thing simpler": simpler(
                ("equilibrium", 5e-5, 0.7),
                ("without HingeBending", 0.77, -3.9),
                ("QuadraticBending for hinges", 0.00143, 0.15),
            ),
        },
        "needs/taut": {
            "Numbers": numbers(1.962e5),
            "One thing simpler": simpler(
                ("without HingeBending", 7e-5, 0.5), ("QuadraticBending for hinges", 2e-7, 0.44)
            ),
        },
        "needs/wind": {
            "Numbers": numbers(6e5),
            "One thing simpler": simpler(("without QuadraticBending", 2e-6, 0.2)),
        },
        "convergence": {
            "swing, none, cross: order of L2": 1.35,
            "swing, HingeBending, cross: order of L2": 2.0,
            "swing, QuadraticBending, cross: order of L2": 2.0,
            "static, P1, unstructured: order of L2": 2.0,
            "static, P2, unstructured: order of L2": 3.0,
        },
        "stability": {
            f"implicit_midpoint {MADE}": float("inf"),
            f"energy_momentum {MADE}": 3e-6,
            "central_difference: measured limit from that foretold, relative": 0.008,
            CELLS: 0,
            STEADY: rows_of(
                "scene, implicit_midpoint, energy_momentum, linearly_implicit_euler, bdf2",
                ("stiff_swing", 0.0055, 0.011, 0.0027, 0.044),
            ),
        },
        "speed_accuracy": {
            SPACE: rows_of(
                "scene, model, model [%], all [%], beside it [%]",
                ("trampoline", "NeoHookean", 14.1, 14.1, 19.7),
                ("swing", "StVK", 3.75, 3.75, 22.2),
            ),
            SOLVED: rows_of(
                "scene, h, dt [ms], direct [s], pcg [s]",
                ("trampoline", 0.025, 10, 0.4, 0.2),
                ("trampoline", 0.025, 1.25, 0.8, 0.8),
                ("swing", 0.01, 10, 0.17, 0.45),
            ),
        },
    }


RUNS = [  # scene, method, element, step, seconds, error
    ("trampoline", "many_steps", "P1", 4e-4, 0.0102, 0.0057),
    ("trampoline", "many_steps", "P1", 1e-4, 0.26, 0.0009),
    ("trampoline", "ImplicitMidpoint", "P1", 2.5e-3, 0.088, 0.0085),
    ("trampoline", "ImplicitMidpoint", "P2", 5e-3, 0.18, 0.005),
    ("trampoline", "BackwardEuler", "P1", 1e-3, 0.01, 0.06),
    ("trampoline", "Auto", "P1", 1e-3, 0.22, 0.006),
    ("wave", "many_steps", "P1", 4e-4, 0.002, 0.009),
    ("wave", "GeneralizedAlpha", "P1", 6e-4, 0.097, 0.009),
    ("swing", "ImplicitMidpoint", "P1", 0.01, 0.037, 0.0085),
    ("swing", "GeneralizedAlpha", "P1", 0.02, 0.031, 0.018),
    ("swing", "CentralDifference", "P1", 4.5e-5, 0.27, 0.0058),
    ("swing", "BackwardEuler", "P1", 0.02, 0.034, 0.043),
    ("swing", "Auto", "P1", 0.01, 0.23, 0.005),
    ("trampoline", "Adaptive GeneralizedAlpha", "P1", 0.01, 0.09, 0.0104),
    ("swing", "Adaptive GeneralizedAlpha", "P1", 0.01, 0.24, 0.0049),
    ("wave", "Adaptive GeneralizedAlpha", "P1", 0.001, 0.027, 0.3),
    ("stretch", "equilibrium", "P2", "", 0.0058, 0.007),
    ("stretch", "equilibrium", "P2", "", 0.22, 0.0002),
    ("stretch", "equilibrium", "P1", "", 0.0085, 0.008),
    ("stretch", "BackwardEuler", "P1", 0.25, 0.0079, 0.008),
]
PRINTED = {
    "auto": "  auto took BDF2, 0.1 s to choose: 1.05 of the best\n"
    "  auto took BDF2, 0.1 s to choose: 1.43 of the best\nauto over the best: at most 1.43 (x)\n",
    "solvers": "auto over the best: at most 1.31 (trampoline, 4 ms), limit 1.5: met\n",
    "costs": "TensionField      18.4    1.56     95.1    1.16\n",
    "bending_bias": "0.25  right   0.7  0.8\n2.0   right   0.5  0.92\n2.0   cross   0.5  1.29\n"
    "2.0   equilateral   0.5  0.99\n2.0   unstructured  0.5  0.98\n",
}


def written(folder, reports, runs=RUNS, printed=PRINTED, quick=False):
    """The folder with all that the studies would have written there."""
    for study, parts in reports.items():
        lines = [f"- {k}: {v:.4g} >= 0: met" for k, v in parts.items() if not isinstance(v, list)]
        tables = [f"## {k}\n\n{markdown(v)}" for k, v in parts.items() if isinstance(v, list)]
        path = folder / study / "report.md"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("\n\n".join([*lines, *tables, f"- quick: {quick}\n"]))
    names = ("scene", "method", "element", "step", "seconds", "total_error")
    names += ("time_error", "model", "status")
    with (folder / "speed_accuracy" / "results.csv").open("w", newline="") as stream:
        table = csv.writer(stream)
        table.writerow(names)
        for run in runs:
            table.writerow(
                [*run, 0.5 * run[-1], "StVK + hinges" if run[0] == "swing" else "StVK", "ok"]
            )
    for study, text in printed.items():
        (folder / f"{study}.txt").write_text(text)
    return Tables(folder, quick)


def asked(tables):
    """The page, and what is told beside it."""
    verdicts = [judged(rule, tables) for rule in RULES]
    return page(verdicts), "\n".join(left_out(RULES, verdicts))


def test_supported_statements_are_printed_with_their_numbers(tmp_path):
    text, told = asked(written(tmp_path, reports()))
    assert told == ""
    assert text.count("\n| ") == 1 + len(RULES)
    for said in (
        "four patterns pull alike to 0.125 %; structural springs differ by 25 %",
        "takes them 1.06 to 1.32 times as long",
        "a strip of `NeoHookean` pulls with 0.8, of `BaraffWitkin` with 0.85 of",
        "| ρ g L³/B of 10.4 to 21:",
        "costs 4.9 times as much",
        "at 1.96 · 10⁵ a taut square by 0.007 %",
        "over 0.94 for strips a quarter as wide as long, over 0.98 to 0.99 for a cloth twice",
        "hinges carry 0.83 of B on `right`",
        "on the wide cloth 0.92, 1.29, 0.99, 0.98, however",
        "a falling disk to 1 % in 0.0102 s, implicitly in 8.6 times that, on P2 in 17.6",
        "in 0.037 s, with dt = 10 ms; explicitly in 7.3 times that",
        "to 44 ms, `EnergyMomentum` to 11 ms",
        "to 0.8 %, and 0 of 173 runs contradict them",
        "off by 0.52 % in time on the disk, 0.24 % on the paper; "
        "but a wave of 10⁻⁴ of its strip even at 1e-3 by 15 %",
        "on 2 of 2 scenes at most 1.5 times",
        "on the worst 1.43 times; to 1 % of the disk 22 times",
        'at most 1.31 times as long as the best on seven scenes; `"direct"` takes 2 times',
        "takes the cheapest march to 1 % 1.36 times as long",
        "its force costs 1.6 times `StVK`'s, its tangent 1.2",
    ):
        assert said in text


def test_another_number_is_printed(tmp_path):
    made = reports()
    made["models"]["Cost"][-1]["over StVK"] = 1.57
    runs = [r if r[0] != "wave" or r[4] != 0.097 else (*r[:4], 0.02, r[5]) for r in RUNS]
    text, told = asked(written(tmp_path, made, runs))
    assert told == ""
    assert "takes them 1.06 to 1.57 times as long" in text
    assert "a wave implicitly in 10;" in text


def changed(study, heading, *place, value):
    """The made-up reports with one number changed."""
    made = reports()
    if place:
        index, column = place
        made[study][heading][index][column] = value
    else:
        made[study][heading] = value
    return made


DENIED = [  # what is changed to what, and the row that it denies
    (("models", f"StVK, {SPREAD}"), 0.1, "a fabric's Y, ν and G"),
    (("models", "Cost", 2, "over StVK"), 0.6, "springs in mind"),
    (("models", "drape: sag [m]", 0, "over StVK's limit"), 0.6, "swings, hardly stretched"),
    (("models", "stretch: force [N]", 1, "over StVK's limit"), 0.99, "stretches of a tenth"),
    (("needs/cantilever", "One thing simpler", 1, "change"), 0.001, "a strip that bends"),
    (("needs/taut", "One thing simpler", 0, "change"), 0.2, "| no bending |"),
    (("models", "Bending", 0, "change by bending"), 0.05, "| no bending |"),
    (("needs/cantilever", "One thing simpler", 2, "change"), 0.1, "`QuadraticBending`"),
    (("models", "Bending carried by hinges", 1, "value"), 1.0, "a measured bending rigidity"),
    (("convergence", "static, P2, unstructured: order of L2"), 2.0, 'element = "P2"'),
    (("needs/cantilever", "One thing simpler", 0, "saved"), -0.2, "only the end"),
    (("stability", STEADY, 0, "bdf2"), 0.005, "`BDF2`"),
    (("stability", f"implicit_midpoint {MADE}"), 0.0, "`BDF2`"),
    (("stability", CELLS), 3, "no dt in mind"),
    (("speed_accuracy", SOLVED, 2, "pcg [s]"), 0.1, 'linear = "auto"'),
    (("models", f"StVK, {SPREAD}"), float("nan"), "a fabric's Y, ν and G"),
]


@pytest.mark.parametrize(("place", "value", "row"), DENIED)
def test_a_denied_statement_is_told_and_not_printed(tmp_path, place, value, row):
    text, told = asked(written(tmp_path, changed(*place, value=value)))
    assert told.startswith("no longer supported")
    assert row.strip("| ") in told
    assert "MISSED" in told
    assert told.count("no longer") == 1
    assert row not in text.split("*`python")[0]
    assert text.count("\n| ") == len(RULES)


@pytest.mark.parametrize(
    ("run", "row"),
    [
        (("trampoline", "GeneralizedAlpha", "P1", 0.01, 0.005, 0.001), "membrane as soft as"),
        (("swing", "CentralDifference", "P1", 1e-4, 0.04, 0.009), "as stiff as paper"),
        (("swing", "BDF2", "P1", 0.01, 0.02, 0.009), "as stiff as paper"),
        (("wave", "LinearlyImplicitEuler", "P1", 1e-3, 0.5, 0.009), "`BackwardEuler` or"),
        (("stretch", "equilibrium", "P1", "", 0.1, 0.0009), 'element = "P2"'),
        (("stretch", "BDF2", "P1", 0.25, 0.001, 0.009), "only the end"),
    ],
)
def test_a_run_that_is_better_denies_the_advice(tmp_path, run, row):
    text, told = asked(written(tmp_path, reports(), [*RUNS, run]))
    assert f"no longer supported by {'needs, ' if 'end' in row else ''}speed_accuracy" in told
    assert row in told
    assert row not in text.split("*`python")[0]


def test_auto_and_solvers_by_what_they_print(tmp_path):
    slow = PRINTED["auto"].replace("1.05", "17").replace("1.43 of", "1.6 of")
    printed = PRINTED | {"auto": slow, "solvers": PRINTED["solvers"].replace("1.31", "1.7")}
    text, told = asked(written(tmp_path, reports(), printed=printed))
    assert "`Auto(rtol)`" in told
    assert "close: 0 in" in told
    assert "auto: 1.7 in" in told
    assert "`Auto(rtol)`" not in text


def test_missing_tables_are_told_with_their_command(tmp_path):
    text, told = asked(Tables(tmp_path / "nowhere"))
    assert text.count("\n| ") == 1
    for study in ("models", "speed_accuracy", "needs", "stability"):
        assert f"python studies/{study}.py --out {tmp_path / 'nowhere' / study}" in told
    assert f"python studies/auto.py > {tmp_path / 'nowhere' / 'auto'}.txt" in told
    assert all(rule.take.split("{")[0] in told for rule in RULES)


def test_quick_tables_count_only_if_asked_for(tmp_path):
    quick = written(tmp_path, reports(), quick=True)
    assert asked(quick)[1] == ""
    text, told = asked(Tables(tmp_path))
    assert "models/report.md is of a quick form" in told
    assert "`StVK`, on any mesh" not in text


def test_command_line(tmp_path):
    def run(*more):
        command = [sys.executable, STUDIES / "choose.py", "--tables", tmp_path / "t", *more]
        command += ["--out", tmp_path / "page"]
        return subprocess.run(command, capture_output=True, text=True, timeout=60)

    written(tmp_path / "t", changed("stability", STEADY, 0, "bdf2", value=0.005))
    done = run()
    assert done.returncode == 1, done.stderr
    assert "no longer supported by stability" in done.stdout
    assert (tmp_path / "page" / "choose.md").read_text() in done.stdout
    assert (tmp_path / "page" / "choose.png").stat().st_size > 10_000
    written(tmp_path / "t", changed("stability", STEADY, 0, "bdf2", value=0.005), quick=True)
    done = run("--quick")
    assert done.returncode == 0, done.stderr
    assert "not shown by the quick forms of stability" in done.stdout
    assert "`StVK`, on any mesh" in done.stdout


@pytest.mark.parametrize("module", [choose, choose_tables])
def test_examples(module):
    assert doctest.testmod(module).failed == 0


def test_numbers_are_short():
    assert [short(v) for v in (0.0, 100.0, 999.0, 0.5, 123456.0)] == [
        "0",
        "100",
        "1000",
        "0.5",
        "1.23 · 10⁵",
    ]


def test_the_readme_says_what_the_rules_say():
    """Every row of the README's section is one of the rules', whatever its numbers."""
    _, _, section = (STUDIES.parent / "README.md").read_text().partition(choose.TITLE + "\n")
    if not section:
        pytest.skip("the README has no such section")
    section = section.partition("\n## ")[0]
    rows = re.findall(r"^\| (?!you have).*", section, re.MULTILINE)
    words = [f"| {r.have} | {r.take} | {r.because} ({r.studies}) |" for r in RULES]
    number = r"[-\\d.e+]+( · 10[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)?"
    forms = [re.sub(r"\\{\w+\\}", number, re.escape(line)) for line in words]
    assert rows
    assert [row for row in rows if not any(re.fullmatch(form, row) for form in forms)] == []
    told = " ".join(section.split())
    for part in (choose.HEAD, choose.FOOT, choose.OPEN):
        assert " ".join(part.split()) in told
