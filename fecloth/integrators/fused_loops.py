"""The compiled loop over steps of central differences, and its passes over the nodes.

Each rounds its operations one by one, as those of `explicit` do.
"""

from __future__ import annotations

from fecloth.compiled.calls import call
from fecloth.compiled.jit import Array, rounded_kernel
from fecloth.compiled.thread_meeting import meet

STOP = 8  # place in the row of a thread, on another line of the cache than its round


@rounded_kernel
def copy(a: Array, b: Array) -> None:
    """b (n, 3) = a."""
    a, b = a.reshape(-1), b.reshape(-1)
    for i in range(len(a)):
        b[i] = a[i]


@rounded_kernel
def drift(x: Array, v: Array, a: Array, dt: float, ahead: Array, f: Array) -> None:
    """As `explicit.move` with a share of ½, in place; f = 0."""
    x, v, a = x.reshape(-1), v.reshape(-1), a.reshape(-1)
    ahead, f = ahead.reshape(-1), f.reshape(-1)
    for i in range(len(x)):
        dv = dt * a[i]
        x[i] += dt * (v[i] + 0.5 * dv)
        ahead[i] = v[i] + dv
    for i in range(len(f)):  # by itself: the compiler vectorises loops over few arrays
        f[i] = 0.0


@rounded_kernel
def turn(f: Array, inverse_mass: Array, dt: float, v: Array, a: Array) -> None:
    """As `explicit.divide` and `explicit.kick`, in place: the new a takes the place of the old."""
    f, v, a = f.reshape(-1), v.reshape(-1), a.reshape(-1)
    for i in range(len(f)):
        b = f[i] * inverse_mass[i]
        v[i] += 0.5 * dt * (a[i] + b)
        a[i] = b


@rounded_kernel
def set_rows(at: Array, P: Array, target: Array, y: Array) -> None:
    """As `constraints._set_held`, with a row of `target` for each of the nodes `at`."""
    for n in range(len(at)):
        i = at[n]
        d1, d2, d3 = y[i, 0] - target[n, 0], y[i, 1] - target[n, 1], y[i, 2] - target[n, 2]
        for k in range(3):
            y[i, k] = target[n, k] + (P[n, k, 0] * d1 + P[n, k, 1] * d2 + P[n, k, 2] * d3)


@rounded_kernel
def pin_work(
    at: Array, P: Array, mass: Array, dt: float, old: Array, x: Array, v: Array, a: Array
) -> float:
    """Σ m (Δv · v̄ − ā · Δx) along held directions; `old` (3, c, 3) are x, v and a before."""
    total = 0.0
    for n in range(len(at)):
        i = at[n]
        for k in range(3):
            held_v, held_x = 0.0, 0.0
            for j in range(3):
                out = (1.0 if j == k else 0.0) - P[n, k, j]
                held_v += out * (0.5 * (v[i, j] + old[1, n, j]))
                held_x += out * (x[i, j] - old[0, n, j])
            mean = 0.5 * (a[i, k] + old[2, n, k])
            total += mass[i] * ((v[i, k] - old[1, n, k]) * held_v - mean * held_x)
    return total


@rounded_kernel
def take_steps(
    forces: int,
    before: int,
    after: int,
    look: int,
    sizes: Array,
    clock: Array,
    phase: int,
    period: int,
    stretches: Array,
    least: float,
    largest: float,
    at: Array,
    P: Array,
    path: Array,
    speed: Array,
    mass: Array,
    pins: Array,
    old: Array,
    target: Array,
    inverse_mass: Array,
    x: Array,
    v: Array,
    a: Array,
    ahead: Array,
    f: Array,
    meeting: Array,
    rounds: Array,
    thread: int,
) -> int:
    """Take the steps in place; return their number: fewer if a stretch is beyond its limits.

    Each thread calls it with its number and its own `forces`, and moves its own nodes; `rounds` has
    a row for each thread. The first thread does what needs all nodes.
    """
    threads = len(rounds)
    begin, end = len(x) * thread // threads, len(x) * (thread + 1) // threads
    own, of_x = slice(begin, end), slice(3 * begin, 3 * end)
    round_ = rounds[thread]
    for s in range(len(sizes)):
        dt, row = sizes[s], min(s, len(path) - 1)
        if thread == 0 and rounds[0, STOP] == 0:
            clock[0] = dt
            call(before)
            for n in range(len(at)):
                for k in range(3):
                    i = at[n]
                    old[0, n, k], old[1, n, k], old[2, n, k] = x[i, k], v[i, k], a[i, k]
                    target[n, k] = x[i, k] + path[row, n, k]
        round_[0] = meet(meeting, threads, round_[0])
        if rounds[0, STOP] != 0:
            return s
        drift(x[own], v[own], a[own], dt, ahead[own], f[own])
        round_[0] = meet(meeting, threads, round_[0])
        if len(at) > 0:
            if thread == 0:
                set_rows(at, P, target, x)
                set_rows(at, P, speed[row], ahead)
            round_[0] = meet(meeting, threads, round_[0])
        call(forces)
        turn(f[own], inverse_mass[of_x], dt, v[own], a[own])
        round_[0] = meet(meeting, threads, round_[0])
        if thread == 0:
            set_rows(at, P, speed[row], v)
            pins[0] += pin_work(at, P, mass, dt, old, x, v, a)
            call(after)
            if (s + phase) % period == period - 1:
                call(look)
                if not (stretches[0] >= least and stretches[1] <= largest):
                    rounds[0, STOP] = 1
    return len(sizes)
