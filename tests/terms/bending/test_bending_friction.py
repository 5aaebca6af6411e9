"""`BendingFriction`: its law, and the law as strips, cantilevers and sheets show it."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.plates import PATTERNS, check_slopes, rolled, square
from support.tiers import in_turn, stories_except

import fecloth as fc
from fecloth.nonlinear.increments import LoadIncrement, solve_increment, static_context
from fecloth.terms.sliders import Sliders
from fecloth.terms.step_difference import StepDifference


def follow(bound, states):
    """The bound term over each step between positions x (n, 3), from the record of the first."""
    record = bound.start_history(states[0], 0.0)
    for start, x in pairwise(states):
        over = bound.over_step(StepDifference(start, 1.0, 1.0, ((1.0, start),), history=record))
        record = over.commit(x, 0.0)
        yield over, bound.with_history(record), x


def bent_state(cloth):
    X, Y = cloth.X.T
    return np.column_stack([X, Y, 0.1 * np.sin(3 * X + Y) + 0.1 * X * Y])


def let_go(pattern, n, element="P1"):
    """The curvature along a strip that was bent far to a cylinder, and slowly let go."""
    L = 0.2
    cloth = fc.Cloth.rectangle(L, 0.3 * L, h=L / n, pattern=pattern, element=element)
    bent = 5.0  # 1/m, so that the sliders slid there and slide back
    M = 0.3 * B * bent
    assert bent > M * (1 / B + 2 / (20 * B))
    given = fabric(2 * M)
    hold = np.zeros((len(cloth.X), 3))
    load = fc.UserForce(lambda x, v, t: hold, per="node")
    terms = [fc.StVK(), fc.PlateBending(), fc.BendingFriction(), load]
    pins = [fc.Pin("left", clamp=True)]
    system = fc.System(cloth, given, terms, pins)
    flat, x = system.rest().x, rolled(cloth.X, 1 / bent)
    over, _, _ = next(follow(system.bound[2], [flat, x]))
    history = (None, None, over.commit(x, 0.0), None)
    for term in system.with_history(history).bound[1:3]:  # the membrane of an arc is too short
        term.add_force(x, 0 * x, 0.0, hold)
    hold *= -1
    context = static_context(system, "auto", 200, "direct")
    for part in np.linspace(1, 0, 11)[1:]:
        increment = LoadIncrement(system, system.state(x), part, 0.1, 0.0, 0.0, history)
        solved, over = solve_increment(increment, None, context)
        x = solved.x
        history = over.commit(system.state(x), history)
    kappa, _ = system.bound[1].curvatures(x, 0.0)
    inner = np.abs(cloth.X[cloth.triangles[:, :3]].mean(axis=1)[:, 0] / L - 0.5) < 0.3
    weights = np.repeat(cloth.weights.sum(axis=1), len(kappa) // len(inner))
    inner = np.repeat(inner, len(kappa) // len(inner))
    return np.average(kappa[inner, 0], weights=weights[inner]) / (M / B) - 1


B, HB = 2e-5, 3e-4  # N m, N


def fabric(hysteresis=2 * HB, rigidity=B, **given):
    given = {"areal_density": 0.1, "tensile_stiffness": 200.0} | given
    return fc.Fabric(**given, bending_rigidity=rigidity, bending_hysteresis=hysteresis)


# --- the law alone --------------------------------------------------------------------------------


@pytest.mark.parametrize("m", [1.0, 20.0])
@pytest.mark.parametrize("axis", [0, 1])
def test_a_closed_loop_returns_the_rigidity_and_the_hysteresis(m, axis):
    given = fabric((2 * HB, HB), (B, 3 * B))
    sliders = Sliders.of_fabric(given, m)
    most = 8 * HB / B * max(1.0, 4 / m)
    path = np.concatenate([np.linspace(0, most, 40), np.linspace(most, -most, 81)[1:]])
    path = np.concatenate([path, np.linspace(-most, most, 81)[1:]])
    slid, moments, heats = np.zeros((1, 3)), [], 0.0
    for kappa in path:
        at = np.zeros((1, 3))
        at[0, axis] = kappa
        heats += sliders.heat(at - slid)[0]
        slid = at - sliders.left(at - slid)
        moments.append(given.bending[axis] * kappa + sliders.moment(at - slid)[0, axis])
    down, up = np.array(moments[39:120])[::-1], np.array(moments[119:])
    across = np.linspace(-most, most, 81)
    middle = np.abs(across) < 1e-9 + most / 4
    loop = given.hysteresis[axis]
    assert up[middle] - down[middle] == pytest.approx(loop, rel=1e-12)
    # straight lines of the slope B, half a loop above and below the elastic moment
    assert up[middle] - given.bending[axis] * across[middle] == pytest.approx(loop / 2, rel=1e-12)
    assert np.polyfit(across[middle], up[middle], 1)[0] == pytest.approx(given.bending[axis], 1e-12)
    # what the loop encloses is heat, and half a loop more on the way there; elastic parts are not
    elastic = sliders.limit[0] / sliders.moments[0, axis]
    assert heats == pytest.approx(loop / 2 * (5 * most - (1 + 2 * 2) * elastic), rel=1e-12)


@pytest.mark.parametrize("m", [2.0, 20.0])
def test_a_slider_is_m_times_as_stiff_before_it_slips_at_the_curvature_of_its_moment(m):
    sliders = Sliders.of_fabric(fabric(), m)
    below, above = (np.array([[part * HB / (m * B), 0.0, 0.0]]) for part in (0.8, 1.25))
    assert sliders.moment(below)[0] == pytest.approx([0.8 * HB, 0, 0], rel=1e-14)
    assert sliders.moment(above)[0] == pytest.approx([HB, 0, 0], rel=1e-14)
    assert sliders.heat(below) == 0.0
    assert sliders.heat(above)[0] == pytest.approx(0.25 * HB**2 / (m * B))
    assert sliders.tangent(below)[0] == pytest.approx(m * B * np.diag([1, 1, 0.5]))
    assert sliders.tangent(above)[0] == pytest.approx(m * B * np.diag([0, 0.8, 0.4]), abs=1e-18)


def test_the_law_as_it_is_written():
    """Beside its definition, in numbers that are worked out here."""
    M1, M2, B1, B2, m = 3e-4, 2e-4, 1e-5, 4e-5, 5.0
    sliders = Sliders.of_fabric(fabric((2 * M1, 2 * M2), (B1, B2)), m)
    e11, e22, e12 = 4.0, -3.0, 2.0
    s = np.sqrt((M1 * e11) ** 2 + (M2 * e22) ** 2 + 2 * M1 * M2 * e12**2)
    limit = M1 * M2 / (m * np.sqrt(B1 * B2))
    e = np.array([[e11, e22, 2 * e12]])
    assert s > limit
    assert sliders.energy(e)[0] == pytest.approx(s - limit / 2, rel=1e-14)
    assert sliders.energy(1e-3 * e)[0] == pytest.approx(1e-6 * s**2 / (2 * limit), rel=1e-14)
    assert sliders.moment(e)[0] == pytest.approx(
        [M1**2 * e11 / s, M2**2 * e22 / s, M1 * M2 * e12 / s], rel=1e-14
    )


def test_weakened_sliders_have_their_stiffness():
    sliders = Sliders.of_fabric(fabric(), 20.0)
    weak, e = sliders.weakened(0.3), np.array([[0.01, 0.02, 0.01]])
    assert weak.moment(e) == pytest.approx(sliders.moment(e), rel=1e-14)
    assert weak.moment(1e6 * e) == pytest.approx(0.3 * sliders.moment(1e6 * e), rel=1e-14)
    gone = sliders.weakened(0.0)
    assert not gone.moment(e).any()
    assert not gone.left(e).any()
    assert not gone.energy(e).any()


# --- the term -------------------------------------------------------------------------------------


def strip_between_clamps(pattern, element, M):
    """A strip whose ends are clamped to a cylinder of the curvature t."""
    cloth = square(pattern, 5, element)
    turn = fc.Rotation((1, 0, 0), (0, 1, 0), "-t")
    pins = [
        fc.Pin(lambda X: X[:, 0] < 1e-9, clamp=True),
        fc.Pin(lambda X: X[:, 0] > 1 - 1e-9, clamp=True, rotate=turn, motion=ARC),
    ]
    terms = [fc.PlateBending(), fc.BendingFriction(20.0)]
    return cloth, fc.System(cloth, fabric(2 * M, tensile_stiffness=1.0), terms, pins)


# without cancellation, as a formula in the curvature t
ARC = ("sin(t+1e-12)/(t+1e-12)-1", "0", "2*sin(t/2)**2/(t+1e-12)")


def bent_to(cloth, kappa):
    (X, Y), kappa = cloth.X.T, kappa + 1e-12
    return np.column_stack([np.sin(kappa * X) / kappa, Y, 2 * np.sin(kappa * X / 2) ** 2 / kappa])


@pytest.mark.parametrize("element", ["P1", "P2"])
@pytest.mark.parametrize("pattern", stories_except(PATTERNS, "right", "unstructured"))
def test_a_strip_on_every_pattern_has_the_loop(pattern, element):
    """The moment is the derivative of the energy over a step by the curvature, κL ≤ 1e-3."""
    most = 1e-3
    M = 0.2 * B * most
    cloth, system = strip_between_clamps(pattern, element, M)
    plate, friction = system.bound
    path = np.concatenate([np.linspace(0, most, 9), np.linspace(most, 0, 9)[1:]])
    record, moments = friction.start_history(system.rest().x, 0.0), []
    for start, kappa in pairwise(path):
        step = StepDifference(bent_to(cloth, start), 1.0, 1.0, (), t=kappa - 1.0, history=record)
        over, d = friction.over_step(step), 1e-3 * most
        energies = [
            plate.energy(bent_to(cloth, at), at) + over.energy(bent_to(cloth, at), at)
            for at in (kappa + d, kappa - d)
        ]
        moments.append((energies[0] - energies[1]) / (2 * d * cloth.area))
        record = over.commit(bent_to(cloth, kappa), kappa)
    friction_alone = np.array(moments) - B * path[1:]
    assert friction_alone[4:8] == pytest.approx(M, abs=1e-6 * B * most)
    assert friction_alone[11:15] == pytest.approx(-M, abs=1e-6 * B * most)


@pytest.mark.parametrize(
    ("pattern", "element", "part"),  # 0.1 sticks, 3.0 slides
    [
        *(("unstructured", element, part) for element in ("P1", "P2") for part in (0.1, 3.0)),
        *(in_turn(PATTERNS[:4], ["P1", "P2"], [3.0, 3.0, 0.1, 0.1])),
    ],
)
def test_force_and_tangent_are_derivatives_of_the_energy(pattern, element, part):
    cloth = square(pattern, 4, element)
    given = fabric((2.0 * part, 1.0 * part), (1.0, 0.5), tensile_stiffness=1.0)
    pins = [fc.Pin(lambda X: X[:, 0] < 1e-9, clamp=True)]
    terms = [fc.BendingFriction(5.0), fc.PlateBending()]
    system = fc.System(cloth, given, terms, pins, grain=0.4)
    noise = np.random.default_rng(1).normal(0, 0.01, (len(cloth.X), 3))
    bound = system.bound[0]
    record = bound.start_history(rolled(cloth.X, 2.0), 0.0)
    system = system.with_history((record, None))
    system = system.with_bound([system.bound[0]])
    state = system.state(rolled(cloth.X, 1.0) + noise)
    assert np.abs(system.force(state)).max() > 1e-6
    check_slopes(system, state)


# --- at rest --------------------------------------------------------------------------------------


def cantilever(n, m, share=1.0):
    """Deflection of a strip that was laid down under its weight, and the closed form's.

    The moment of friction is that `share` of the weight's moment in the middle.
    """
    L, part = 0.2, 0.02  # part: of a deflection by L
    w = part * 8 * B / L**3
    M = share * w * L**2 / 8
    cloth = fc.Cloth.rectangle(L, 0.25 * L, h=L / n, pattern="right")
    given = fabric(2 * M, areal_density=w / 9.81, tensile_stiffness=50.0)
    terms = [fc.StVK(), fc.PlateBending(), fc.BendingFriction(m), fc.Gravity()]
    system = fc.System(cloth, given, terms, [fc.Pin("left", clamp=True)])
    laid = fc.equilibrium(system, system.rest())
    tip = -laid.x[np.abs(cloth.X[:, 0] - L) < 1e-9, 2].mean()
    X = np.linspace(0, L, 100_001)
    moment = w * (L - X) ** 2 / 2
    slid = np.maximum(moment - M, 0.0) / B
    kappa = np.where(moment > M * (1 + 1 / m), slid, moment / ((1 + m) * B))
    exact, limit = (np.trapezoid(each * (L - X), X) for each in (kappa, slid))
    return tip, exact, limit, laid


def test_a_cantilever_that_is_laid_down_has_the_closed_form():
    errors = []
    for n in (8, 16):
        tip, exact, _, laid = cantilever(n, 20.0)
        errors.append(tip / exact - 1)
        assert "on the number of load steps, here 20" in laid.reason
    assert errors[1] == pytest.approx(0, abs=0.01)
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2, abs=0.35)
    tip, exact, limit, _ = cantilever(16, 1e4)
    assert tip / limit == pytest.approx(tip / exact, abs=1e-3)


def test_where_the_weight_does_not_overcome_the_friction_there_is_only_its_elastic_part():
    tip, exact, *_ = cantilever(16, 9.0, share=4.4)
    assert tip == pytest.approx(exact, rel=0.01)


@pytest.mark.parametrize("element", ["P1", "P2"])
def test_nothing_depends_on_the_frame(element):
    cloth = square("unstructured", 4, element)
    system = fc.System(cloth, fabric((2 * HB, HB)), [fc.BendingFriction()], grain=0.3)
    R = Rotation.from_rotvec([0.5, -1.0, 0.25]).as_matrix()
    flat = system.rest().x
    states = [flat, 0.3 * bent_state(cloth) + 0.7 * flat, bent_state(cloth)]
    ours = list(follow(system.bound[0], states))[-1]
    theirs = list(follow(system.bound[0], [x @ R.T + [1, 2, 3] for x in states]))[-1]
    assert theirs[0].dissipation(theirs[2]) == pytest.approx(ours[0].dissipation(ours[2]), 1e-11)
    assert ours[0].dissipation(ours[2]) > 0
    f, g = np.zeros((2, *flat.shape))
    ours[1].add_force(ours[2], 0 * flat, 0.0, f)
    theirs[1].add_force(theirs[2], 0 * flat, 0.0, g)
    assert g == pytest.approx(f @ R.T, abs=1e-11 * np.abs(f).max())
    assert np.abs(f.sum(axis=0)).max() < 1e-12 * np.abs(f).sum()
    assert np.abs(np.cross(ours[2], f).sum(axis=0)).max() < 1e-12 * np.abs(f).sum()


def test_regions_and_seams_have_the_moments_of_their_fabrics():
    cloth = square("right", 6)
    left = cloth.X[cloth.triangles].mean(axis=1)[:, 0] < 0.5
    regions = {"a": np.flatnonzero(left), "b": np.flatnonzero(~left)}
    cloth = fc.Cloth.from_arrays(cloth.X, cloth.triangles, regions=regions)
    fabrics = {"a": fabric(2 * HB), "b": fabric(0.0)}
    system = fc.System(cloth, fabrics, [fc.BendingFriction()])
    flat, bent = system.rest().x, rolled(cloth.X, 1.0)
    over, after, x = next(follow(system.bound[0], [flat, bent]))
    moment = np.linalg.norm(after.cells(x, 0.0)["friction_moment"], axis=1)
    X = cloth.X[cloth.triangles].mean(axis=1)[:, 0]
    inside = (X > 1 / 6) & (X < 0.5)  # the free edge at X = 0 has no moment
    assert moment[inside] == pytest.approx(HB, rel=1e-9)
    assert not moment[X > 0.5].any()
    slid = cloth.weights.sum(axis=1)[moment > HB / 2].sum()
    assert over.dissipation(x) == pytest.approx(HB * slid * (1.0 - HB / (20 * B)), rel=1e-2)


@pytest.mark.stories
@pytest.mark.parametrize(("pattern", "element"), [("cross", "P1"), ("unstructured", "P2")])
def test_a_strip_that_is_let_go_rests_at_the_curvature_of_its_friction(pattern, element):
    assert abs(let_go(pattern, 8, element)) < 5e-3


@pytest.mark.stories
def test_shaken_it_rests_where_it_would_without_friction():
    cloth = fc.Cloth.rectangle(0.2, 0.05, h=0.0125, pattern="right")
    pins = [fc.Pin("left", clamp=True)]
    plain = [fc.StVK(), fc.PlateBending(), fc.Gravity()]
    with_friction = fc.System(cloth, fabric(), [*plain, fc.BendingFriction()], pins)
    without = fc.System(cloth, fabric(), plain, pins)
    start = without.rest()
    laid = fc.equilibrium(with_friction, start)
    shaken = fc.equilibrium(with_friction, start, friction="shaken")
    elastic = fc.equilibrium(without, start, load_steps=20)
    far = np.abs(elastic.x - start.x).max()
    assert np.abs(laid.x - elastic.x).max() > 5e-3 * far
    assert np.abs(shaken.x - elastic.x).max() < 1e-6 * far
    with pytest.raises(fc.InputError, match="friction = 'shook'.*laid.*shaken"):
        fc.equilibrium(without, start, friction="shook")
