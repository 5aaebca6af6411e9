"""A user's own account appears in the result, the tables, the log, the warnings and the restart."""

import json
import os
import signal
from dataclasses import dataclass, replace

import numpy as np
import pytest
from support.rundirs import rows_of, written

import fecloth as fc
from fecloth.runs import restart
from fecloth.runs.outcome import list_details
from fecloth.simulation import run as runs
from fecloth.simulation.account import Account, Accounts, End, Run
from fecloth.simulation.energy_ledger import Ledger
from fecloth.terms.records import remembered

SCENE = """
fabric = {areal_density = 0.2, tensile_stiffness = 1000.0}
terms = [{type = "StVK"}, {type = "Gravity"}]
pins = [{where = "left"}]
output = {restart_steps = 2}
[cloth]
shape = "rectangle"
width = 1.0
height = 0.5
h = 0.25
[time]
method = "implicit_midpoint"
dt = 0.01
t_end = 0.1
"""


@remembered
@dataclass(frozen=True)
class Fastest(Account):
    """The greatest kinetic energy, and a doubt about more than 1 mJ."""

    name = "fastest"
    kinetic: float = 0.0
    ended: bool = False

    def follow(self, run, info, others):
        return replace(self, kinetic=max(self.kinetic, others[Ledger].kinetic))

    def finish(self, run, end, others):
        return replace(self, ended=True)

    def row(self):
        return {"fastest": self.kinetic}

    def doubts(self):
        words = f"the cloth has {1e3 * self.kinetic:.3g} mJ"
        return [fc.Doubt(fc.DoubtKind.OTHER, words)] if self.kinetic > 1e-3 else []

    def words(self):
        return f"at most {self.kinetic:.3g} J" if self.ended else ""

    def summary(self):
        return {"most_kinetic": self.kinetic}


@pytest.fixture
def scene(tmp_path, monkeypatch):
    monkeypatch.setattr(runs, "IN_TIME", (*runs.IN_TIME, Fastest))
    (tmp_path / "sheet.toml").write_text(SCENE)
    return fc.load_scene(tmp_path / "sheet.toml")


def test_it_is_in_the_result_of_run(scene):
    problem = scene.build()
    with pytest.warns(fc.FeclothWarning, match="the cloth has .* mJ"):
        result = fc.run(problem.system, problem.method, problem.start, problem.dt, 0.1)
    kinetic = result.energies["kinetic"]
    assert np.array_equal(result.observed["fastest"], np.maximum.accumulate(kinetic))
    assert result.figures["most_kinetic"] == kinetic.max() == result.accounts[Fastest].kinetic
    assert [words.startswith("the cloth has") for words in result.warnings].count(True) == 1


def test_it_is_in_all_files_of_a_run(scene, tmp_path):
    warned = []
    outcome = fc.run_scene(scene, tmp_path / "out", warn=warned.append)
    summary = json.loads((tmp_path / "out/summary.json").read_text())
    most = max(float(row["kinetic"]) for row in rows_of(tmp_path / "out/energies.csv"))
    assert summary["most_kinetic"] == most == outcome.figures["most_kinetic"]
    assert float(rows_of(tmp_path / "out/observed.csv")[-1]["fastest"]) == most
    assert sum("the cloth has" in words for words in summary["warnings"]) == 1
    log = (tmp_path / "out/run.log").read_text()
    assert f"at most {most:.3g} J\n" in log
    assert log.count("warning: the cloth has") == 1
    assert any(
        line.endswith(f"at most {most:.3g} J") for line in list_details(outcome.accounts, summary)
    )
    assert [str(doubt) for doubt in warned] == list(outcome.warnings)


def test_it_survives_a_restart(scene, tmp_path):
    def stop(info):
        if info.step == 4:
            os.kill(os.getpid(), signal.SIGINT)

    fc.run_scene(scene, tmp_path / "whole")
    outcome = fc.run_scene(scene, tmp_path / "broken", report=stop)
    kept = restart.find(tmp_path / "broken").progress.accounts[Fastest]
    assert (kept.kinetic, kept.ended) == (outcome.figures["most_kinetic"], False)
    outcome = fc.run_scene(scene, tmp_path / "broken", resume=True)
    assert sum("the cloth has" in words for words in outcome.warnings) == 1
    assert written(tmp_path / "broken") == written(tmp_path / "whole")


def test_a_restart_file_of_an_older_format_is_refused_with_words(scene, tmp_path, monkeypatch):
    with monkeypatch.context() as patch:
        patch.setattr(restart, "FORMAT", 8)
        fc.run_scene(scene, tmp_path / "out")
    said = f"has format 8, and this fecloth reads {restart.FORMAT}; the fecloth"
    with pytest.raises(fc.InputError, match=said):
        fc.run_scene(scene, tmp_path / "out", resume=True)


def test_accounts_read_those_before_them_after_the_same_step():
    @remembered
    @dataclass(frozen=True)
    class Doubled(Fastest):
        name = "doubled"

        def finish(self, run, end, others):
            return replace(self, kinetic=2 * others[Fastest].kinetic)

    accounts = Accounts({"fastest": Fastest(3.0), "doubled": Doubled()})
    done = accounts.finish(Run(None, None, None, 0, 4.0, 1.0), End(None, 1))
    assert done[Doubled].kinetic == 6.0
    assert list(done.records) == ["fastest", "doubled"]
    assert accounts[Doubled].kinetic == 0.0
    assert accounts.get(Ledger) is None


def test_only_the_first_doubt_of_a_kind_is_new():
    accounts = Accounts({"fastest": Fastest(0.5)})
    (first,) = accounts.new_doubts([])
    assert first == fc.Doubt(fc.DoubtKind.OTHER, "the cloth has 500 mJ")
    assert accounts.new_doubts([first]) == []
    assert accounts.new_doubts([fc.Doubt(fc.DoubtKind.TIME, first.words)]) == [first]
