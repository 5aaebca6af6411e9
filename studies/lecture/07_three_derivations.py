# ---
# jupyter:
#   jupytext:
#     text_representation: {extension: .py, format_name: percent}
#   kernelspec: {display_name: Python 3, language: python, name: python3}
# ---

# %% [markdown]
# # Finite elements, finite volumes, finite differences
#
# A taut membrane sags by $w$: $-T\,\Delta w = p$. Three derivations give $T K w = p\,a$ with areas
# $a$; the figure shows a row.
#
# - Elements minimise the energy: $K_{ij} = \int \nabla N_i \cdot \nabla N_j$ with linear $N_i$.
# - Volumes balance each node's cell, bounded by perpendicular bisectors. Its side of length $s$
#   crosses an edge of length $d$: $K_{ij} = -s/d$.
# - Differences: $-\Delta w = (4 w - w_E - w_W - w_N - w_S)/h^2$, times $a = h^2$.
#
# On a grid of right triangles all are one matrix. On a mesh by Gmsh, elements and volumes still
# agree; differences have no meaning. Bilinear squares have other rows.
#
# On which mesh is $s$ negative?
#
# <details><summary>Answer</summary>
#
# Where the two angles opposite to an edge have a sum above 180°: on a mesh that is not Delaunay.
#
# </details>

# %%
import matplotlib.pyplot as plt
import numpy as np

import fecloth as fc
from fecloth.study.figures import COLOURS, STYLE, use_plain_ticks

pieces = [fc.Cloth.rectangle(1.0, 1.0, 1 / 8, pattern) for pattern in ("right", "unstructured")]
cloth = fc.Cloth.join(pieces, names=["grid", "gmsh"])
elements, volumes = np.zeros((2, len(cloth.X), len(cloth.X)))
for t in cloth.triangles:
    corners = np.column_stack([np.ones(3), cloth.X[t]])
    P, G = corners[:, 1:], np.linalg.inv(corners)[1:]  # places, and gradients of N
    elements[np.ix_(t, t)] += np.linalg.det(corners) / 2 * G.T @ G
    centre = np.linalg.solve(2 * (P[1:] - P[0]), np.sum(P[1:] ** 2 - P[0] ** 2, axis=1))
    for i, j in ((0, 1), (1, 2), (2, 0)):  # a piece from the edge's middle to the circumcentre
        d = P[j] - P[i]
        volumes[t[[i, j]], t[[j, i]]] -= np.linalg.det([d, centre - P[i]]) / (d @ d)
volumes -= np.diag(volumes.sum(axis=1))
line = 2 * np.eye(7) - np.eye(7, k=1) - np.eye(7, k=-1)  # 7 free nodes a line
differences = np.kron(np.eye(7), line) + np.kron(line, np.eye(7))


# %%
def matrix(n, is_bilinear=False):  # K of n cells a side
    A = 2 * np.eye(n - 1) - np.eye(n - 1, k=1) - np.eye(n - 1, k=-1)
    B = np.eye(n - 1) - A / 6 if is_bilinear else np.eye(n - 1)
    return np.kron(A, B) + np.kron(B, A)


def sag(n, is_bilinear):  # w T/p in the middle
    w = np.linalg.solve(matrix(n, is_bilinear), np.full((n - 1) ** 2, 1 / n**2))
    return w[len(w) // 2]


m, n = np.meshgrid(*[np.arange(1, 400, 2)] * 2)
signs = (-1.0) ** ((m + n) // 2 - 1)
exact = np.sum(16 / np.pi**4 * signs / (m * n * (m**2 + n**2)))  # the double Fourier series
cells = np.array([4, 8, 16, 32])
errors = [np.array([abs(sag(n, b) - exact) for n in cells]) for b in (False, True)]

plt.style.use(STYLE)
fig, axes = plt.subplots(1, 3, figsize=(12, 4), layout="constrained", width_ratios=(1, 1, 1.4))
rows = {
    "elements, volumes, differences": [[0, -1, 0], [-1, 4, -1], [0, -1, 0]],
    "bilinear squares, times 3": [[-1, -1, -1], [-1, 8, -1], [-1, -1, -1]],
}
for ax, (name, row) in zip(axes, rows.items(), strict=False):
    ax.plot(*np.meshgrid((0, 1, 2), (0, 2)), "-", color="0.7")
    ax.plot(*np.meshgrid((0, 2), (0, 1, 2), indexing="ij"), "-", color="0.7")
    for (y, x), value in np.ndenumerate(row):
        ax.text(x, y, value, ha="center", va="center", fontsize=16, bbox={"fc": "w", "ec": "0.6"})
    ax.set(xlim=(-0.5, 2.5), ylim=(-0.5, 2.5), title=name, aspect="equal")
    ax.set(xticks=(0, 1, 2), yticks=(0, 1, 2), xlabel="x/h [-]", ylabel="y/h [-]")
for i, (name, error) in enumerate(zip(("one of the three", "bilinear"), errors, strict=True)):
    axes[2].loglog(1 / cells, error / exact, "o-", color=COLOURS[i], label=name)
axes[2].loglog(1 / cells, errors[0][0] / exact * (4 / cells) ** 2, "k:", label="slope 2")
axes[2].set(xlabel="h over side [-]", ylabel="error of the sag, relative [-]")
for ax in axes[2:]:
    use_plain_ticks(ax)
    ax.legend()

# %%
assert np.abs(elements - volumes).max() < 1e-12  # on both meshes
grid = cloth.nodes("grid")
grid = grid[np.lexsort(cloth.X[grid].T)]  # line by line
inner = grid[np.all(np.abs(cloth.X[grid] - 0.5) < 0.499, axis=1)]
assert np.abs(elements[np.ix_(inner, inner)] - differences).max() < 1e-12
assert np.array_equal(matrix(8), differences)
bilinear = 3 * matrix(8, is_bilinear=True)[24].reshape(7, 7)  # row of the node in the middle
assert np.allclose(bilinear[2:5, 2:5], rows["bilinear squares, times 3"], rtol=0, atol=1e-12)
orders = np.log2([error[2] / error[3] for error in errors])
assert np.all(np.abs(orders - 2) < 0.02)
print("w T/(p L²) in the middle", exact.round(6), "orders", orders.round(3))
