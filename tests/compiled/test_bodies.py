"""Bodies of functions in place of the calls in a template."""

import numba
import numpy as np
import pytest

from fecloth.compiled.bodies import insert_bodies
from fecloth.compiled.jit import fingerprint, inner
from fecloth.terms.loops import kinds_of_strain, membrane_loops

FACTOR = 2.0


@inner
def scaled(x):
    return FACTOR * x


def change(*arguments):
    raise NotImplementedError


start = fill = change


def template(values, out):
    """Sum what is made of the values."""
    total = start()
    for i in range(len(values)):
        if values[i] > 0.0:
            y, z = change(values[i], 1.0)
            total += y + z
        fill(out, i, total)
    return total


def from_zero():
    return 0.0


def double(a, b):
    """Twice a, and b."""
    y = scaled(a)
    return y, b


def triple(a, b):
    total = 3.0 * a  # a local name of the template too
    return total, b


def write(out, i, total):
    out[i] = total


def nothing(out, i, total):
    pass


FUNCTIONS = {"start": from_zero, "change": double, "fill": write}


def results(functions):
    made = insert_bodies(template, functions)
    found = []
    for function in (made, numba.njit(made)):
        out = np.zeros(3)
        found.append((function(np.array([1.0, -1.0, 2.0]), out), out.tolist()))
    assert found[0] == found[1]
    return found[0]


def test_the_bodies_stand_in_place_of_the_calls():
    assert results(FUNCTIONS) == (8.0, [3.0, 3.0, 8.0])
    assert results(FUNCTIONS | {"change": triple}) == (11.0, [4.0, 4.0, 11.0])
    assert results(FUNCTIONS | {"fill": nothing}) == (8.0, [0.0, 0.0, 0.0])
    assert results(FUNCTIONS | {"unused": 3}) == (8.0, [3.0, 3.0, 8.0])
    with pytest.raises(NotImplementedError):
        template(np.ones(1), np.ones(1))


def test_a_copy_is_cached_under_all_that_was_inserted(monkeypatch):
    """Its name has the functions, and its fingerprint their code and what they call."""
    made = insert_bodies(template, FUNCTIONS)
    other = insert_bodies(template, FUNCTIONS | {"change": triple})
    assert made.__qualname__ == "template-double-write-from_zero"
    assert made.__module__ == template.__module__
    assert made.__doc__ == template.__doc__
    assert fingerprint(made) != fingerprint(other)
    assert fingerprint(made) == fingerprint(insert_bodies(template, FUNCTIONS))
    monkeypatch.setitem(globals(), "scaled", inner(lambda x: 5.0 * x))
    assert fingerprint(insert_bodies(template, FUNCTIONS)) != fingerprint(made)


def too_many(a, b, c):
    return a, b + c


def assigns(a, b):
    a = 2.0 * a
    return a, b


def returns_early(a, b):
    if a > 1.0:
        return a, b
    return b, a


def other_global(a, b):
    return start * a, b


other_global = type(other_global)(other_global.__code__, {"start": 4.0}, "other_global")


@pytest.mark.parametrize(
    ("function", "said"),
    [
        (too_many, "too_many takes a, b, c"),
        (assigns, "assigns to a parameter, or returns before its end"),
        (returns_early, "assigns to a parameter, or returns before its end"),
        (other_global, "means another start than the template"),
    ],
)
def test_what_cannot_be_inserted_is_refused(function, said):
    with pytest.raises(TypeError, match=said):
        insert_bodies(template, FUNCTIONS | {"change": function})


def test_every_kind_of_strain_has_every_function_of_the_templates():
    kinds = [
        getattr(kinds_of_strain, name)
        for name in ("POINTWISE", "RESTED", "RATE", "REGGE", "REGGE_RATE")
    ]
    placeholders = {k for k, v in vars(membrane_loops).items() if v is membrane_loops.inserted}
    for kind in kinds:
        assert kind.keys() == placeholders - {"inserted"}
