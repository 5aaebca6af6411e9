"""The page of the laws is what the curves give, and the curves are the laws' closed forms."""

import inspect
import re
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

import fecloth as fc
from fecloth import terms
from studies.laws import __main__ as laws
from studies.laws import curves as law_curves
from studies.laws.curves import NU, SHEARS, STRETCHES, B, H, Y

STUDIES = Path(__file__).parents[2] / "studies"
PAGE = (STUDIES / "laws" / "laws.md").read_text()
G, C11 = Y / (2 * (1 + NU)), Y / (1 - NU**2)
MATERIAL = [(name, i) for name, rows in law_curves.LAWS.items() for i in range(len(rows))]


@pytest.fixture(scope="module")
def curves():
    return law_curves.responses()


@pytest.fixture(scope="module")
def moments():
    return law_curves.moments()


# --- the page -------------------------------------------------------------------------------------


@pytest.mark.stories
def test_page_is_generated_from_the_curves(curves, moments):
    assert laws.page(curves, moments) == PAGE, "run python -m studies.laws"


@pytest.mark.parametrize("name", [*terms.__all__, "Condition", "Pin", "Slide"])
def test_a_term_has_formula_source_and_validity(name):
    formula, _, rest = inspect.getdoc(getattr(fc, name)).partition("\n\nSource: ")
    source, _, validity = rest.partition("\n\nValid")
    assert re.search(r"\S = \S", formula)
    assert source
    assert len(validity.partition("\n\n")[0]) > 40


# --- the curves against closed forms --------------------------------------------------------------


def stvk(s, stiffness=Y):
    return stiffness * s * (s**2 - 1) / 2


def stvk_shear(g, shear=G, across=C11):
    """E12 = γ/2 and E22 = γ²/2: P12 = S12 + γ S22."""
    return shear * g + across * g**3 / 2


def free_sides(energy, s):
    """dW/dλ of the least W over the width, from W alone."""

    def least(stretch):
        result = minimize_scalar(lambda w: energy(stretch, w), bounds=(0.3, 3.0), method="bounded")
        return result.fun

    return np.array([(least(t + 1e-4) - least(t - 1e-4)) / 2e-4 for t in s])


def incompressible(s, w):
    return Y / 6 * (s**2 + w**2 + 1 / (s * w) ** 2 - 3)


def compressible(s, w):
    mu, lam, log_J = G, Y * NU / (1 - NU**2), np.log(s * w)
    return mu / 2 * (s**2 + w**2 - 2) - mu * log_J + lam / 2 * log_J**2


X, UP, RISING, FALLING = (1, 0), (0, 1), (0.5**0.5, 0.5**0.5), (0.5**0.5, -(0.5**0.5))
NETS = {  # k l² over the area of a cell, and the direction, of each family of springs
    0: [(Y, X), (Y, UP), (2 * G, RISING), (2 * G, FALLING)],
    1: [(Y, X), (Y, UP), (2 * G, RISING), (2 * G, FALLING)],
    2: [(Y, X), (Y, UP), (Y, RISING)],
    3: [(Y, X), (Y, (0.5, 0.75**0.5)), (Y, (0.5, -(0.75**0.5)))],
}


def net(springs, s, w, g=0.0):
    """W of springs that are stretched by |F n|, F = [[s, g], [0, w]]."""
    return sum(k / 2 * (np.hypot(s * n[0] + g * n[1], w * n[1]) - 1) ** 2 for k, n in springs)


def pulled(i):
    return lambda s: free_sides(lambda stretch, w: net(NETS[i], stretch, w), s)


def sheared(i):
    """dW/dγ by a central difference of order four."""
    steps = ((-2e-3, 1 / 12), (-1e-3, -2 / 3), (1e-3, 2 / 3), (2e-3, -1 / 12))
    return lambda g: sum(c * net(NETS[i], 1, 1, g + e) for e, c in steps) / 1e-3


def folding(s):
    """The weft and the diagonals turn and keep their length until the cells are flat, at √2 − 1."""
    return np.where(s > np.sqrt(2) - 1, Y * (s - 1), np.nan)


def tension_field_shear(g):
    """W = ½ Y E₁², E₁ the larger principal strain of E12 = γ/2, E22 = γ²/2, wrinkled to γ = 1."""
    root = np.sqrt(g**4 / 16 + g**2 / 4)
    slope = g / 2 + (g**3 / 4 + g / 2) / np.maximum(2 * root, 1e-300)
    return Y * (g**2 / 4 + root) * slope


def conditions_shear(g):
    return Y * (1 - 1 / np.sqrt(1 + g**2)) * g + G * g


WEFT11, WARP11 = 0.5 * Y / (1 - NU * NU / 2), Y / (1 - NU * NU / 2)
FORMS = {
    "StVK": [
        (stvk, stvk_shear),
        (stvk, lambda g: stvk_shear(g, 0.1 * Y, WEFT11)),
        (lambda s: stvk(s, 0.5 * Y), lambda g: stvk_shear(g, 0.1 * Y, WARP11)),
    ],
    "TensorCondition": [(stvk, lambda g: stvk_shear(g, Y / 2, Y))],
    "NeoHookean": [
        (lambda s: free_sides(incompressible, s), lambda g: Y / 3 * g),
        (lambda s: free_sides(compressible, s), lambda g: G * g),
    ],
    "TensionField": [(lambda s: stvk(np.maximum(s, 1)), tension_field_shear)],
    "BaraffWitkin": [
        (lambda s: Y * (s - 1), conditions_shear),
        (lambda s: Y * (s - 1), conditions_shear),
        (lambda s: Y / 4 * (s - 1), lambda g: conditions_shear(g) / 4),
    ],
    "Springs": [
        (pulled(0), sheared(0)),
        (pulled(1), sheared(1)),
        (folding, sheared(2)),
        (pulled(3), sheared(3)),
        (stvk, stvk_shear),
    ],
}


@pytest.mark.stories
@pytest.mark.parametrize(("name", "i"), MATERIAL)
def test_curves_are_the_closed_forms(curves, name, i):
    tension, shear = FORMS[name][i]
    curve = curves[name][i]
    np.testing.assert_allclose(curve.tension, tension(STRETCHES), rtol=2e-6, atol=2e-6 * Y)
    np.testing.assert_allclose(curve.shearing, shear(SHEARS), rtol=1e-8, atol=1e-8 * Y)


def test_each_curve_has_a_closed_form():
    for name, rows in law_curves.LAWS.items():
        assert len(FORMS[name]) == len(rows)


@pytest.mark.stories
@pytest.mark.parametrize(("name", "i"), [case for case in MATERIAL if case[0] != "TensionField"])
def test_slopes_at_rest(name, i):
    """Y, ν and G of the homogenised moduli, which `plane_moduli` has from the stiffness matrix.

    `TensionField` has none at rest.
    """
    row = law_curves.LAWS[name][i]
    term, fabric, pattern, h = (*row[1:], *(law_curves.FABRIC, "cross", H)[len(row) - 2 :])
    C = fc.plane_moduli(term, fabric, pattern, h)
    patch, e = law_curves.InfinitePatch.of(term, fabric, pattern, h), 1e-4
    P, width = law_curves.pull(patch, np.array([1 - e, 1 + e]))
    compliance = np.linalg.inv(C)
    assert np.diff(P)[0] / (2 * e) == pytest.approx(1 / compliance[0, 0], rel=1e-6)
    nu = -compliance[1, 0] / compliance[0, 0]
    assert -np.diff(width)[0] / (2 * e) == pytest.approx(nu, abs=1e-6)
    P12 = [patch.stress([[1, g], [0, 1]])[0, 1] for g in (-e, e)]
    assert np.diff(P12)[0] / (2 * e) == pytest.approx(C[2, 2], rel=1e-6)


# --- bending and drag -----------------------------------------------------------------------------

BENDING = ("HingeBending", "QuadraticBending")


@pytest.mark.stories
def test_moments_of_a_strip_rolled_up(moments):
    """On "right" the cells fold along their sides by κh: ½ B κ², and 2 B sin²(κh/2)/h²."""
    folds = law_curves.FOLDS
    assert tuple(moments) == BENDING
    np.testing.assert_allclose(moments["HingeBending"]["right"], folds, rtol=1e-7)
    np.testing.assert_allclose(moments["QuadraticBending"]["right"], np.sin(folds), atol=1e-7)


@pytest.mark.stories
@pytest.mark.parametrize("pattern", law_curves.PATTERNS)
def test_moment_of_a_weak_curvature_is_the_bending_tensor(pattern):
    fabric = fc.Fabric(0.2, Y, NU, bending_rigidity=B)
    for term in (fc.HingeBending(), fc.QuadraticBending()):
        patch = law_curves.InfinitePatch.of(term, fabric, pattern)
        D11 = fc.bending_tensor(pattern)[0, 0] * B
        assert patch.moment(0.01, pattern) == pytest.approx(D11 * 0.01, rel=1e-5)


@pytest.mark.parametrize(("pattern", "height"), [("right", H), ("equilateral", H * 0.75**0.5)])
def test_rolled_triangles_keep_their_sides(pattern, height):
    cloth = fc.Cloth.rectangle(4 * H, 4 * height, H, pattern)
    x = law_curves.roll_up(cloth.X, 2.0 / H, pattern, H)
    a, b = cloth.triangles.ravel(), np.roll(cloth.triangles, 1, axis=1).ravel()
    was, now = (np.linalg.norm(y[a] - y[b], axis=1) for y in (cloth.X, x))
    whole = was > 0.99 * H  # not the cut cells at the border
    assert whole.sum() > 60
    np.testing.assert_allclose(now[whole], was[whole], rtol=1e-12)


@pytest.mark.stories
def test_drag_and_lift_of_a_plate():
    degrees = np.array([0.0, 30.0, 55.0, 90.0])
    result = law_curves.drag_and_lift(fc.Drag(normal=0.7, tangential=0.006), degrees)
    a, speed = np.radians(degrees), law_curves.SPEED
    n, t = 0.7 * (speed * np.sin(a)) ** 2, 0.006 * (speed * np.cos(a)) ** 2
    expected = np.stack([n * np.sin(a) + t * np.cos(a), n * np.cos(a) - t * np.sin(a)], axis=1)
    np.testing.assert_allclose(result, expected, atol=1e-12)
