# ---
# jupyter:
#   jupytext:
#     text_representation: {extension: .py, format_name: percent}
#   kernelspec: {display_name: Python 3, language: python, name: python3}
# ---

# %% [markdown]
# # The dihedral angle
#
# Triangles are flat; a mesh bends at its edges. At an edge $e$ between triangles of normals $m$ and
# $n$ the angle is
#
# $$\theta=\mathrm{atan2}\bigl(\hat e\cdot(n\times m),\ m\cdot n\bigr).$$
#
# Its gradient at the two outer nodes is normal over height, $\hat m/h_m$ and $\hat n/h_n$. The ends
# of the edge balance these, so that the forces have no sum and no moment.
#
# A hinge has the energy $\tfrac k2\theta^2$ with $k=Bl^2/(A_1+A_2)$. It is cheap, and its stiffness
# depends on the mesh: with nodes on a cylinder of curvature $\kappa$ it stores 0.75 to 3 times
# $\tfrac B2\kappa^2$ per area, by pattern and direction, however fine the mesh. `PlateBending`
# joins the angles around each triangle, and has 1.
#
# Which edges of `right` make the factor 3?
#
# <details><summary>Answer</summary>
#
# All of them. Where the cloth bends along the diagonals, horizontal, vertical and diagonal edges
# have $\tfrac B2\kappa^2$ each.
#
# </details>

# %%
import matplotlib.pyplot as plt
import numpy as np

import fecloth as fc
from fecloth.study.figures import STYLE, line_style


def hinge(y):  # θ and ∂θ/∂y of y (4, 3): the ends of the edge, then the outer nodes
    e, a, b = y[1:] - y[0]
    length, m, n = np.linalg.norm(e), np.cross(e, a), np.cross(b, e)
    theta = np.arctan2(e @ np.cross(n, m) / length, m @ n)
    ga, gb = length * m / (m @ m), length * n / (n @ n)  # normals over heights
    s, t = a @ e / length**2, b @ e / length**2  # where the heights meet the edge
    return theta, np.array([(s - 1) * ga + (t - 1) * gb, -s * ga - t * gb, ga, gb])


# %%
plt.style.use(STYLE)
fig, (fold, mesh) = plt.subplots(1, 2, figsize=(10, 4.5), layout="constrained")


def folded(angle):  # the right triangle turns about the edge
    right = [0.3, -0.4 * np.cos(angle), 0.4 * np.sin(angle)]
    return np.array([[0, 0, 0], [0.5, 0, 0], [0.2, 0.6, 0], right])


angles = np.radians(np.linspace(-179, 179, 359))
thetas = np.array([hinge(folded(angle))[0] for angle in angles])
degrees = np.degrees(angles)
fold.plot(degrees, np.degrees(thetas), label="atan2")
fold.plot(degrees, np.degrees(np.arccos(np.cos(angles))), "--", label="arccos")
fold.plot(degrees, np.degrees(np.arcsin(np.sin(angles))), ":", label="arcsin")
fold.set(xlabel="fold [°]", ylabel="angle θ [°]", xticks=range(-180, 181, 90))
turns = np.radians(np.arange(0, 181, 15))
fabric = fc.Fabric(areal_density=0.2, tensile_stiffness=1.0, bending_rigidity=1.0)


def energies(term, pattern, h, radius=2.0):  # of nodes on a cylinder, over its own energy
    cloth = fc.Cloth.rectangle(1.0, 1.0, h, pattern)
    system, energies = fc.System(cloth, fabric, [term]), []
    for direction in np.column_stack([np.cos(turns), np.sin(turns)]):
        along, across = cloth.X @ direction, cloth.X @ [-direction[1], direction[0]]
        x = radius * np.sin(along / radius), across, radius * (1 - np.cos(along / radius))
        energies.append(system.energies(system.state(np.transpose(x)))[type(term).__name__])
    return np.array(energies) / (cloth.area / 2 / radius**2)


limits = {}  # for h → 0: what the border lacks falls with h
for i, term in enumerate((fc.HingeBending(), fc.PlateBending())):
    for j, pattern in enumerate(("right", "cross")):
        limit = 2 * energies(term, pattern, 1 / 16) - energies(term, pattern, 1 / 8)
        limits[type(term), pattern] = limit
        label = f"{type(term).__name__}, {pattern}"
        mesh.plot(np.degrees(turns), limit, **line_style(2 * i + j), label=label)
mesh.set(xlabel="direction of bending [°]", ylabel="energy over the cylinder's [-]", ylim=0)
mesh.set_xticks(range(0, 181, 45))
for ax in (fold, mesh):
    ax.legend()

# %%
y = np.random.default_rng(17).normal(size=(4, 3))
theta, gradient = hinge(y)
for at in np.ndindex(4, 3):
    d = np.zeros((4, 3))
    d[at] = 1e-6
    assert np.isclose((hinge(y + d)[0] - hinge(y - d)[0]) / 2e-6, gradient[at], atol=1e-7)
assert np.allclose(gradient.sum(axis=0), 0, atol=1e-12)
assert np.allclose(np.cross(y, gradient).sum(axis=0), 0, atol=1e-12)
assert np.allclose(thetas, angles, atol=1e-12)
flat, both = folded(0)[:, :2], [[0, 1, 2], [0, 3, 1]]
cloth = fc.Cloth.from_arrays(flat, both, renumber=False)
system = fc.System(cloth, fabric, [fc.HingeBending()])
theta, gradient = hinge(folded(0.7))
k = 0.5**2 / cloth.area
assert np.allclose(system.force(system.state(folded(0.7))), -k * theta * gradient)
right, cross = (limits[fc.HingeBending, pattern] for pattern in ("right", "cross"))
bend = np.array([np.cos(turns) ** 2, np.sin(turns) ** 2, np.sin(2 * turns)])  # κ₁₁, κ₂₂, 2 κ₁₂
assert np.allclose(right, np.sum(bend * (fc.bending_tensor("right") @ bend), axis=0), atol=2e-3)
assert np.allclose((right.min(), right.max()), (0.75, 3), atol=2e-3)
assert np.allclose((cross.min(), cross.max()), (1, 1.5), atol=2e-3)
for pattern in ("right", "cross"):
    assert np.allclose(limits[fc.PlateBending, pattern], 1, atol=2e-3)
