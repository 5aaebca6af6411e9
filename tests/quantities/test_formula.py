"""Formulas: their values, and that nothing but arithmetic gets through."""

from __future__ import annotations

import ast
import pickle
import re

import numpy as np
import pytest
from support.drawn import drawn

from fecloth.errors import InputError
from fecloth.quantities.formula import Formula
from fecloth.quantities.formula_functions import FUNCTIONS
from fecloth.quantities.time_function import difference_quotient


def smoothstep(a, b, t):
    s = np.clip((t - a) / (b - a), 0.0, 1.0)
    return s * s * (3 - 2 * s)


def of_first(function):
    return lambda a, b: function(a)


SMOOTH_OR_STEP = ("sin", "cos", "tan", "tanh", "exp", "abs", "floor")
OF_NUMPY = {
    "a + b": np.add,
    "a - b": np.subtract,
    "a*b": np.multiply,
    "a/b": np.divide,
    "a % b": np.mod,
    "-a": lambda a, b: -a,
    "abs(a)**b": lambda a, b: abs(a) ** b,
    **{f"{name}(a)": of_first(getattr(np, name)) for name in SMOOTH_OR_STEP},
    "log(abs(a))": lambda a, b: np.log(abs(a)),
    "sqrt(abs(a))": lambda a, b: np.sqrt(abs(a)),
    "sign(a - 1)": lambda a, b: np.sign(a - 1),
    "min(a, b)": np.minimum,
    "max(a, b)": np.maximum,
    "mod(a, b)": np.mod,
    "where(a < b, a, 7)": lambda a, b: np.where(a < b, a, 7.0),
    "where(a <= b, a, 7)": lambda a, b: np.where(a <= b, a, 7.0),
    "where(a > b, a, 7)": lambda a, b: np.where(a > b, a, 7.0),
    "where(a >= b, a, 7)": lambda a, b: np.where(a >= b, a, 7.0),
    "where(a < b and b < 1, a, 7)": lambda a, b: np.where((a < b) & (b < 1), a, 7.0),
    "where(a < b or b < 1, a, 7)": lambda a, b: np.where((a < b) | (b < 1), a, 7.0),
    "where(not a < b, a, 7)": lambda a, b: np.where(a < b, 7.0, a),
    "smoothstep(b, b + 2, a)": lambda a, b: smoothstep(b, b + 2, a),
}


@pytest.mark.parametrize("text", OF_NUMPY)
def test_values_at_many_points_are_those_of_numpy_to_round_off(text, rng):
    """The points include signs, zeros of a - 1, and equal a and b."""
    a = np.concatenate([rng.uniform(-9.0, 9.0, 990), np.arange(-5.0, 0.0), np.arange(1.0, 6.0)])
    b = np.concatenate([rng.uniform(-3.0, 3.0, 990), np.full(5, -2.0), np.full(5, 2.0)])
    values = Formula(text, ("a", "b"))(a=a, b=b)
    np.testing.assert_allclose(values, OF_NUMPY[text](a, b), rtol=1e-15, atol=0)
    assert FUNCTIONS.keys() <= {name for text in OF_NUMPY for name in re.findall("[a-z]+", text)}


def test_variables_broadcast_and_the_result_may_be_written_to():
    value = Formula("X + Y", ("X", "Y"))(X=np.arange(3.0)[:, None], Y=np.arange(2.0))
    assert value.tolist() == [[0, 1], [1, 2], [2, 3]]
    constant = Formula("2", ("X", "Y"))(X=np.zeros(4), Y=0.0)
    constant[0] = 1.0
    assert constant.tolist() == [1, 2, 2, 2]


@pytest.mark.parametrize(
    "text", ["300*t", "-sin(2*pi*t)*exp(-t**2)/(1 + t)", "tanh(sqrt(log(2 + t)))"]
)
def test_smooth_formulas_are_known(text):
    formula = Formula(text, ("t",))
    assert formula.is_smooth
    rough = [f"abs({text})", f"min(1, {text})", f"({text}) % 2", f"where(t < 1, {text}, 0)"]
    rough += [f"{name}({text})" for name in ("floor", "sign", "tan")]
    for other in (*rough, f"smoothstep(0, {text}, t)", f"mod({text}, 2)"):
        assert not Formula(other, ("t",)).is_smooth


def test_condition():
    formula = Formula("0 < X < 1 and not Y > 3 or X > 5", ("X", "Y"), condition=True)
    inside = formula(X=[0.5, 0.5, 2.0, 6.0], Y=[0.0, 4.0, 0.0, 9.0])
    assert inside.dtype == bool
    assert inside.tolist() == [True, False, False, True]
    assert Formula("t > 1", ("t",), condition=True)(t=2.0) is True


def test_formula_survives_pickling():
    formula = Formula("2*t", ("t",))
    assert pickle.loads(pickle.dumps(formula)) == formula
    assert pickle.loads(pickle.dumps(formula))(t=3.0) == 6.0


def test_integers_are_doubles():
    """Python's own integers would make 10**(10**2)*… slow and huge."""
    assert Formula("7**99*7**99")() == 7.0**99 * 7.0**99
    assert Formula("1/2 + 10**-2")() == 0.51


def test_formulas_just_within_the_limits_are_accepted():
    assert Formula("-" * 90 + "t", ("t",)).at(2.0) == 2.0
    assert Formula("t + 0." + 480 * "0" + "1", ("t",)).at(2.0) == 2.0


def test_a_power_is_judged_by_its_value():
    assert Formula("t**200", ("t",)).at(1.0) == 1.0


def test_a_difference_quotient_is_good_to_5e_11():
    slopes = [difference_quotient(np.sin, t) - np.cos(t) for t in np.linspace(0.0, 3.0, 400)]
    assert np.abs(slopes).max() < 5e-11  # a step ten times larger or smaller misses this
    one_sided = difference_quotient(np.sin, 0.7, since=0.7)  # nothing is known before
    assert one_sided == pytest.approx(np.cos(0.7), abs=1e-9)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_wrong_number_of_arguments_is_answered_by_the_arguments_and_the_value(name):
    _, arguments, meaning = FUNCTIONS[name]
    values = ["t < 1" if word == "condition" else f"t + {i}" for i, word in enumerate(arguments)]
    assert np.isfinite(Formula(f"{name}({', '.join(values)})", ("t",))(t=0.25))
    for wrong in (values[1:], [*values, "1"]):
        with pytest.raises(InputError) as caught:
            Formula(f"{name}({', '.join(wrong)})", ("t",))
        assert f"{name}({', '.join(arguments)}) is {meaning}." in str(caught.value)


def test_where_may_hide_values_that_are_not_finite():
    assert Formula("where(t > 0, 1/t, 0)", ("t",))(t=np.array([0.0, 2.0])).tolist() == [0.0, 0.5]


def formulas(st, max_leaves):
    numbers = st.sampled_from(["t", "X", "pi", "2", "0.5", "3"])
    operators, functions = st.sampled_from("+-*"), st.sampled_from(["sin", "cos", "tanh", "abs"])

    def grow(inner):
        return st.one_of(
            st.tuples(inner, operators, inner).map("({0[0]} {0[1]} {0[2]})".format),
            st.tuples(functions, inner).map("{0[0]}({0[1]})".format),
            inner.map("-{}".format),
        )

    return st.recursive(numbers, grow, max_leaves=max_leaves)


@drawn(lambda st: [formulas(st, max_leaves=12)], max_examples=60)
def test_value_is_pythons(text):
    t, X = 0.3, -1.7
    names = {name: getattr(np, name) for name in ("sin", "cos", "tanh", "abs", "pi")}
    expected = eval(compile(ast.parse(text, mode="eval"), "", "eval"), names | {"t": t, "X": X})
    assert Formula(text, ("t", "X"))(t=t, X=X) == pytest.approx(float(expected), rel=1e-12)


SIGNS = "tX0123456789.+-*/()<>=, sincowher_'\"[]{}:;#\\\n@&|^~%"


@drawn(lambda st: [st.text(alphabet=SIGNS, max_size=40)], max_examples=200)
def test_any_text_is_a_formula_or_refused(text):
    try:
        value = Formula(text, ("t", "X"))
        value(t=0.5, X=np.array([0.25, 2.0]))
    except InputError:
        pass


# --- derivatives ----------------------------------------------------------------------------------

SMOOTH = [
    "sin(3*t)",
    "cos(t**2)",
    "tan(t/2)",
    "tanh(2*t - 1)",
    "exp(-t*X)",
    "log(1 + t)",
    "sqrt(t + 0.5)",
    "abs(t - 2) + abs(t + 2)",
    "sign(t - 2)*t + floor(t/3)",
    "min(t, 2) + min(2, t) + min(t, 2*t)",
    "max(t, -2)*max(-2, t)*max(t, 2*t)",
    "where(t < 2, t**2, 1/0)",
    "where(not (t > 2 or t < -1 and X > 0), sin(t), 0)",
    "mod(t, 0.37)*t + t**2 % (1.1 + X)",
    "smoothstep(0, 2, t)",
    "smoothstep(-t, 2 + t**2, X*t)",
    "smoothstep(2, 3, t) + smoothstep(-1, 0, t)",
    "t**3 - 2*t**0.5 + t**-2 + t**1 + t**0",
    "2**t + X**t + t**t + 0**t",
    "(1 + t**2)**(X*t)",
    "t*t*sin(t)/(1 + t)/X - +t - -t**2",
    "pi*X",
]


@pytest.mark.parametrize("text", SMOOTH)
def test_derivative_is_that_of_finite_differences(text):
    """Fourth-order differences over 1e-3 err by 1e-12 of the fifth derivative."""
    formula, X = Formula(text, ("t", "X")), 1.3
    for t in (0.4, 0.9, 1.4):
        u, h = [formula(t=t + s * 1e-3, X=X) for s in (-2, -1, 1, 2)], 1e-3
        expected = (u[0] - 8 * u[1] + 8 * u[2] - u[3]) / (12 * h)
        slope = formula.derivative("t")
        assert slope(t=t, X=X) == pytest.approx(expected, rel=1e-8, abs=1e-8)
        assert slope.at(t, X) == slope(t=t, X=X)
        assert slope(t=np.full(2, t), X=X) == pytest.approx(slope.at(t, X), rel=1e-14)


@drawn(lambda st: [formulas(st, max_leaves=8)], max_examples=100)
def test_derivative_of_any_smooth_formula(text):
    formula, t, X, h = Formula(text, ("t", "X")), 0.37, -1.7, 1e-20
    names = {"sin": np.sin, "cos": np.cos, "tanh": np.tanh, "pi": np.pi}
    names["abs"] = lambda y: y if np.real(y) >= 0 else -y
    code = compile(ast.parse(text, mode="eval"), "", "eval")
    expected = np.imag(eval(code, names | {"t": t + 1j * h, "X": X})) / h  # a complex step is exact
    slope = formula.derivative("t")(t=t, X=X)
    assert slope == pytest.approx(expected, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize(
    ("text", "at", "slope"),
    [
        ("abs(t)", 0.0, 0.0),
        ("min(t, 0.5)", 0.5, 0.0),
        ("max(0.5, t)", 0.5, 1.0),
        ("where(t < 0.5, t, 2*t)", 0.5, 2.0),
        ("floor(t)", 1.0, 0.0),
        ("smoothstep(0, 1, t)", 0.0, 0.0),
        ("t**2", 0.0, 0.0),
        ("t**1.5", 0.0, 0.0),
    ],
)
def test_derivative_on_a_kink_is_one_sided(text, at, slope):
    assert Formula(text, ("t",)).derivative("t").at(at) == slope


GROWING = {  # formulas whose derivatives, written out, grow faster than they do
    "products": lambda n: "*".join(f"(t + {i})" for i in range(n)),
    "sums of sines": lambda n: "*".join(f"sin({i}*t + 1)" for i in range(1, n + 1)),
    "sines": lambda n: "sin(" * n + "2*t" + ")" * n,
    "nested products": lambda n: "(t*" * n + "2" + ")" * n,
    "smoothsteps": lambda n: "smoothstep(" * n + "t" + ", 2, t)" * n,
    "powers": lambda n: "(1 + " * n + "t" + ")**1.01" * n,
    "choices": lambda n: "min(t, sin(" * n + "t" + "))" * n,
}


@pytest.mark.parametrize("of", GROWING.values(), ids=GROWING)
def test_the_work_of_a_second_derivative_grows_with_the_formula(of):
    """Each part is computed once, for any number of its places."""

    def operations(n):
        second = Formula(of(n), ("t",)).derivative("t").derivative("t")
        assert np.isfinite(second.at(0.3))
        return len(second._program.code)

    few, some, many = operations(6), operations(12), operations(24)
    assert 0 < many - some < 2.2 * (some - few)  # 4 for a square


@pytest.mark.parametrize("of", GROWING.values(), ids=GROWING)
def test_second_derivatives_are_exact(of):
    first = Formula(of(5), ("t",)).derivative("t")
    h = 1e-3
    u = [first.at(0.3 + s * h) for s in (-2, -1, 1, 2)]
    expected = (u[0] - 8 * u[1] + 8 * u[2] - u[3]) / (12 * h)
    assert first.derivative("t").at(0.3) == pytest.approx(expected, rel=1e-6, abs=1e-8)


# --- speed ----------------------------------------------------------------------------------------


@drawn(lambda st: [formulas(st, max_leaves=12), st.floats(-3, 3)], max_examples=200)
def test_numbers_and_arrays_have_the_same_bits(text, t):
    formula = Formula(text, ("t", "X"))
    assert formula.at(t, 0.7) == formula(t=np.array([t]), X=0.7)[0]
