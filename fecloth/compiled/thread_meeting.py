"""Threads of a loop that wait for each other, and who waits for a thread to begin or to end.

Loops that iterate, as conjugate gradients and explicit steps do, keep their threads from begin to
end. The threads wait for each other by `meet`: a thread that waits gives its core to others after
a microsecond, so that on a busy machine it does not keep the core from the thread it waits for.
"""

from __future__ import annotations

import sys
from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

from fecloth.compiled.jit import Array, inner, kernel

SPIN = 256  # looks at the counter before a waiting thread gives its core to others
ATTENTIVE = 300  # times that, before a thread without work sleeps
GIVE_UP = 2**62  # the counter when a thread has failed: nobody waits any longer


def _add_one(typing: Any, counter: Any) -> Any:
    """Add 1 to counter[0] in one operation."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array = context.make_array(signature.args[0])(context, builder, arguments[0])
        return builder.atomic_rmw("add", array.data, ir.Constant(ir.IntType(64), 1), "seq_cst")

    return types.int64(counter), generate


def _look_at(typing: Any, counter: Any) -> Any:
    """Read counter[0] as other threads have written it."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array = context.make_array(signature.args[0])(context, builder, arguments[0])
        return builder.load_atomic(array.data, "acquire", 8)

    return types.int64(counter), generate


_arrive: Any = intrinsic(_add_one)
_look: Any = intrinsic(_look_at)
_yield_name = "SwitchToThread" if sys.platform == "win32" else "sched_yield"
_give_core: Any = types.ExternalFunction(_yield_name, types.int32())


@inner
def meet(meeting: Array, threads: int, round_: int) -> int:
    """Wait until all threads have come to this round, from 1 on; return the next round.

    `meeting` is an array of one int64, zero before the first round. What a thread wrote before is
    seen by the others afterwards.
    """
    if threads > 1:
        _arrive(meeting)
        looks = 0
        while _look(meeting) < threads * round_:
            looks += 1
            if looks % SPIN == 0:
                _give_core()
    return round_ + 1


class Member(NamedTuple):
    """One of the threads that share a loop, for kernels.

    Attributes
    ----------
    thread, threads
        Number of this thread, from 0 on, and of all.
    meeting, round_
        (1,) int64 for `meet`: the counter of all threads, and the round of this one.
    """

    thread: int
    threads: int
    meeting: np.ndarray
    round_: np.ndarray


def members(threads: int) -> list[Member]:
    """Return the threads of a loop, before they meet for the first time."""
    meeting = np.zeros(1, np.int64)
    return [Member(p, threads, meeting, np.ones(1, np.int64)) for p in range(threads)]


ONLY = members(1)[0]  # a thread that shares its loop with none


@inner
def wait(member: Member) -> None:
    """Wait until all threads have come here."""
    member.round_[0] = meet(member.meeting, member.threads, member.round_[0])


@kernel
def wait_for_all(member: Member) -> None:
    """As `wait`, for Python."""
    wait(member)


@inner
def part_of(member: Member, begin: int, end: int) -> tuple[int, int]:
    """Return the begin and the end of a thread's part of the numbers begin … end − 1."""
    size, p, threads = end - begin, member.thread, member.threads
    return begin + size * p // threads, begin + size * (p + 1) // threads


@kernel
def meet_again(meeting: Array, threads: int, round_: Array) -> None:
    """As `meet`, for an array with the round of this thread."""
    round_[0] = meet(meeting, threads, round_[0])


@kernel
def attend(counter: Array, known: int) -> None:
    """Return when the counter is no longer the known number, or after 0.1 ms."""
    for look in range(ATTENTIVE * SPIN):
        if _look(counter) != known:
            return
        if look % SPIN == SPIN - 1:
            _give_core()
