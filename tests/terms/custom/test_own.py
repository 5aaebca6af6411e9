"""Terms, laws and integrators that a user writes: studies/examples, and what is refused."""

import ast
import contextlib
import io
import re
import tokenize
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import affine, rough

import fecloth as fc
from fecloth.integrators import METHODS
from fecloth.integrators.protocol import MethodTraits
from fecloth.linalg.block_matrix import BlockMatrix
from fecloth.runs.run_scene import run_scene
from fecloth.scene.scene import load_scene
from fecloth.terms.custom.membrane_law import positive
from fecloth.verify import VerificationFailed, check_integrator, check_term

OWN = Path(__file__).parents[3] / "studies" / "examples"
FILES = sorted(OWN.glob("[!_]*.py"))


@pytest.fixture(scope="module")
def own():
    """What each example defines, and what it prints: {"law": .Fung, .pull, .printed}."""
    found = {}
    for path in FILES:
        names, printed = {"__name__": "__main__"}, io.StringIO()
        with contextlib.redirect_stdout(printed):
            exec(compile(path.read_text(encoding="utf-8"), path, "exec"), names)
        found[path.stem] = SimpleNamespace(**names, printed=printed.getvalue())
    return SimpleNamespace(**found)


@pytest.fixture(scope="module")
def cloth():
    return fc.Cloth.rectangle(0.4, 0.3, h=0.1, pattern="right")


def code_lines(text):
    """Lines with code: no blank ones, comments or docstrings."""
    tree, lines = ast.parse(text), set()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.string.strip() and token.type != tokenize.COMMENT:
            lines |= set(range(token.start[0], token.end[0] + 1))
    for node in ast.walk(tree):
        documented = isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef)
        if documented and ast.get_docstring(node) is not None:
            lines -= set(range(node.body[0].lineno, node.body[0].end_lineno + 1))
    return len(lines)


def test_the_counter_counts():
    text = '"""A\n\nb."""\n\nx = [\n    1,  # 1\n]\n# no\n\ndef f():\n    """A."""\n    return x\n'
    assert code_lines(text) == 5


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_each_is_under_forty_lines(path):
    assert 10 < code_lines(path.read_text(encoding="utf-8")) < 40


def test_there_are_three():
    assert [path.stem for path in FILES] == ["integrator", "law", "term"]


def test_the_page_of_terms_shows_the_law_as_it_is():
    page = OWN.parents[1] / "fecloth" / "terms" / "README.md"
    law = next(path for path in FILES if "law" in path.stem).read_text(encoding="utf-8")
    (block,) = re.findall(r"^```python\n(.*?)^```", page.read_text(), re.MULTILINE | re.DOTALL)
    assert block in law


# --- a term ---------------------------------------------------------------------------------------


def test_cloth_on_a_winkler_bed_agrees_with_the_formula(own):
    """S z'' = k z + ρ g with z = 0 at both ends, solved by the test in 2,000 differences."""
    S, k, n = 1000 * 0.5 * (1.1**2 - 1), 1000.0, 2000
    h = 1 / n
    second = (np.eye(n - 1, k=1) + np.eye(n - 1, k=-1) - 2 * np.eye(n - 1)) / h**2
    z = np.linalg.solve(S * second - k * np.eye(n - 1), np.ones(n - 1))[n // 2 - 1]
    coarse, fine = (own.term.sag(k, h) / (k * z) - 1 for h in (0.1, 0.05))
    assert abs(fine) < 2e-3
    assert np.log2(coarse / fine) == pytest.approx(2, abs=0.2)
    lines = re.findall(r"by (\S+) .* formula (\S+)", own.term.printed)
    assert len(lines) == 4
    for found, formula in lines:
        assert float(found) == pytest.approx(float(formula), rel=3e-4)


def test_all_ways_to_write_an_elastic_bed_give_the_same_force(own, cloth, isotropic, rng):
    k, nodes = 300.0, np.arange(len(cloth.X))[:, None]
    ways = [
        own.term.Winkler(k),
        fc.Condition(lambda y: y[:, 0, 2], nodes, k * cloth.load()),
        fc.UserForce((0, 0, f"{-k} * z")),
    ]
    systems = [fc.System(cloth, isotropic, [way]) for way in ways]
    state = systems[0].state(rough(cloth, rng))
    for other in systems[1:]:
        assert abs(other.force(state) - systems[0].force(state)).max() < 1e-12
        assert abs(other.stiffness(state) - systems[0].stiffness(state)).max() < 1e-6  # differences
        assert other.rate_bounds() == pytest.approx(systems[0].rate_bounds(), rel=1e-6)
    energy = 0.5 * k * float(cloth.load() @ state.x[:, 2] ** 2)
    assert systems[0].energies(state)["Winkler"] == pytest.approx(energy, rel=1e-13)
    assert systems[1].energies(state)["Condition"] == pytest.approx(energy, rel=1e-12)


def test_a_bed_bounces_at_its_frequency_and_keeps_its_energy(own, cloth, isotropic):
    """√(k/ρ) for a cloth that moves as one piece; the ledger has a column for the term."""
    k = 300.0
    system = fc.System(cloth, isotropic, [fc.StVK(), own.term.Winkler(k)])
    start = system.state(system.rest().x + [0, 0, 0.01])
    period = 2 * np.pi * np.sqrt(0.2 / k)
    for method in (fc.EnergyMomentum(), fc.CentralDifference()):
        result = fc.run(system, method, start, period / 400, period)
        assert result.state.x[:, 2] == pytest.approx(np.full(len(cloth.X), 0.01), rel=1e-3)
        opening = 0.5 * k * cloth.area * 0.01**2
        assert result.energies["Winkler"][0] == pytest.approx(opening, rel=1e-12)
        assert np.ptp(result.energies["total"] + result.energies["numerical"]) < 1e-6 * opening


@pytest.mark.parametrize(
    ("method", "said"),
    [("energy", "^force of"), ("add_tangent", "^x-tangent of .* 9.9e-03 9.9e-03")],
)
def test_check_term_catches_a_term_that_is_wrong(own, monkeypatch, method, said):
    right = getattr(own.term.BoundWinkler, method)

    def wrong(self, *arguments):
        return right(replace(self, k=1.01 * self.k), *arguments)

    check_term(own.term.Winkler(300.0), scales=[1.0])
    monkeypatch.setattr(own.term.BoundWinkler, method, wrong)
    with pytest.raises(VerificationFailed, match=said):
        check_term(own.term.Winkler(300.0), scales=[1.0])


class Stub:
    """A term that gives what it is told."""

    def __init__(self, stencil=None, bound=None):
        self.stencil = lambda cloth: stencil
        self.bind = lambda panel, slots: bound


HALF = SimpleNamespace(name="half", has_energy=True, dissipative=True, add_force=None)


@pytest.mark.parametrize(
    ("term", "said"),
    [
        (Stub([[0, 1]]), r"Stub: stencil\(cloth\) = \[\[0, 1\]\]: must be an array \(m, k\)"),
        (Stub(np.zeros(3, int)), r"of shape \(3,\) and type int64: must be an array \(m, k\)"),
        (Stub(np.zeros((3, 1))), r"of shape \(3, 1\) and type float64: must be an array"),
        (Stub(np.array([[0, 20]])), r"with the nodes 0 … 20: must lie in 0 … 19"),
        (Stub(np.array([[-1, 2]])), r"with the nodes -1 … 2: must lie in 0 … 19"),
        (Stub(), r"gives a NoneType: must have name, symmetric, has_energy"),
        (Stub(bound=HALF), "symmetric, velocity_dependent, add_tangent, rate_bounds, energy, po"),
    ],
    ids=lambda value: "" if isinstance(value, Stub) else value[:30],
)
def test_system_names_the_missing_members_of_a_term(cloth, isotropic, term, said):
    with pytest.raises(fc.InputError, match=said):
        fc.System(cloth, isotropic, [term])


# --- a law ----------------------------------------------------------------------------------------


def fung(E, C, strain):
    """W, S (2, 2) of the formula, with sums over the tensors."""
    C11, C22, C66, C12, C16, C26 = C
    T = np.array([[C11 * E[0, 0] + C12 * E[1, 1] + 2 * C16 * E[0, 1], np.nan], [np.nan, np.nan]])
    T[1, 1] = C12 * E[0, 0] + C22 * E[1, 1] + 2 * C26 * E[0, 1]
    T[0, 1] = T[1, 0] = C16 * E[0, 0] + C26 * E[1, 1] + 2 * C66 * E[0, 1]
    c = strain**2 * C11
    grown = np.exp(np.sum(T * E) / c)
    return c / 2 * (grown - 1), grown * T


def test_energy_and_stress_are_those_of_the_formula(own, cloth, orthotropic):
    F = np.array([[1.1, 0.05], [0.0, 0.95], [0.2, 0.1]])
    E = 0.5 * (F.T @ F - np.eye(2))
    W, S = fung(E, orthotropic.moduli(), 0.15)
    system = fc.System(cloth, orthotropic, [own.law.Fung(0.15)])
    x = affine(cloth, F)
    out = np.zeros((len(cloth.triangles), 4))
    system.bound[0].add_stress(x, out)
    expected = np.tile([S[0, 0], S[1, 1], S[0, 1], W], (len(out), 1))
    np.testing.assert_allclose(out, expected, rtol=1e-11)
    assert system.energies(system.state(x))["Fung"] == pytest.approx(W * 0.12, rel=1e-11)


def test_fung_law_agrees_with_its_formula(own):
    """P₁₁ = λ Y E exp((E/ε)²) with E = (λ² − 1)/2, for ν = 0."""
    lines = re.findall(r"stretch (\S+): +(\S+) N/m, with StVK +(\S+) N/m", own.law.printed)
    assert len(lines) == 4
    for stretch, force, linear in np.array(lines, dtype=float):
        E = (stretch**2 - 1) / 2
        assert linear == pytest.approx(stretch * 1000 * E, abs=0.06)
        assert force == pytest.approx(stretch * 1000 * E * np.exp((E / 0.2) ** 2), abs=0.06)


@pytest.mark.parametrize("name", [*METHODS, "central_difference"])
def test_a_law_serves_every_method(own, cloth, isotropic, name):
    """A taut sheet that swings, with damping by the law's own ℂ₀."""
    law = own.law.Fung(0.15)
    terms = [law, fc.StrainRateDamping(1e-3, law), fc.Gravity()]
    system = fc.System(cloth, isotropic, terms, pins=["left"])
    start = system.state(system.rest().x * [1.1, 1.05, 1])
    method, dt = (METHODS[name](), 2e-4) if name in METHODS else (fc.CentralDifference(), None)
    result = fc.run(system, method, start, dt, 4e-3)
    moved = result.energies["Fung"][0]
    assert abs(result.energies["remainder"]).max() < 0.02 * moved
    assert result.energies["Fung"][-1] < 0.8 * moved


def test_energy_momentum_keeps_its_energy(own, cloth, isotropic):
    """A free sheet that is let go and turns; the midpoint rule changes it by far more."""
    system = fc.System(cloth, isotropic, [own.law.Fung(0.3)])
    x = 1.1 * system.rest().x
    start, exact = system.state(x, np.cross([0, 0, 5.0], x)), fc.Newton(tolerance=1e-10)
    drift = {}
    for method in (fc.EnergyMomentum(), fc.EnergyMomentum("symmetric"), fc.ImplicitMidpoint()):
        result = fc.run(system, method, start, 1e-3, 0.03, newton=exact)
        drift[repr(method)] = np.ptp(result.energies["total"]) / result.energies["total"][0]
    *kept, lost = drift.values()
    assert max(kept) < 1e-8 < 1e-3 < lost


class Softening(fc.MembraneLaw):
    """W = Y/2 (E:E − 2 (E:E)²): ℂ has negative eigenvalues from |E| = ½ on, less across."""

    def constants(self, fabric):
        return [fabric.tensile[0]]

    @staticmethod
    def law(E, c):
        I = E[0] ** 2 + E[1] ** 2 + 2 * E[2] ** 2
        s, d = c[0] * (1 - 4 * I), -8 * c[0]
        C11, C22, C66 = s + d * E[0] ** 2, s + d * E[1] ** 2, s / 2 + d * E[2] ** 2
        C12, C16, C26 = d * E[0] * E[1], d * E[0] * E[2], d * E[1] * E[2]
        W = c[0] * (0.5 * I - I**2)
        return W, (s * E[0], s * E[1], s * E[2]), (C11, C22, C66, C12, C16, C26)


def test_a_definite_tangent_clamps_a_law_that_is_not_convex(cloth, isotropic):
    system = fc.System(cloth, isotropic, [Softening()])
    check_term(Softening(), cloth, isotropic, scales=[1.0])
    state = system.state(affine(cloth, [[1.25, 0.2], [0.0, 1.2], [0.0, 0.0]]))
    J = BlockMatrix.zeros(system.pattern)
    least = {}
    for definite in (False, True):
        A = system.assemble(J, state, wx=1.0, definite=definite).to_scipy().toarray()
        values = np.linalg.eigvalsh(A)
        least[definite] = values[0] / values[-1]
    assert least[False] < -0.1
    assert least[True] > -1e-12


def test_clamping_moduli_preserves_the_positive_part(rng):
    at = [[0, 3, 4], [3, 1, 5], [4, 5, 2]]
    for values in ([3.0, 2.0, 1.0], [3.0, -2.0, 1.0], [3.0, -2.0, -1.0], [-3.0, -2.0, -1.0]):
        turn, _ = np.linalg.qr(rng.standard_normal((3, 3)))
        A, expected = (turn @ np.diag(d) @ turn.T for d in (values, np.maximum(values, 0)))
        given = A[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
        np.testing.assert_allclose(np.array(positive(tuple(given)))[at], expected, atol=1e-14)


def linear(E, c, S12=1.0, C66=1.0, C12=0.0):
    """StVK of Y = 1000 N/m and ν = 0, spoiled."""
    S = 1000 * E[0], 1000 * E[1], S12 * 1000 * E[2]
    W = 500 * (E[0] ** 2 + E[1] ** 2 + 2 * E[2] ** 2)
    return W, S, (1000, 1000, C66 * 500, C12, 0, 0)


def law_of(function, constants=(0.0,)):
    made = {"law": function, "constants": lambda self, fabric: constants}
    return type("Mine", (fc.MembraneLaw,), made)()


def test_a_law_may_have_no_stiffness_in_shear(cloth, isotropic):
    """Two families of yarns: the bound is that of ℂ as it is, for ℂ = 1000 diag(1, 1, 0)."""

    def yarns(E, c):
        W = 500 * (E[0] ** 2 + E[1] ** 2)
        return W, (1000 * E[0], 1000 * E[1], 0), (1000, 1000, 0, 0, 0, 0)

    yarns = law_of(staticmethod(yarns))
    system = fc.System(cloth, isotropic, [yarns])
    stiff = fc.System(cloth, fc.Fabric(0.2, 1000.0, 0.0, 1e-6), [fc.StVK()])
    assert system.rate_bounds() == pytest.approx(stiff.rate_bounds(), rel=1e-6)


@pytest.mark.parametrize(
    ("law", "said"),
    [
        (law_of(None), "law = None: must be a function of E and c, under @staticmethod"),
        (
            law_of(lambda self, E, c: linear(E, c)),
            "law = the function .*: must be a function",
        ),
        (law_of(staticmethod(lambda E, c: 1.0)), r"law\(E, c\): .*must return W, \(S11, S22"),
        (
            law_of(staticmethod(lambda E, c: (0.0, (1, 2, 3), (1, 2, 3)))),
            r"law\(E, c\) with S \(3,\) and C \(3,\): must return W",
        ),
        (law_of(staticmethod(lambda E, c: linear(E, c, S12=2))), "S12 = 10 .* of W give 5"),
        (law_of(staticmethod(lambda E, c: linear(E, c, C66=2))), "C66 = 1000 .* of S give 500"),
        (law_of(staticmethod(lambda E, c: linear(E, c, C12=3.0))), "C12 = 3 .* of S give"),
        (law_of(staticmethod(lambda E, c: linear(E, (c[1],)))), r"law\(E, c\): index 1 is out"),
        (
            law_of(staticmethod(lambda E, c: (1 / E[0], *linear(E, c)[1:]))),
            "law at E = 0 gives .*nan.*: must be finite",
        ),
        (law_of(staticmethod(linear), [1.0, np.nan]), "constants = .*must be a list of finite"),
        (law_of(staticmethod(lambda E, c: nothing)), r"law\(E, c\): name 'nothing' is not defined"),  # noqa: F821 - the mistake
        (law_of(staticmethod(linear), ["Y"]), "constants: could not convert"),
        (law_of(staticmethod(linear), 3.0), r"constants of shape \(\)"),
        (law_of(staticmethod(lambda E, c: linear(E, c))), "law: .*'linear'.*must be what"),
    ],
)
def test_a_law_that_is_wrong_is_refused_with_its_numbers(cloth, isotropic, law, said):
    with pytest.raises(fc.InputError, match=rf"^Mine(\.constants)?: {said}"):
        fc.System(cloth, isotropic, [law])


# --- an integrator --------------------------------------------------------------------------------


def test_integrators_agree_with_their_stability_functions(own):
    """R(z) at z = iω dt: of θ (1 + (1 − θ) z)/(1 − θ z), of SDIRK2 (1 + (1 − 2γ) z)/(1 − γ z)²."""
    omega = np.array([1e-2, 0.3, 1.0, 30.0])
    z, gamma = 1j * omega, 1 - np.sqrt(0.5)
    found = fc.stability.amplification(own.integrator.SDIRK2(), omega)
    assert found == pytest.approx(abs((1 + (1 - 2 * gamma) * z) / (1 - gamma * z) ** 2), rel=1e-10)
    for theta in (0.5, 0.6, 1.0):
        found = fc.stability.amplification(own.integrator.Theta(theta), omega)
        assert found == pytest.approx(abs((1 + (1 - theta) * z) / (1 - theta * z)), rel=1e-10)


def test_the_example_prints_their_orders(own):
    lines = re.findall(r"(\w+)\(.*order (\S+), at .* by \[(\S+) +(\S+)\]", own.integrator.printed)
    assert [line[0] for line in lines] == ["Theta", "SDIRK2", "BDF2"]
    orders, slow, fast = np.array([line[1:] for line in lines], dtype=float).T
    assert orders == pytest.approx([1, 2, 2], abs=0.1)
    assert fast[0] == pytest.approx(0.4 / 0.6, abs=1e-6)  # (1 − θ)/θ
    assert fast[1] < 1e-5
    assert 1 - slow[1] < 0.1 * (1 - slow[2])


@pytest.fixture(scope="module")
def swinging(cloth, isotropic):
    """A damped sheet, taut, one of whose edges is moved along an arc."""
    lift = fc.Pin("left", lambda t: [0.05 * np.sin(20 * t), 0, 0.05 * (1 - np.cos(20 * t))])
    terms = [fc.StVK(), fc.StrainRateDamping(1e-3), fc.Gravity()]
    system = fc.System(cloth, isotropic, terms, pins=[lift, "right"])
    return system, system.state(system.rest().x * [1.1, 1.05, 1])


def test_they_serve_a_run_with_moved_pins_and_its_ledger(own, swinging, cloth):
    """The pinned edge is where it should be; half the step leaves a quarter of the remainder."""
    system, start = swinging
    edge, remainders = cloth.nodes("left"), {}
    for method in (own.integrator.SDIRK2(), own.integrator.Theta(0.6)):
        for dt in (1e-3, 5e-4):
            result = fc.run(system, method, start, dt, 0.05)
            at = [0.05 * np.sin(1.0), 0, 0.05 * (1 - np.cos(1.0))]
            assert abs(result.state.x[edge] - start.x[edge] - at).max() < 1e-12
            speed = [np.cos(1.0), 0, np.sin(1.0)]
            np.testing.assert_allclose(
                result.state.v[edge], np.tile(speed, (len(edge), 1)), 1e-6, 1e-6
            )
            remainders[repr(method), dt] = abs(result.energies["remainder"][-1])
            assert remainders[repr(method), dt] < 0.02 * result.energies["StVK"][0]
            assert result.energies["numerical"][-1] > 0
    assert remainders["SDIRK2()", 1e-3] > 3 * remainders["SDIRK2()", 5e-4]


def test_steps_may_be_chosen_by_the_error(own, swinging):
    system, start = swinging
    for method in (own.integrator.SDIRK2(), fc.BDF2()):
        result = fc.run(system, fc.Adaptive(method, rtol=1e-2), start, None, 0.05)
        assert len(result.times) > 10
        if isinstance(method, own.integrator.SDIRK2):
            found = result
    assert len(found.times) < len(result.times)  # its error constant is five times smaller


def test_check_integrator_catches_a_wrong_order(own, cloth, isotropic):
    system = fc.System(cloth, isotropic, [fc.StVK(), fc.Gravity()], pins=["boundary"])
    start = system.state(system.rest().x * [1.1, 1.1, 1])
    theta = own.integrator.Theta
    claims = type("Claims", (theta,), {"traits": MethodTraits(order=2)})
    check_integrator(system, theta(0.6), start, 0.005)
    with pytest.raises(VerificationFailed, match=r"orders \[.* expected 2"):
        check_integrator(system, claims(0.6), start, 0.005)
    check_integrator(system, claims(0.5), start, 0.005)


def test_missing_members_of_a_method_are_named(own, swinging):
    system, start = swinging
    euler, theta = fc.BackwardEuler(), own.integrator.Theta
    offers = {"step": euler.step, "traits": euler.traits}
    bare = type("Bare", (), offers)()
    with pytest.raises(fc.InputError, match="run: method Bare: must have numerical"):
        fc.run(system, bare, start, 1e-3, 2e-3, solver="direct")
    assert len(list(fc.march(system, bare, start, 1e-3, 2e-3, solver="direct"))) == 2

    for traits, said in ({}, "must have traits"), ({"traits": {"order": 1}}, "must be a MethodTr"):
        mute = type("Mute", (), {"step": euler.step} | traits)()
        with pytest.raises(fc.InputError, match=said):
            fc.run(system, mute, start, 1e-3, 2e-3)

    for constant, said in (None, "has no estimate"), (-0.04, "error_constant = -0.04: must be a n"):
        traits = MethodTraits(order=1, error_constant=constant)
        with pytest.raises(fc.InputError, match=said):
            fc.Adaptive(type("Own", (theta,), {"traits": traits})(), rtol=1e-2)

    traits = MethodTraits(order=1, error_constant=1 / 2)
    nothing = {"step": lambda self, *rest: None, "traits": traits}
    empty = type("Empty", (theta,), nothing)(1.0)
    for method, dt in (empty, 1e-3), (fc.Adaptive(empty, rtol=1e-2), None):
        with pytest.raises(fc.InputError, match=r"Empty.step\(...\) returns None: must return"):
            next(fc.march(system, method, start, dt, 2e-3, solver="direct"))
    unknown = type("Unknown", (theta,), {"traits": MethodTraits(order=1)})(1.0)
    with pytest.raises(fc.InputError, match="Unknown has no traits.error_constant"):
        next(fc.march(system, unknown, start, t_end=2e-3))

    def short(self, state, dt):
        return replace(theta.stage(self, state, dt), v=state.v[1:])

    cut = type("Cut", (theta,), {"stage": short})(0.5)
    with pytest.raises(fc.InputError, match=r"stage.v of shape \(19, 3\): must be \(20, 3\)"):
        fc.run(system, cut, start, 1e-3, 2e-3, solver="direct")


def test_a_misspelt_trait_is_an_error_that_names_the_known_ones():
    with pytest.raises(
        fc.InputError, match=r"trait 'explict': is not known; the traits are order, "
    ):
        MethodTraits(order=1, explict=True)
    with pytest.raises(TypeError, match="order"):
        MethodTraits(theta=1.0)
    with pytest.raises(fc.InputError, match="no explicit method is A-stable"):
        MethodTraits(order=1, explicit=True)


# --- in a scene -----------------------------------------------------------------------------------

SCENE = """
[cloth]
shape = "rectangle"
width = 0.4
height = 0.3
h = 0.1
pattern = "right"

[fabric]
areal_density = 0.2
tensile_stiffness = 1000.0

[[terms]]
type = "Fung"
strain = 0.15

[[terms]]
type = "StrainRateDamping"
time = 1e-3
law = { type = "Fung" }

[[terms]]
type = "Winkler"
k = 300.0

[[pins]]
where = "left"

[start]
position = ["X", "Y", "0.05 * X"]

[time]
method = "bdf2"
dt = 1e-3
t_end = 5e-3
"""


def test_scene_runs_with_user_terms(own, tmp_path):
    terms = {"Winkler": own.term.Winkler, "Fung": own.law.Fung}
    path = tmp_path / "scene.toml"
    path.write_text(SCENE, encoding="utf-8")
    scene = load_scene(path, terms=terms)
    system = scene.build().system
    assert system.terms[0] == own.law.Fung(0.15)
    assert system.terms[1].law == own.law.Fung(0.2)
    assert system.terms[2] == own.term.Winkler(300.0)
    outcome = run_scene(scene, tmp_path / "out")
    assert outcome.status == "done"
    header = (tmp_path / "out" / "energies.csv").read_text().splitlines()[0]
    assert header.split(",")[:4] == ["t", "kinetic", "Fung", "Winkler"]
    assert load_scene(tmp_path / "out" / "scene.resolved.toml", terms=terms) == scene
    assert load_scene(path, ["terms.2.k=20"], terms=terms).terms[2].make().k == 20


def test_scene_refuses_an_unknown_user_term(own, tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text(SCENE, encoding="utf-8")
    winkler, fung = own.term.Winkler, own.law.Fung
    with pytest.raises(fc.SceneError, match=r"terms.0.type = 'Fung': must be one of BaraffWitkin"):
        load_scene(path)
    with pytest.raises(fc.SceneError, match=r"terms.2.type = 'Winkler': must be one of .*, Fung"):
        load_scene(path, terms={"Fung": fung})
    path.write_text(SCENE.replace("k = 300.0", "kk = 300.0"), encoding="utf-8")
    with pytest.raises(fc.SceneError, match="terms.2.kk = 300.0: unknown key; the keys are type"):
        load_scene(path, terms={"Winkler": winkler, "Fung": fung})
    with pytest.raises(
        fc.InputError, match="'StVK': must not be the name of a term of the package"
    ):
        load_scene(path, terms={"StVK": fung})
    for wrong in (winkler(1.0), Stub, 3):
        with pytest.raises(fc.InputError, match="must be the class of a term: a dataclass"):
            load_scene(path, terms={"Winkler": wrong})
