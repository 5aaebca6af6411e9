"""Contact against known answers; studies/contact has their orders under refinement."""

import math

import pytest

import fecloth as fc
from studies.contact import references

pytestmark = pytest.mark.filterwarnings("ignore::fecloth.errors.FeclothWarning")


def at_rest(problem, h, **more):
    _, system, _, start = problem(h, **more)
    return system, fc.equilibrium(system, start, tolerance=1e-8)


@pytest.mark.stories
@pytest.mark.parametrize("method", [fc.BackwardEuler(), fc.BDF2()])
def test_a_strip_pulled_over_a_cylinder_obeys_the_capstan_equation(method):
    _, system, _, start = references.capstan(0.01, 5e-3)
    run = fc.run(system, method, start, 5e-3, 0.25)
    exact = math.exp(references.SLIP * math.pi / 2)
    assert references.pulled(run) == pytest.approx(exact, rel=5e-3)


@pytest.mark.parametrize("height", [0.03, 0.1])
def test_a_lifted_heavy_strip_is_an_elastica_that_leaves_the_plane(height):
    """The small-slope force w l/2 is off by 3 % at 0.1 m; the strip is off by less than 0.5 %."""
    system, state = at_rest(references.lifted, 0.01, height=height)
    force = -system.force(state)[system.cloth.nodes("right"), 2].sum() / references.WIDTH
    assert force == pytest.approx(
        references.elastica(references.B, references.HEAVY, height), rel=5e-3
    )


def test_the_elastica_of_a_small_slope_is_that_of_a_beam():
    """F = w l/2 with h = w l⁴/(24 B)."""
    B, weight, height = 1e-3, 2.0, 1e-4
    length = (24 * B * height / weight) ** 0.25
    assert references.elastica(B, weight, height) == pytest.approx(weight * length / 2, rel=1e-4)


def test_a_ball_is_pushed_into_a_drum_with_the_known_force():
    """Of order 2 in h, beside the error of the gap."""
    forces = []
    for h in (0.02, 0.01):
        system, state = at_rest(references.drum, h)
        forces.append(system.bound[-1].push(state.x, 0.0)[:, 2].sum())
    exact = references.force_on_ball()
    assert forces[1] == pytest.approx(exact, rel=0.01)
    assert abs(forces[0] - exact) > 2 * abs(forces[1] - exact)


def test_a_soft_push_on_a_drum_is_that_of_a_membrane_under_constant_tension(monkeypatch):
    """c²/R (ln(a/c) + 1/2) is the way and 2π T c²/R the force, of small slopes."""
    c, ball = 0.03, 50.0
    way = c**2 / ball * (math.log(references.RIM / c) + 0.5)
    monkeypatch.setattr(references, "BALL", ball)
    monkeypatch.setattr(references, "PUSHED", way)
    tension = references.Y / (1 - references.NU) * 0.5 * (references.STRETCH**2 - 1)
    assert references.force_on_ball() == pytest.approx(
        2 * math.pi * tension * c**2 / ball, rel=1e-4
    )


def test_a_radius_of_contact_fits_the_height_of_the_plate():
    """Of a parabola that just touches, p a²/(4 T), the radius is 0; of a plate at 0 it is a."""
    highest = 100.0 * 0.1**2 / (4 * 50.0)
    radii = [references.contact_radius(0.1, 50.0, 100.0, part * highest) for part in (0.9999, 1e-6)]
    assert radii == pytest.approx([0.0, 0.1], abs=2e-3)
