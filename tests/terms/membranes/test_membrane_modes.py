"""Frequencies of a prestretched membrane out of its plane, from the operators and from a run.

Small motions across a plane under the second Piola–Kirchhoff stress S obey, on reference lengths
and with the reference mass, ρ z̈ = ∇·(S ∇z).
"""

import numpy as np
import pytest
from conftest import affine
from scipy.sparse.linalg import eigsh
from scipy.special import jn_zeros

import fecloth as fc
from fecloth.verify import observed_order

Y, NU, RHO = 1000.0, 0.3, 0.2
WIDTH, HEIGHT, RADIUS = 1.0, 0.7, 0.5
STRETCH = {"rectangle": (1.03, 1.015), "disk": (1.02, 1.02)}


def tension(shape) -> np.ndarray:
    """S₁₁ and S₂₂ [N/m] of plane stress at the Green strains of the two stretches."""
    E = 0.5 * (np.array(STRETCH[shape]) ** 2 - 1)
    return Y / (1 - NU**2) * (E + NU * E[::-1])


def exact(shape) -> np.ndarray:
    """First six frequencies [Hz]; those of the disk by Bessel's zeros, twice for each m > 0."""
    T1, T2 = tension(shape)
    if shape == "rectangle":
        m, n = np.meshgrid(range(1, 8), range(1, 8))
        values = 0.5 * np.sqrt((T1 * (m / WIDTH) ** 2 + T2 * (n / HEIGHT) ** 2) / RHO)
    else:
        zeros = [jn_zeros(m, 6) for m in range(6) for _ in range(2 if m else 1)]
        values = np.array(zeros) * np.sqrt(T1 / RHO) / (2 * np.pi * RADIUS)
    return np.sort(values.ravel())[:6]


def stretched(shape, h, pattern, mass="lumped"):
    """The system, its prestretched state, and an element size √(2 A/m) that refinement changes."""
    if shape == "disk":
        cloth = fc.Cloth.disk(RADIUS, h)
    else:
        cloth = fc.Cloth.rectangle(WIDTH, HEIGHT, h, pattern)
    system = fc.System(cloth, fc.Fabric(RHO, Y, NU), [fc.StVK()], ["boundary"], mass=mass)
    (a, b) = STRETCH[shape]
    state = system.state(affine(cloth, [[a, 0.0], [0.0, b], [0.0, 0.0]]))
    return system, state, np.sqrt(2 * cloth.area / len(cloth.triangles))


def modes(system, state):
    """First six frequencies [Hz] of K u = ω² M u on the free dofs, and their u (6, n, 3)."""
    free = system.free
    K = system.stiffness(state).tocsc()[free][:, free]
    M = system.mass.tocsc()[free][:, free]
    values, vectors = eigsh(K, 6, M, sigma=0.0, which="LM")
    u = np.zeros((6, state.x.size))
    u[:, free] = vectors.T
    order = np.argsort(values)
    return np.sqrt(values[order]) / (2 * np.pi), u[order].reshape(6, -1, 3)


CASES = [
    ("rectangle", "right", "lumped"),
    ("rectangle", "cross", "consistent"),
    ("rectangle", "equilateral", "lumped"),
    ("rectangle", "unstructured", "lumped"),
    ("rectangle", "unstructured", "consistent"),
    ("disk", "unstructured", "lumped"),
    ("disk", "unstructured", "consistent"),
]


@pytest.mark.parametrize(
    ("shape", "pattern", "mass"),
    [CASES[0], *(pytest.param(*case, marks=pytest.mark.stories) for case in CASES[1:])],
)
def test_frequencies_and_their_order(shape, pattern, mass, record_property):
    """Within 1 % at h = L/40, and the norm of the six relative errors falls as h²."""
    errors, sizes = [], []
    for cells in (10, 20, 40):
        system, state, size = stretched(shape, 1.0 / cells, pattern, mass)
        computed, u = modes(system, state)
        assert abs(u[..., :2]).max() < 1e-6 * abs(u[..., 2]).max()  # all six lie across the plane
        sizes.append(size)
        errors.append(computed / exact(shape) - 1)
    order = observed_order(sizes, np.linalg.norm(errors, axis=1))
    record_property("errors", errors[-1].tolist())
    print(f"{shape} {pattern} {mass}: orders {order.round(3)}, errors {errors[-1].round(5)}")
    assert abs(errors[-1]).max() < 0.01
    assert order[-1] == pytest.approx(2, abs=0.15)
    if (shape, mass) == ("rectangle", "consistent"):  # Rayleigh's quotient on a subspace
        assert min(errors[-1]) > 0


@pytest.mark.stories
@pytest.mark.parametrize("method", [fc.ImplicitMidpoint(), fc.CentralDifference()], ids=repr)
@pytest.mark.parametrize("shape", ["rectangle", "disk"])
def test_frequency_of_a_run(shape, method):
    """The first mode, 0.1 mm high, let go from rest: two periods between its zero crossings."""
    system, state, _ = stretched(shape, 1.0 / 40, "unstructured")
    found, u = modes(system, state)
    start = system.state(state.x + 1e-4 * u[0] / abs(u[0]).max())
    explicit = method.traits.explicit
    dt = 0.9 * fc.critical_dt(system, state, method) if explicit else 1 / (60 * found[0])
    weight = system.nodal_mass * u[0, :, 2]
    t, height = [0.0], [weight @ start.x[:, 2]]
    for now, info in fc.march(system, method, start, dt, 2.4 / found[0]):
        t.append(info.t)
        height.append(weight @ now.x[:, 2])
    t, height = np.array(t), np.array(height)
    i = np.flatnonzero(height[:-1] * height[1:] < 0)
    crossings = t[i] - height[i] * (t[i + 1] - t[i]) / (height[i + 1] - height[i])
    frequency = 2 / (crossings[4] - crossings[0])
    print(f"{shape} {method!r}: {frequency:.4f} Hz, exact {exact(shape)[0]:.4f}, dt {dt:.2e}")
    assert frequency == pytest.approx(exact(shape)[0], rel=0.01)
    assert frequency == pytest.approx(found[0], rel=2e-3)
