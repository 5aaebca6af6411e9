# ---
# jupyter:
#   jupytext:
#     text_representation: {extension: .py, format_name: percent}
#   kernelspec: {display_name: Python 3, language: python, name: python3}
# ---

# %% [markdown]
# # The mesh in time
#
# A cloth is a mesh of triangles. Its nodes have fixed coordinates $X$ on the flat cloth, two
# numbers each, and a position $x(t)$ in space, three numbers each. The triangles stay the same;
# the positions move. A simulation computes $x(t)$ step by step.
#
# The square is meshed by Gmsh, held along its left edge and let go. The figure shows the mesh at
# three times, and the height of three nodes.
#
# A node far from the pins falls freely until the cloth between them is taut. This method lets it
# fall too deep, by $g\,t\,\Delta t/2$: 7.4 mm at $t = 0.15$ s. Which step would make it 1 mm?
#
# <details><summary>Answer</summary>
#
# 1.4 ms: $\Delta t=2\cdot1\,\mathrm{mm}/(g\,t)$.
#
# </details>

# %%
import matplotlib.pyplot as plt
import numpy as np

import fecloth as fc
from fecloth.study.figures import COLOURS, STYLE

cloth = fc.Cloth.rectangle(1.0, 1.0, h=0.1)  # (n, 2) coordinates X and (m, 3) triangles
fabric = fc.Fabric(areal_density=0.2, tensile_stiffness=1000.0, poisson_ratio=0.3)
system = fc.System(cloth, fabric, [fc.StVK(), fc.Gravity()], pins=["left"])

start, dt = system.rest(), 0.01
steps = fc.march(system, fc.BackwardEuler(), start, dt, t_end=0.6)
states = [start, *(state for state, info in steps)]
t = np.array([state.t for state in states])
x = np.array([state.x for state in states])  # (k, n, 3): k states of n nodes

# %%
plt.style.use(STYLE)
fig = plt.figure(figsize=(10, 4.5), layout="constrained")
space, height = fig.add_subplot(121, projection="3d"), fig.add_subplot(122)
for k, colour in zip((0, 25, 50), COLOURS, strict=False):
    look = {"color": colour, "edgecolor": "0.3", "lw": 0.3, "alpha": 0.7}
    space.plot_trisurf(*x[k].T, triangles=cloth.triangles, label=f"t = {t[k]:.2f} s", **look)
space.set(xlabel="x [m]", ylabel="y [m]", zlabel="z [m]", xticks=(0, 0.5, 1), yticks=(0, 1))
space.zaxis.labelpad = 12
space.set_box_aspect((2, 2, 1.6), zoom=0.85)
for X, colour in zip((0.2, 0.5, 1.0), COLOURS[3:], strict=False):
    node = np.argmin(np.linalg.norm(cloth.X - (X, 0.5), axis=1))
    height.plot(t, x[:, node, 2], color=colour, label=f"node near X = ({X}, 0.5) m")
height.plot(t, -9.81 * t**2 / 2, "k:", label="free fall, exact")
height.set(xlabel="time t [s]", ylabel="height z [m]", ylim=(-1.1, 0.05))
for ax, place in ((space, "upper left"), (height, "lower left")):
    ax.legend(loc=place)

# %%
pinned, right = cloth.nodes("left"), cloth.nodes("right")
assert np.all(x[:, pinned] == start.x[pinned])
v = np.array([state.v for state in states[1:]])
assert np.allclose(np.diff(x, axis=0), dt * v, rtol=0, atol=1e-12)  # x₁ = x₀ + dt v₁ at each node
n = 15  # in free fall v = −n g dt, so that z = −g dt² (1 + 2 + … + n)
assert np.allclose(x[n, right, 2], -9.81 * dt**2 * n * (n + 1) / 2, rtol=0, atol=1e-6)
too_deep = -9.81 * t[n] ** 2 / 2 - x[n, right, 2]
assert np.allclose(too_deep, 9.81 * t[n] * dt / 2, atol=1e-6)
assert np.all(np.abs(too_deep - 0.0074) < 1e-4)
