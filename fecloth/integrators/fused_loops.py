"""The compiled loop over steps of central differences, and its passes over the nodes.

Each rounds its operations one by one, as the loops of `explicit` do.
"""

from typing import NamedTuple, Self

import numpy as np

from fecloth.compiled.calls import call
from fecloth.compiled.jit import Array, rounded_kernel
from fecloth.compiled.threads import Member, part_of, wait


class Fields(NamedTuple):
    """The arrays over all nodes, which steps change in place.

    Attributes
    ----------
    x, v, a
        (n, 3) positions [m], velocities [m/s] and accelerations [m/s²].
    ahead
        (n, 3) the velocities v + dt a that the forces of a step see [m/s].
    f
        (n, 3) the forces [N].
    mass
        (n,) masses of the nodes [kg].
    inverse_mass
        (3n,) one over the mass of each component [1/kg].
    """

    x: np.ndarray
    v: np.ndarray
    a: np.ndarray
    ahead: np.ndarray
    f: np.ndarray
    mass: np.ndarray
    inverse_mass: np.ndarray


class Held(NamedTuple):
    """The c nodes that pins and slides hold.

    Attributes
    ----------
    at
        (c,) the nodes, ascending.
    P
        (c, 3, 3) projectors onto their free directions.
    path, speed
        (s, c, 3) displacement over each step [m], and velocity at its end [m/s]; one row for
        all steps where no pin moves.
    old
        (3, c, 3) x, v and a at the begin of a step.
    target
        (c, 3) positions at the end of a step [m].
    work
        (1,) work done on the cloth so far [J].
    """

    at: np.ndarray
    P: np.ndarray
    path: np.ndarray
    speed: np.ndarray
    old: np.ndarray
    target: np.ndarray
    work: np.ndarray

    def over(self, steps: slice) -> Self:
        """The held nodes over some of the steps."""
        if len(self.path) == 1:
            return self
        return self._replace(path=self.path[steps], speed=self.speed[steps])


class Pauses(NamedTuple):
    """What the first thread does between two steps.

    Attributes
    ----------
    before, after
        Addresses of the calls before and after each step.
    look
        Address of the call that fills `stretches`.
    phase, period
        The first thread looks at the stretches after step s if (s + phase) % period =
        period − 1.
    least, largest
        Stretches beyond which no further step is taken.
    size, t
        (1,) size of the step, and the time at its end [s].
    stretches
        (2,) the least and the largest stretch.
    stop
        (1,) 1 if no further step is to be taken, else 0.
    """

    before: int
    after: int
    look: int
    phase: int
    period: int
    least: float
    largest: float
    size: np.ndarray
    t: np.ndarray
    stretches: np.ndarray
    stop: np.ndarray


@rounded_kernel
def copy(a: Array, b: Array) -> None:
    """b (n, 3) = a."""
    a = a.reshape(-1)
    b = b.reshape(-1)
    for i in range(len(a)):
        b[i] = a[i]


@rounded_kernel
def drift(x: Array, v: Array, a: Array, dt: float, ahead: Array, f: Array) -> None:
    """x += dt (v + dt/2 a), ahead = v + dt a, f = 0: as `explicit.move` with a share of ½.

    All arrays are (n, 3): x, v, a, the predicted velocities `ahead`, and the force f.
    """
    x = x.reshape(-1)
    v = v.reshape(-1)
    a = a.reshape(-1)
    ahead = ahead.reshape(-1)
    f = f.reshape(-1)
    for i in range(len(x)):
        dv = dt * a[i]
        x[i] += dt * (v[i] + 0.5 * dv)
        ahead[i] = v[i] + dv
    for i in range(len(f)):  # by itself: the compiler vectorises loops over few arrays
        f[i] = 0.0


@rounded_kernel
def turn(f: Array, inverse_mass: Array, dt: float, v: Array, a: Array) -> None:
    """a = f/m, v += dt/2 (a + old a): `CentralDifference.close`, in place."""
    f = f.reshape(-1)
    v = v.reshape(-1)
    a = a.reshape(-1)
    for i in range(len(f)):
        b = f[i] * inverse_mass[i]
        v[i] += 0.5 * dt * (a[i] + b)
        a[i] = b


@rounded_kernel
def set_rows(at: Array, P: Array, target: Array, y: Array) -> None:
    """As `Constraints.set_held`, with a row of `target` for each of the nodes `at`."""
    for n in range(len(at)):
        i = at[n]
        d1 = y[i, 0] - target[n, 0]
        d2 = y[i, 1] - target[n, 1]
        d3 = y[i, 2] - target[n, 2]
        for k in range(3):
            y[i, k] = target[n, k] + (P[n, k, 0] * d1 + P[n, k, 1] * d2 + P[n, k, 2] * d3)


@rounded_kernel
def pin_work(
    at: Array, P: Array, mass: Array, dt: float, old: Array, x: Array, v: Array, a: Array
) -> float:
    """Return the work of the pins in a step [J]: Σ m (Δv · v̄ − ā · Δx) along held directions.

    It is the change of the kinetic energy less the work of the mean force M ā of the cloth. The
    sum is over the held nodes `at` (c,); `old` (3, c, 3) are their x, v and a at the begin of
    the step, and v̄ and ā are means of both ends.
    """
    total = 0.0
    for n in range(len(at)):
        i = at[n]
        for k in range(3):
            held_v = 0.0
            held_x = 0.0
            for j in range(3):
                identity = 1.0 if j == k else 0.0
                held = identity - P[n, k, j]
                held_v += held * (0.5 * (v[i, j] + old[1, n, j]))
                held_x += held * (x[i, j] - old[0, n, j])
            mean = 0.5 * (a[i, k] + old[2, n, k])
            total += mass[i] * ((v[i, k] - old[1, n, k]) * held_v - mean * held_x)
    return total


@rounded_kernel
def take_steps(
    forces: int,
    sizes: Array,
    ends: Array,
    pauses: Pauses,
    held: Held,
    fields: Fields,
    member: Member,
) -> int:
    """Take steps of central differences in place; return the number of steps taken.

    `sizes` (s,) are their sizes and `ends` (s,) the times at their ends [s]. They are fewer than
    s if a stretch is beyond the limits of `pauses`.
    Each thread calls this with the address of its own `forces`, and moves its own nodes. The
    first thread does what needs all nodes: the held nodes, the ledger, and the look at
    stretches. At each `wait` the threads wait for each other.
    """
    x = fields.x
    v = fields.v
    a = fields.a
    ahead = fields.ahead
    f = fields.f
    at = held.at
    P = held.P
    path = held.path
    speed = held.speed
    old = held.old
    target = held.target
    begin, end = part_of(member, 0, len(x))
    own = slice(begin, end)
    own_components = slice(3 * begin, 3 * end)
    is_first = member.thread == 0
    stretches = pauses.stretches
    stop = pauses.stop
    for s in range(len(sizes)):
        dt = sizes[s]
        row = min(s, len(path) - 1)  # one row for all steps where no pin moves
        if is_first and stop[0] == 0:
            pauses.size[0] = dt
            pauses.t[0] = ends[s]
            call(pauses.before)
            for n in range(len(at)):  # keep the begin of the step, for the work of the pins
                for k in range(3):
                    i = at[n]
                    old[0, n, k] = x[i, k]
                    old[1, n, k] = v[i, k]
                    old[2, n, k] = a[i, k]
                    target[n, k] = x[i, k] + path[row, n, k]
        wait(member)
        if stop[0] != 0:  # the first thread sets it: the others may read it after a wait
            return s
        drift(x[own], v[own], a[own], dt, ahead[own], f[own])
        wait(member)
        if len(at) > 0:
            if is_first:
                set_rows(at, P, target, x)
                set_rows(at, P, speed[row], ahead)
            wait(member)
        call(forces)
        turn(f[own], fields.inverse_mass[own_components], dt, v[own], a[own])
        wait(member)
        if is_first:
            set_rows(at, P, speed[row], v)
            held.work[0] += pin_work(at, P, fields.mass, dt, old, x, v, a)
            call(pauses.after)
            if (s + pauses.phase) % pauses.period == pauses.period - 1:
                call(pauses.look)
                is_within = stretches[0] >= pauses.least and stretches[1] <= pauses.largest
                if not is_within:  # also where a stretch is not a number
                    stop[0] = 1
    return len(sizes)
