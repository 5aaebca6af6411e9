"""The parts of a cloth put together are the whole: forces, tangents, energies, powers, stress."""

import numpy as np
import pytest
from scipy import sparse
from support.local_link import LocalLink
from support.sliders import Sliders

import fecloth as fc
from fecloth.distributed import distributed_system
from fecloth.distributed.distributed_system import DistributedSystem
from fecloth.errors import InputError
from fecloth.linalg.block_matrix import BlockMatrix
from fecloth.stability.lanczos_estimate import largest_rates
from fecloth.terms.step_difference import StepDifference

FABRIC = fc.Fabric(
    areal_density=0.2,
    tensile_stiffness=(900.0, 700.0),
    poisson_ratio=0.2,
    shear_stiffness=60.0,
    bending_rigidity=(2e-5, 1e-5),
    bending_hysteresis=(4e-4, 2e-4),
)
EVEN = fc.Fabric(areal_density=0.2, tensile_stiffness=900.0, bending_rigidity=1e-5)
LIFT = fc.Pin("left", motion=("0", "0", "0.1*t*(1+Y)"))
LOADS = [fc.Gravity(), fc.Pressure("3*t"), fc.Wind((2.0, 0.5, 0.3), 0.4), fc.MassDamping(0.3)]
HELD = fc.Pin("left", clamp=True, rotate=fc.Rotation((0, 0, 0), (0, 1, 0), "0.3*t"))
EDGES = [
    fc.EdgeForce("right", normal=3.0, tangent="2*t"),
    fc.EdgeForce("right", normal=3.0, tangent="2*t", follow=True),
    fc.EdgeForce(lambda X: X[:, 1] > 0.2, (1, "t", 2.0), follow=True),
]
CASES = {  # terms and pins
    "membranes": ([fc.StVK(), fc.HingeBending(), *LOADS], [LIFT]),
    "damping": (
        [fc.StVK(), fc.StrainRateDamping(0.01), fc.QuadraticBending(), fc.BendingDamping(0.02)],
        [fc.Slide("left", normal=(1, 0, 0))],
    ),
    "step": ([fc.StVK(), fc.StrainRateDamping(0.01, rate="step")], ["left"]),
    "plate": ([fc.TensorCondition(300.0), fc.PlateBending(rest="start"), fc.Drag(0.5)], [HELD]),
    "friction": ([fc.StVK(), fc.PlateBending(), fc.BendingFriction()], [HELD]),
    "P2 friction": ([fc.StVK(), fc.BendingFriction(5.0)], [LIFT]),
    "even springs": (
        [
            fc.Springs("van_gelder", damping=0.01),
            fc.Tether("right", (1, 1, 1), 5.0),
            fc.PointForce("top", (0, 1, 0)),
        ],
        ["left"],
    ),
    "grid": ([fc.Springs(bend=5.0), fc.Gravity()], ["left"]),
    "even biquadratic": ([fc.Springs("biquadratic"), fc.BaraffWitkin()], ["left"]),
    "even laws": (
        [
            fc.NeoHookean(),
            fc.TensionField(),
            fc.MembraneTable([(1.02, 5.0), (1.06, 50.0)]),
            fc.BendingDamping(0.1, law=fc.PlateBending()),
        ],
        [],
    ),
    "P2": ([fc.StVK(), fc.PlateBending(), fc.Pressure(4.0), fc.MassDamping(1.0)], [LIFT]),
    "edges": (EDGES, ["left"]),
    "P2 edges": (EDGES, ["left"]),
    "P2 damping": (
        [fc.StVK(strain="pointwise"), fc.StrainRateDamping(0.01), fc.BendingDamping(0.1)],
        ["left"],
    ),
}


def both(case, parts, most=0.75):
    """A system and the same in parts, and a crumpled state with velocities."""
    terms, pins = CASES[case]
    element, fabric = "P2" if "P2" in case else "P1", EVEN if "even" in case else FABRIC
    pattern = "right" if case == "grid" else "unstructured"
    cloth = fc.Cloth.rectangle(6.0, 0.25, 0.1, pattern, element)
    x, v = np.random.default_rng(1).normal(size=(2, len(cloth.X), 3)) * [[[0.004]], [[0.3]]]
    X, Y = cloth.X.T
    x += np.column_stack([X, Y, 0.05 * np.sin(7 * X + 2 * Y)])
    start = fc.System(cloth, fabric, []).state(x * [1, 1, 0.5], v)
    whole = fc.System(cloth, fabric, terms, pins, start=start)
    apart = DistributedSystem(cloth, fabric, terms, pins, start=start, link=LocalLink(parts))
    assert min(len(part.nodes) for part in apart.parts) < most * len(cloth.X)
    return whole, apart, whole.state(x, v, 0.7)


def together(apart, J):
    """The matrix of all parts, as one of SciPy."""
    n, total = 3 * len(apart.cloth.X), 0
    for worker in apart.link.workers:
        A = worker.matrix.to_scipy().tocoo()
        nodes, own = worker.part.nodes, worker.part.is_own[A.row // 3]
        row, column = (3 * nodes[i // 3] + i % 3 for i in (A.row[own], A.col[own]))
        total = total + sparse.coo_matrix((A.data[own], (row, column)), (n, n)).tocsr()
    assert total.nnz
    return total


def close(a, b, scale=None):
    scale = np.abs(b).max() if scale is None else scale
    assert np.abs(a - b).max() <= 1e-11 * max(scale, 1e-30)


@pytest.mark.parametrize("case", CASES)
def test_forces_energies_and_stress(case):
    whole, apart, state = both(case, 3)
    assert apart.names == whole.names
    close(apart.force(state), whole.force(state))
    ours, theirs = apart.energies(state), whole.energies(state)
    assert ours.keys() == theirs.keys()
    for name in theirs:
        assert ours[name] == pytest.approx(theirs[name], rel=1e-11)
    for of_parts, single in zip(apart.bound, whole.bound, strict=True):
        assert of_parts.supplies == single.supplies
        for name in ("power", "supply"):
            power = getattr(single, name)(state.x, state.v, state.t)
            assert getattr(of_parts, name)(state.x, state.v, state.t) == pytest.approx(power, 1e-11)
        if single.has_stress:
            a, b = np.zeros((2, len(whole.cloth.triangles), 4))
            of_parts.add_stress(state.x, a)
            single.add_stress(state.x, b)
            close(a, b)
        if single.has_curves:
            area = single.beyond(state.x, state.t)
            assert of_parts.beyond(state.x, state.t) == pytest.approx(area)
            assert 0.01 < area / whole.cloth.area < 0.99
        if single.recovers_strain:
            error = single.strain_error(state.x, state.t)
            close(of_parts.strain_error(state.x, state.t), error)
        at = (whole.rest().x, 0.0), (state.x, 0.7), [(state.x, 0.7)]
        assert of_parts.work_of_clamps(*at) == pytest.approx(single.work_of_clamps(*at), 1e-9)


def check_tangents(whole, apart, state):
    for definite in (False, True):
        J, own = BlockMatrix.zeros(whole.pattern), BlockMatrix.zeros(apart.pattern)
        whole.project(whole.assemble(J, state, 0.9, 1.1, 130.0, definite))
        apart.project(apart.assemble(own, state, 0.9, 1.1, 130.0, definite))
        difference = abs(together(apart, own) - J.to_scipy()).max()
        assert difference <= 1e-11 * np.abs(J.values).max()


@pytest.mark.parametrize("case", CASES)
def test_tangents(case):
    check_tangents(*both(case, 3))


@pytest.mark.parametrize("case", ["friction", "P2 friction"])
def test_the_history_of_friction_over_a_step(case):
    whole, apart, state = both(case, 3)
    begin = whole.state(whole.rest().x * [1, 1, 0] + 0.3 * state.x * [0, 0, 1])
    records = whole.start_history(begin), apart.start_history(begin)
    step = StepDifference.between(begin.x, 0.1, 0.6)
    whole, apart = whole.over_step(step, records[0]), apart.over_step(step, records[1])
    close(apart.force(state), whole.force(state))
    assert apart.energies(state) == pytest.approx(whole.energies(state), rel=1e-11)
    ours, theirs = apart.bound[-1], whole.bound[-1]
    assert ours.dissipation(state.x) == pytest.approx(theirs.dissipation(state.x), 1e-11)
    assert theirs.dissipation(state.x) > 1e-6
    slid, expected = (each.commit(state.x, 0.7).curvature for each in (ours, theirs))
    close(slid, expected)
    after = [
        each.with_history(r)
        for each, r in ((ours, slid), (theirs, expected))
        for r in [type(records[0][-1])(r)]
    ]
    shown = [each.cells(state.x, 0.7) for each in after]
    close(shown[0]["friction_moment"], shown[1]["friction_moment"])


@pytest.mark.parametrize("case", ["step", "damping", "plate", "even springs", "P2 damping"])
@pytest.mark.parametrize("at_mean", [False, True])
def test_terms_over_a_step(case, at_mean):
    whole, apart, state = both(case, 3)
    x = whole.rest().x
    step = StepDifference(x, 0.1, 0.05, ((0.7, x), (0.3, 1.1 * x)), at_mean)
    of_parts, single = apart.over_step(step), whole.over_step(step)
    close(of_parts.force(state), single.force(state))
    for a, b in zip(of_parts.bound, single.bound, strict=True):
        assert a.has_energy == b.has_energy
        if b.has_energy:
            assert a.energy(state.x, 0.7) == pytest.approx(b.energy(state.x, 0.7), 1e-11)
        if b.dissipates_over_step:
            assert a.dissipation(state.x) == pytest.approx(b.dissipation(state.x), 1e-11)
    del of_parts, a
    apart.force(state)
    assert all(len(w.terms) == len(apart.crew.here.system.bound) for w in apart.link.workers)


@pytest.mark.parametrize("case", ["membranes", "P2"])
def test_any_division_will_do(case, monkeypatch):
    """As pymetis divides a mesh: the nodes of a part do not follow one another."""

    def quarters(cloth, count):
        owner = np.where(np.sin(2 * cloth.X[:, 0]) > 0.2, 0, 1 + (cloth.X[:, 1] > 0.12))
        if cloth.element == "P2":
            for midpoint, end in ((3, 0), (4, 1), (5, 0)):
                owner[cloth.stencil[:, midpoint]] = owner[cloth.stencil[:, end]]
        return owner

    monkeypatch.setattr(distributed_system.partition, "find_owners", quarters)
    whole, apart, state = both(case, 3, most=1.1)
    close(apart.force(state), whole.force(state))
    assert apart.energies(state) == pytest.approx(whole.energies(state), rel=1e-11)
    check_tangents(whole, apart, state)


def test_regions_and_reactions():
    cloth = fc.Cloth.rectangle(1.0, 0.8, 0.1)
    left = cloth.X[cloth.triangles].mean(axis=1)[:, 0] < 0.2
    regions = {"body": np.flatnonzero(~left), "grip": np.flatnonzero(left)}
    cloth = fc.Cloth.from_arrays(cloth.X, cloth.triangles, regions=regions)
    fabric = {"body": EVEN, "grip": FABRIC}
    pins = [fc.Pin(lambda X: X[:, 0] < 0.15)]
    arguments = cloth, fabric, [fc.StVK(), fc.PlateBending()], pins
    whole, apart = fc.System(*arguments), DistributedSystem(*arguments, link=LocalLink(3))
    x = whole.rest().x * 1.02
    state = whole.state(x + 0.01 * np.sin(9 * x[:, [1, 2, 0]]))
    f = whole.force(state)
    close(apart.force(state), f)
    assert apart.force_size(f) == pytest.approx(whole.force_size(f), 1e-9)
    assert largest_rates(apart, state) == pytest.approx(largest_rates(whole, state), 1e-6)


def test_a_term_with_a_history_that_couples_nodes_is_refused_by_name():
    class SharedSliders(Sliders):
        traits = fc.TermTraits(shared=True)

        def stencil(self, cloth):
            return cloth.stencil

    cloth = fc.Cloth.rectangle(1.0, 0.8, 0.4, "right")
    system = DistributedSystem(cloth, EVEN, [SharedSliders()], link=LocalLink(2))
    with pytest.raises(InputError, match="history of Sliders.*several processes"):
        system.start_history(system.rest())
