"""The threads of a system: which share a loop, how many, and how they fail."""

import copy
import pickle
import threading

import numpy as np
import pytest
from support.tiers import stories_except

import fecloth as fc
from fecloth.compiled.jit import kernel
from fecloth.compiled.team import (
    Mode,
    Team,
    number_of_threads,
)
from fecloth.compiled.threads import Member, members, part_of, wait
from fecloth.terms.loops.shared_loop import SharedLoop, divide

ONE, ALL = Mode.ONE, Mode.ALL


def test_a_system_and_its_copies_know_the_number():
    cloth = fc.Cloth.rectangle(1.0, 1.0, h=0.5, pattern="right")
    system = fc.System(cloth, fc.Fabric(0.2, 1000.0), [fc.StVK()], threads=3)
    assert system.team.count == system.bound[0].panel.team.count == 3
    assert copy.copy(system).threads == pickle.loads(pickle.dumps(system.team)).count == 3
    with system.team.pinned():
        assert system.team.count == 1
    assert system.team.count == 3


def test_auto_means_all_that_numba_may_start(monkeypatch):
    monkeypatch.setattr("numba.config.NUMBA_NUM_THREADS", 5)
    assert number_of_threads("auto") == Team("auto").count == 5


@kernel
def sum_up(values, member, rounds):
    """In each round every thread adds up what all have written in the round before."""
    own = float(member.thread + 1)
    for _ in range(rounds):
        values[member.thread] = own
        wait(member)
        own = 0.0
        for value in values:
            own += 0.5 * value
        wait(member)
    return own


def sum_on(team, rounds):
    """The result of `sum_up` on all threads of a team."""
    values, all_ = np.zeros(team.count), members(team.count)
    return team.run(lambda p: sum_up(values, all_[p], rounds), all_[0].meeting)


@pytest.mark.parametrize("threads", [1, 2, 3, 5])
def test_threads_that_wait_see_what_the_others_wrote(threads):
    expected = 0.5 * threads * (threads + 1) / 2 * (0.5 * threads) ** 49
    assert sum_on(Team(threads), 50) == pytest.approx(expected)


@pytest.mark.parametrize("failing", [0, 1])
def test_an_error_in_a_thread_is_raised_and_nobody_waits_for_it(failing):
    values, all_ = np.zeros(2), members(2)

    def part(p):
        if p == failing:
            raise ValueError(f"thread {p}")
        return sum_up(values, all_[p], 10)

    team = Team(2)
    with pytest.raises(ValueError, match=f"thread {failing}"):
        team.run(part, all_[0].meeting)
    assert team.run(lambda p: p) == 0  # the workers are as before


def test_two_python_threads_take_turns():
    team, sums = Team(3), []

    def go():
        sums.extend(sum_on(team, 10) for _ in range(20))

    callers = [threading.Thread(target=go) for _ in range(3)]
    for caller in callers:
        caller.start()
    for caller in callers:
        caller.join(60)
    assert len(sums) == 60
    assert len(set(sums)) == 1


# --- how elements are divided ---------------------------------------------------------------------


def band(m, width):
    return np.arange(m)[:, None] + np.arange(width)


STENCILS = {
    "band": band(3000, 3),
    "two kinds": np.concatenate([band(2000, 2), band(2000, 2)]),
    "held in space": np.where(band(3000, 4) % 50 == 7, -1, band(3000, 4)),
    "three far nodes": np.hstack([band(3000, 2), 4000 + band(3000, 1)]),
}


@pytest.mark.parametrize("count", stories_except([2, 3, 8], 3))
@pytest.mark.parametrize("name", stories_except(STENCILS, "held in space", "three far nodes"))
def test_every_element_of_a_node_is_computed_by_its_owner_in_order(name, count):
    nodes = STENCILS[name]
    parts = divide(nodes, count)
    owners = {}
    for p, pieces in enumerate(parts):
        spans = [(piece.span.start, piece.span.stop) for piece in pieces]
        assert spans == sorted(spans)
        for piece in pieces:
            here = nodes[piece.span]
            for node in np.unique(here[here >= 0]) if piece.nodes is None else piece.nodes:
                owners.setdefault(int(node), set()).add(p)
    assert all(len(owner) == 1 for owner in owners.values())
    done = {
        p: np.concatenate([np.arange(q.span.start, q.span.stop) for q in pieces])
        for p, pieces in enumerate(parts)
    }
    for node, (p,) in owners.items():
        assert set(np.flatnonzero((nodes == node).any(axis=1))) <= set(done[p].tolist())
    assert set(owners) == set(nodes[nodes >= 0].tolist())


def test_elements_without_an_order_are_done_by_one_thread(rng):
    nodes = rng.integers(0, 3000, (3000, 3))
    assert divide(nodes, 2) is None
    assert SharedLoop(Team(2), nodes).parts is None


# --- auto -----------------------------------------------------------------------------------------


class Clock:
    """A clock that a call moves on."""

    def __init__(self):
        self.now = 0.0

    def __call__(self):
        return self.now


def march(team, clock, on_one, all_, calls, start=0):
    """Make calls that take one(i) or all_(i) seconds; return the seconds of all."""
    begin = clock.now

    def call(seconds):
        clock.now += seconds

    for i in range(start, start + calls):
        team.do("loop", lambda i=i: call(on_one(i)), lambda i=i: call(all_(i)))
    return clock.now - begin


@pytest.fixture
def auto(monkeypatch):
    monkeypatch.setattr("numba.config.NUMBA_NUM_THREADS", 2)
    clock = Clock()
    return Team("auto", clock), clock


@pytest.mark.parametrize("ratio", [0.3, 0.5, 0.7, 0.9])
def test_all_threads_are_taken_where_they_are_faster(auto, ratio):
    team, clock = auto
    assert march(team, clock, lambda i: 1.0, lambda i: ratio, 400) < (ratio + 0.06) * 400
    assert team.used == 2


IDLE, SLOWER, TAKEN = 0.5, 1.5, 20.0  # time on all threads over the time on one
MACHINES = {  # in the first half of the run and in the second
    "idle": (IDLE, IDLE),
    "a little slower": (SLOWER, SLOWER),
    "a core is taken": (TAKEN, TAKEN),
    "a core becomes busy": (IDLE, TAKEN),
    "a core becomes free": (TAKEN, IDLE),
}


@pytest.mark.parametrize("seconds", stories_except([1e-3, 1e-2], 1e-2))
@pytest.mark.parametrize("machine", MACHINES)
def test_auto_takes_little_more_than_the_better_of_one_and_all(auto, machine, seconds):
    (team, clock), calls, total = auto, round(30 / seconds), 0.0
    for part, ratio in enumerate(MACHINES[machine]):
        times = (lambda i: seconds), (lambda i, ratio=ratio: ratio * seconds)
        march(team, clock, *times, calls, part * calls)
        total += min(1.0, ratio) * calls * seconds
    assert clock.now < 1.15 * total


@pytest.mark.parametrize("bad", [3, 5, 7])
def test_one_trial_that_is_interrupted_decides_nothing(auto, bad):
    team, clock = auto
    march(team, clock, lambda i: 1.0, lambda i: 10.0 if i == bad else 0.5, 8)
    assert [choice.best for choice in team.choices.values()] == [ALL]


def test_one_thread_does_all_where_there_is_only_one(monkeypatch):
    monkeypatch.setattr("numba.config.NUMBA_NUM_THREADS", 1)
    team = Team("auto")
    assert not team.shares(10**6)
    assert team.words(10**6) == "one thread"
    assert team.do("loop", lambda: "alone", lambda: "together") == "alone"


def test_the_parts_of_threads_follow_each_other_and_are_all():
    team = [Member(p, 3, np.zeros(1), np.zeros(1)) for p in range(3)]
    parts = [part_of(member, 10, 21) for member in team]
    assert parts[0][0] == 10
    assert parts[-1][1] == 21
    assert [end for _, end in parts[:-1]] == [begin for begin, _ in parts[1:]]
    assert max(end - begin for begin, end in parts) <= 4
