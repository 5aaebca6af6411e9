"""Shadows, drape coefficients and folds of known shapes."""

import math
import sys
from pathlib import Path

import numpy as np
import pytest

import fecloth as fc
from fecloth.errors import InputError
from fecloth.output.frame_reader import Frame
from studies.drape import __main__ as drape
from studies.drape.__main__ import SPECIMEN, SUPPORT, count_folds, drape_coefficient, shadow_area

SHEET = fc.Cloth.read(Path(__file__).parents[2] / "meshes" / "drape.geo", h=0.005)


def frame_of(x):
    flat = np.c_[SHEET.X, np.zeros(len(SHEET.X))]
    return Frame(0.0, x, SHEET.triangles, {"displacement": x - flat}, {})


def shaped(radius, height):
    """Radius and height of the hanging ring as functions of (r, φ)."""
    r, angle = np.hypot(*SHEET.X.T), np.arctan2(SHEET.X[:, 1], SHEET.X[:, 0])
    out = np.where(r > SUPPORT, radius(r, angle), r)
    z = np.where(r > SUPPORT, height(r, angle), 0)
    return frame_of(np.c_[out * np.cos(angle), out * np.sin(angle), z])


def test_overlapping_layers_are_counted_once():
    x = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0.1, 0.1, 0], [0, 0, 0.02]], float)
    square = np.array([[0, 1, 2], [1, 3, 2]])
    assert shadow_area(x, square) == pytest.approx(0.01, rel=0.02)
    assert shadow_area(x, np.vstack([square, [[4, 1, 2]]])) == shadow_area(x, square)


def test_a_board_covers_all_and_a_cone_its_part():
    assert drape_coefficient(shaped(lambda r, a: r, lambda r, a: 0 * r)) == pytest.approx(1.0)
    slope = math.radians(50)
    cone = shaped(lambda r, a: SUPPORT + (r - SUPPORT) * math.cos(slope), lambda r, a: SUPPORT - r)
    rim = SUPPORT + (SPECIMEN - SUPPORT) * math.cos(slope)
    exact = (rim**2 - SUPPORT**2) / (SPECIMEN**2 - SUPPORT**2)
    assert drape_coefficient(cone) == pytest.approx(exact, abs=0.01)


def test_shadow_ignores_a_fold_under_the_rim():
    """The ring goes out to its middle and back in below: the shadow is that of the middle."""
    middle = (SUPPORT + SPECIMEN) / 2
    tucked = shaped(lambda r, a: middle - abs(r - middle), lambda r, a: SUPPORT - r)
    exact = (middle**2 - SUPPORT**2) / (SPECIMEN**2 - SUPPORT**2)
    assert drape_coefficient(tucked) == pytest.approx(exact, abs=0.03)


@pytest.mark.parametrize("count", [4, 7])
def test_folds_are_counted_along_the_rim(count):
    wavy = shaped(lambda r, a: r, lambda r, a: 0.01 * np.cos(count * a + 0.3))
    assert count_folds(wavy) == count


def test_a_missing_package_costs_only_the_picture(monkeypatch, capsys):
    """Unless --picture asks for it; then it is a mistake, found before the first run."""
    monkeypatch.setitem(sys.modules, "imageio", None)
    board = shaped(lambda r, a: r, lambda r, a: 0 * r)
    monkeypatch.setattr(drape, "drape_fabric", lambda *_: board)
    monkeypatch.setattr(sys, "argv", ["drape.py"])
    assert drape.main() == 0
    printed = capsys.readouterr().out
    assert printed.count("drape coefficient 100 %") == 3
    assert printed.startswith("no picture: the package imageio: is not installed")
    monkeypatch.setattr(sys, "argv", ["drape.py", "--picture", "x.png"])
    with pytest.raises(InputError, match=r"imageio: is not installed.*\.\[view\]"):
        drape.main()
