"""The numbers of Newton's iteration from both sides: at about 0.8 and 1.25 times their value.

The equation is scripted: one number y [m] in place of the positions of a cloth of 1 m, residuals
R(y), and directions that belong to no matrix.
"""

from types import SimpleNamespace

import numpy as np
import pytest

import fecloth as fc
from fecloth.errors import IndefiniteMatrix
from fecloth.linalg.protocol import SolveInfo
from fecloth.nonlinear import static_equation
from fecloth.nonlinear.context import FactorReuse, SolverContext
from fecloth.nonlinear.equation import largest_step
from fecloth.nonlinear.error_left import ErrorLeft
from fecloth.nonlinear.iteration import iterate
from fecloth.nonlinear.line_search import Point, find_step
from fecloth.nonlinear.newton import MULTIPLES, REMEDIES
from fecloth.nonlinear.remedies import Remedies, Remedy, RemedySearch
from fecloth.nonlinear.static_equation import LONGEST_DIRECTION, StaticEquation

SUMS = SimpleNamespace(norm=np.linalg.norm, dot=np.vdot, rms=lambda mass, s: np.linalg.norm(s))
EXACT = REMEDIES["on_failure"][0]


class Script:
    """An equation, and the linear solver that finds its directions."""

    system = SimpleNamespace(
        cloth=SimpleNamespace(X=np.array([[0.0, 0.0], [1.0, 0.5]])),
        mass_kind="consistent",
        is_whole=True,
        sums=SUMS,
        diagonal_mass=None,
        constraints=SimpleNamespace(project=lambda y: y, expand=lambda y: y),
    )
    wx, longest, takes_short_solves, explores = 1.0, np.inf, False, False
    remedies = Remedies(REMEDIES["on_failure"], clamped=len(MULTIPLES))
    name, prepared, scale, noise, potential = "scripted", 0, 1.0, 0.0, None

    def __init__(self, **given):
        self.rtols, self.seen = [], []
        vars(self).update(given)

    def residual(self, y, scale):
        return np.array([[self.R(float(y[0, 0]))]]), self.scale

    def round_off(self, y):
        return self.noise

    def largest_step(self, y, step):
        return np.inf

    def assemble(self, y, remedy, J):
        pass

    def couple(self, y, remedy, J):
        return remedy

    def updates(self, y):
        return []

    def key(self, remedy):
        return self, remedy

    def failure(self, reason, point, residual):
        return fc.errors.SolveFailed(reason, residual, 0.0)

    def prepare(self, remedy):
        self.remedy = remedy

    def solve(self, b, rtol=0.0, guess=None):
        self.rtols.append(rtol)
        return np.array([[self.step(float(b[0, 0]))]]), SolveInfo(self.name, 1, 0.0, 0.0, 0.0)

    def report(self, progress):
        self.seen.append((float(progress.point.y[0, 0]), progress.remedy, progress.length))

    def run(self, start=0.0, **options):
        newton = fc.Newton(**({"tolerance": 1e-9, "reuse": False} | options))
        context = SolverContext(self, None, newton)
        context.matrix_solver = lambda: (self, None)
        return iterate(self, context, np.array([[start]]), least=1, report=self.report)[1]


def test_definite_remedies_begin_with_the_second_and_then_one_before_the_last_taken():
    order = (Remedy(0.0, False), *(Remedy(4.0**n, True) for n in range(5)))
    search = RemedySearch.begin(Remedies(order, second=3))
    assert search.to_try() == [0, 3, 4, 5]
    search = search.take(5)
    assert search.to_try() == [0, 4, 5]
    search = search.take(1)
    assert search.to_try() == [0, 1, 2, 3, 4, 5]


def test_after_mass_was_added_the_next_weaker_remedy_is_tried_first():
    count, clamped = len(REMEDIES["on_failure"]), len(MULTIPLES)
    search = RemedySearch.begin(Remedies(REMEDIES["on_failure"], clamped=clamped))
    assert search.to_try() == [0, clamped, *range(1, count)]
    search = search.take(3)
    assert search.to_try() == list(range(2, count))
    for _ in range(4):
        search = search.take(clamped)
    assert search.to_try() == [0, *range(2, count)]


def half_square(y):
    return 0.5 * float(y[0, 0]) ** 2


class NeverExact(Script):
    """R = y, whose exact matrix is not definite; other directions lead 0.3 of the way."""

    R, potential = staticmethod(lambda y: y), staticmethod(half_square)

    def solve(self, b, rtol=0.0, guess=None):
        self.step = lambda b: 0.3 * b
        step, info = super().solve(b, rtol)
        if self.remedy == EXACT:
            failure = IndefiniteMatrix("not definite")
            failure.so_far = 100 * b
            raise failure
        return step, info


def test_four_iterations_of_a_step_clamp_before_they_add_mass():
    script = NeverExact()
    script.run(1.0)
    remedies = [remedy for _, remedy, _ in script.seen]
    assert [remedy.definite for remedy in remedies[:6]] == [True] * 4 + [False] * 2
    assert [remedy.shift for remedy in remedies[:5]] == [0.0] * 4 + [0.25]


def test_after_four_clamped_iterations_a_solve_cut_short_goes_twice_the_last_way():
    script = NeverExact(takes_short_solves=True)
    script.run(1.0)
    places = [1.0, *(y for y, _, _ in script.seen)]
    ways = -np.diff(places)
    assert ways[:4] == pytest.approx(0.3 * 0.7 ** np.arange(4))
    assert script.seen[4][1] == EXACT
    assert ways[4] == pytest.approx(2 * ways[3])


@pytest.mark.parametrize(("short", "rtol"), [(True, 0.1), (False, 0.01)])
def test_contact_solves_with_a_clamped_matrix_to_a_tenth_only(short, rtol):
    script = NeverExact(takes_short_solves=short)
    script.run(1.0)
    assert script.rtols[0] == 0.01  # the exact matrix
    assert script.rtols[1] == rtol


def stalling(left=0.45, way=0.9e-7, noise=0.1, scale=1.0):
    """The counts where the first iteration moves by `way` and leaves a part, the second nothing."""
    parts = (1.0, left, 0.0)
    script = Script(
        R=lambda y: -parts[min(round(y / way), 2)],
        step=lambda b: way,
        noise=noise,
        scale=scale,
    )
    return script.run()


@pytest.mark.parametrize(
    ("given", "newton", "limited"),
    [  # where more than a quarter of the residual is left
        ({"left": 0.25 * 0.8}, 2, 0),
        ({"left": 0.25 * 1.25}, 1, 0),
        # where no node moves by 1e-7 of the cloth
        ({"way": 0.8e-7}, 1, 0),
        ({"way": 1.25e-7}, 2, 0),
        # a residual of eight times the change by the last digits is round-off
        ({"noise": 0.45 / (8 * 0.8)}, 1, 0),
        ({"noise": 0.45 / (8 * 1.25)}, 2, 0),
        # round-off of a millionth of the forces is a cloth at rest
        ({"noise": 0.1, "scale": 0.8 / (0.8 * 1e-6)}, 1, 1),
        ({"noise": 0.1, "scale": 0.8 / (1.25 * 1e-6)}, 1, 0),
    ],
)
def test_round_off_is_looked_for_and_ends_the_iteration(given, newton, limited):
    counts = stalling(**given)
    assert (counts.newton, counts.limited) == (newton, limited)


@pytest.mark.parametrize(("part", "length"), [(0.8, 1.0), (1.25, 0.5)])
def test_a_step_below_1e_6_of_the_cloth_is_judged_by_its_slope(part, length):
    """The residual falls, but less than to its half, and the potential rises by round-off."""
    way = part * 1e-6
    script = Script(
        R=lambda y: -1.0 + 0.3 * min(y / way, 1.0) if y < 1.01 * way else 0.0,
        step=lambda b: way,
        potential=lambda y: float(y[0, 0]),
    )
    script.run()
    assert script.seen[0][2] == length


# --- the line search ------------------------------------------------------------------------------


def search(R, potential=None, enough=0.0, across=0.0, **options):
    """α along the step 1 from y = 0 with R(y) along it and, later, across it; None for none."""

    def at(y):
        r = np.array([[R(float(y[0, 0])), across if y.any() else 0.0]])
        return Point(y, r, float(np.linalg.norm(r)), 1.0)

    step = np.array([[1.0, 0.0]])
    energy = (lambda y: potential(float(y[0, 0]))) if potential else None
    result = find_step(SUMS, at, at(0 * step), step, enough, energy, **options)
    return result and result[1]


@pytest.mark.parametrize(("part", "length"), [(0.8, None), (1.25, 1.0)])
def test_the_potential_must_fall_by_1e_4_of_what_the_slope_promises(part, length):
    assert search(lambda y: -1.0, lambda y: -part * 1e-4 * y, longest=1.5) == length


@pytest.mark.parametrize(("back", "length"), [(0.8 * 0.8, 1.0), (0.8 * 1.25, 0.5)])
def test_without_a_potential_08_of_the_slope_may_point_back(back, length):
    """At the end of the whole step; half of the step ends where nothing points back."""
    assert search(lambda y: -1.0 if y == 0 else back * (2 * y - 1), across=1.0) == length


@pytest.mark.parametrize(("halvings", "length"), [(11, 2.0**-11), (12, None)])
def test_a_step_is_halved_eleven_times(halvings, length):
    def R(y):
        return -1.0 if y == 0 else -0.1 if y < 1.01 * 2.0**-halvings else 1e3

    assert search(R, enough=0.5) == length


def test_a_step_is_doubled_twelve_times():
    """Along a potential that is concave for good."""
    assert search(lambda y: -1.0 - y, lambda y: -y - 0.5 * y**2) == 2.0**12


@pytest.mark.parametrize(("part", "length"), [(0.8, 1.0), (1.25, 2.0)])
def test_without_a_potential_a_step_is_doubled_up_to_100_tiny_ways(part, length):
    """A residual that falls at no α, steeper along the step."""
    tiny = 2.0 * part / 100
    assert search(lambda y: -1.0 - 1e-3 * y if y < 2.5 else 9.0, tiny=tiny) == length


# --- the error left, factors that are kept, limits, loads -----------------------------------------


@pytest.mark.parametrize(("part", "small"), [(0.8, True), (1.25, False)])
def test_the_error_left_may_be_a_twentieth_of_the_estimated_error_in_time(part, small):
    """Of corrections 1 and θ the error left is θ²/(1 − θ)."""
    left = ErrorLeft(unit=2.0, in_time=2.0 * (0.1**2 / 0.9) / (0.05 * part))
    for length in (1.0, 0.1):
        left.correct(Script.system, np.array([[length]]), whole=True)
    assert left.error == pytest.approx(2.0 * 0.1**2 / 0.9)
    assert left.is_small == small
    assert left.to_go(left.error) == pytest.approx(1 / part)


@pytest.mark.parametrize(("name", "price"), [("pardiso", 5.0), ("rslab", 7.0), ("superlu", 20.0)])
@pytest.mark.parametrize(("part", "kept"), [(0.8, True), (1.25, False)])
def test_a_factor_is_kept_while_fewer_solves_are_left_than_a_new_one_costs(name, price, part, kept):
    reuse, linear = FactorReuse(), SimpleNamespace(name=name, prepared=1)
    reuse.record_factor(("key",), linear)
    reuse.record_iteration(0.5, 0.5 ** (part * price), linear)
    assert (reuse.key is not None) == kept


def test_reuse_waits_for_up_to_64_new_factors_after_failures():
    reuse, linear, waits = FactorReuse(), SimpleNamespace(name="pardiso", prepared=1), []
    for _ in range(9):
        reuse.record_factor(("key",), linear)
        reuse.record_iteration(1.5, 0.1, linear)
        waits.append(reuse.wait)
    assert waits == [1, 2, 4, 8, 16, 32, 64, 64, 64]


@pytest.mark.parametrize("longest", [1.0, LONGEST_DIRECTION])
@pytest.mark.parametrize("part", [1.25, 0.8])
def test_a_free_way_is_looked_at_up_to_the_longest_direction(part, longest):
    cloth = fc.Cloth.rectangle(0.2, 0.2, 0.2, "right")
    plane = fc.Obstacle(fc.shapes.Plane((0, 0, 0), (0, 0, 1)), gap=1e-4)
    system = fc.System(cloth, fc.Fabric(0.2, 100.0), [plane])
    x = system.rest().x + [0, 0, 1.0]
    down = np.zeros_like(x)
    down[:, 2] = -(1.0 - 0.2e-4) / (part * longest)
    allowed = largest_step(system, x, down, 0.0, longest)
    assert allowed == pytest.approx(min(part, 1.0) * longest, rel=1e-3)


def test_a_cloth_that_nothing_holds_is_told_after_ten_of_its_extents():
    """It goes by its extent in an iteration at most."""
    cloth = fc.Cloth.rectangle(0.5, 0.5, 0.25, "right")
    system = fc.System(cloth, fc.Fabric(0.2, 100.0), [fc.StVK(), fc.Gravity()])
    with pytest.raises(fc.EquilibriumFailed, match="nothing holds the cloth") as caught:
        fc.equilibrium(system, system.rest())
    way = -caught.value.state.x[:, 2].mean() / 0.5
    assert 10.0 < way < 12.0


def test_without_an_estimate_auto_ends_at_a_residual_of_1e_6():
    assert fc.Newton().residual == 1e-6


@pytest.mark.parametrize(("slack", "is_told"), [(8, False), (12, True)])
def test_with_contact_a_tenth_of_the_triangles_may_be_slack(slack, is_told, monkeypatch):
    stretches = np.where(np.arange(100) < slack, 0.9, 1.1)[:, None] * [1.0, 0.7]
    monkeypatch.setattr(static_equation, "principal_stretches", lambda cloth, x: stretches)
    cloth = fc.Cloth.rectangle(0.5, 0.5, 0.25, "right")
    plane = fc.Obstacle(fc.shapes.Plane((0, 0, -1), (0, 0, 1)), 1e-3)
    system = fc.System(cloth, fc.Fabric(0.2, 100.0), [fc.StVK(), plane])
    start = system.rest()
    failure = StaticEquation(system, start).failure("why", Point(start.x, start.x, 1.0, 1.0), 1.0)
    assert ("triangles are slack" in str(failure)) == is_told
