"""Forces of strips by all rows of Wang et al., against a computation of their own; the command."""

import re

import numpy as np
import pytest
from scipy.optimize import root

import fecloth as fc
from fecloth.cli import main
from fecloth.fabric import presets, strips

WANG = [name for name in fc.Fabric.presets() if presets.rows(name)]


def stretching(name):
    return presets.rows(name)["stretching"]


# --- the rows -------------------------------------------------------------------------------------


def test_the_constants_of_a_preset_are_the_first_row_and_column():
    """Interlock, of which c₁₂ < 0 is replaced by zero: Y = 2c, G = c₃₃, B = k/4."""
    fabric = fc.Fabric.preset("interlock")
    assert fabric.tensile == pytest.approx((2 * 34.477123, 2 * 16.593832))
    assert fabric.shear == 36.860302
    assert fabric.bending == pytest.approx((23.191698e-6 / 4, 14.267624e-6 / 4))
    assert fabric.bias_rigidity == pytest.approx(24.749964e-6 / 4)


# --- forces ---------------------------------------------------------------------------------------


def moduli(rows, E11, E22, E12):
    """k0 to k3 [N/m] at a strain: angle and size of its larger principal value in closed form."""
    largest = (E11 + E22) / 2 + np.hypot((E11 - E22) / 2, E12)
    weight = np.clip(6 * (np.sqrt(1 + 2 * largest) - 1), 0, 1)
    place = abs(np.arctan2(2 * E12, E11 - E22) / 2) / (np.pi / 8)
    i = min(int(place), 3)
    rows = np.array(rows)
    there = rows[1 + i] * (1 + i - place) + rows[2 + i] * (place - i)
    return np.maximum(2 * ((1 - weight) * rows[0] + weight * there), 1e-9)


def independent_force(rows, strain, angle):
    """Solve for F in the axes of the strip: no force on its sides; the force along is P11."""
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    R = np.array([[c, -s], [s, c]])  # from the axes of the strip to u and v

    def first_piola(width, slide):
        F = np.array([[1 + strain, slide], [0.0, width]]) @ R.T
        E = (F.T @ F - np.eye(2)) / 2
        k0, k1, k2, k3 = moduli(rows, E[0, 0], E[1, 1], E[0, 1])
        S11, S22, S12 = k0 * E[0, 0] + k1 * E[1, 1], k1 * E[0, 0] + k2 * E[1, 1], k3 * E[0, 1]
        return F @ np.array([[S11, S12], [S12, S22]]) @ R

    free = 2 if angle == 45 else 1  # a strip along warp or weft does not shear
    solution = root(
        lambda z: first_piola(*z, *[0] * (2 - free))[1::-1, 1][:free],
        [1 - strain / 5, strain / 9][:free],
        tol=1e-12,
    )
    assert abs(solution.fun).max() < 1e-8
    return first_piola(*solution.x, *[0] * (2 - free))[0, 0]


@pytest.mark.parametrize("along", strips.ALONG)
@pytest.mark.parametrize("name", WANG)
def test_a_force_is_that_of_an_independent_solution(name, along):
    for strain in (0.05, 0.2):
        expected = independent_force(stretching(name), strain, strips.ALONG[along])
        assert strips.force(stretching(name), strain, along) == pytest.approx(expected, rel=1e-7)


def test_a_force_has_three_parts_over_the_strain():
    """The secant modulus is linear up to the strain of the rows, and the same beyond it."""

    def secant(strain):
        stretch = 1 + strain
        return strips.force(rows, strain, "warp") / (stretch * (stretch**2 - 1) / 2)

    rows = [[100.0, 0.0, 50.0, 30.0], *[[100.0, 0.0, 450.0, 30.0]] * 5]
    part = strips.END
    secants = [secant(x * part) for x in (0.4, 0.8, 1.0, 1.25)]
    assert secants == pytest.approx([420, 740, 900, 900])
    assert part == 1 / 6


@pytest.mark.parametrize("name", WANG)
def test_the_constants_give_the_force_of_the_preset(name):
    """StVK: P = Y λ (λ² − 1)/2, where 4/Y₄₅ = 1/Y₁ + 1/Y₂ − 2 ν₁₂/Y₁ + 1/G."""
    fabric = fc.Fabric.preset(name)
    warp, weft = fabric.tensile
    bias = 4 / (1 / warp + 1 / weft - 2 * fabric.poisson_ratio / warp + 1 / fabric.shear)
    for along, Y in {"warp": warp, "weft": weft, "45°": bias}.items():
        force, off = strips.compare(stretching(name), 0.1, along)
        assert force * (1 + off) == pytest.approx(Y * 1.1 * 0.21 / 2, rel=1e-6)


# --- pages and the command ------------------------------------------------------------------------


def printed(capsys, *arguments):
    assert main.main(["info", "--fabrics", *arguments]) == 0
    out = capsys.readouterr().out
    assert max(map(len, out.splitlines())) <= 100
    return out


def test_the_command_prints_a_fabric_with_its_curves(capsys):
    out = printed(capsys, "interlock")
    assert out.startswith("interlock: 60 % cotton 40 % polyester")
    assert re.search(r"^tensile_stiffness.0 +68.95 N/m +± 56 %$", out, re.MULTILINE)
    assert re.search(r"^poisson_ratio +0 +± 0.44$", out, re.MULTILINE)
    assert "uncertainty: spread of 3 fabrics of the kind knitted" in out
    assert "source: Wang, O'Brien and Ramamoorthi" in out
    assert "taken at zero strain" in out
    assert "0 and 16.7 %" in out
    (five,) = re.findall(r"^5 % .*$", out, re.MULTILINE)
    assert five.split()[2:] == ["15.19", "-76", "%", "2.712", "-34", "%", "5.271", "-43", "%"]
    (bent,) = re.findall(r"^10 1/m .*$", out, re.MULTILINE)  # 32.93, 7.05 and 18.65 over 4
    assert bent.split()[2:] == ["8.233", "-30", "%", "1.763", "+102", "%", "4.663", "+33", "%"]


def test_the_command_prints_another_fabric_without_curves(capsys):
    out = printed(capsys, "silk")
    assert re.search(r"^tensile_stiffness.1 +326.6 N/m +± 23 %$", out, re.MULTILINE)
    assert "source: Clyde, Teran and Tamstorf" in out
    assert "bending_rigidity" not in out
    assert "all rows" not in out
