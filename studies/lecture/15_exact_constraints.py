# ---
# jupyter:
#   jupytext:
#     text_representation: {extension: .py, format_name: percent}
#   kernelspec: {display_name: Python 3, language: python, name: python3}
# ---

# %% [markdown]
# # C = 0 exactly
#
# The warp of a strip shall not stretch: $C=0$ for each of its edges. The penalty $\tfrac k2C^2$
# misses it by $\lambda/k$, with the tension $\lambda$. A Lagrange multiplier makes $\lambda$ an
# unknown and $C=0$ an equation:
#
# $$\begin{pmatrix}K+\lambda\,\partial^2C&\partial C\\\partial C^T&0\end{pmatrix}
# \begin{pmatrix}\Delta x\\\Delta\lambda\end{pmatrix}
# =\begin{pmatrix}f-\lambda\,\partial C\\-C\end{pmatrix}.$$
#
# A strip of 1 m hangs between points 0.8 m apart. The multipliers are the tension of a catenary, to
# 1 %. The penalty's error falls with $1/k$, but its condition number grows with $k$, and Newton's
# iterations from 7 to 13; the exact constraint takes 6.
#
# On all edges of a mesh, multipliers would leave $B-3$ ways to bend, with $B$ edges at the border:
# cloth locks. What is the method with $-1/k$ in place of 0?
#
# <details><summary>Answer</summary>
#
# The penalty: its second row is $\lambda=kC$. With $\lambda$ as an unknown, large $k$ does no harm.
#
# </details>

# %%
import matplotlib.pyplot as plt
import numpy as np
from numpy.linalg import norm, solve
from scipy.optimize import brentq

import fecloth as fc
from fecloth.study.figures import STYLE, line_style

cloth = fc.Cloth.rectangle(1.0, 0.2, h=0.1, pattern="right")  # 3 lines of warp, 33 nodes
fabric = fc.Fabric(areal_density=0.2, tensile_stiffness=20.0)
system = fc.System(cloth, fabric, [fc.StVK(), fc.Gravity()], pins=["left", "right"])
ends = np.diff(np.eye(33)[np.lexsort(cloth.X.T).reshape(3, 11)], axis=1).reshape(30, 33)
s, Z = cloth.X[:, 0], system.admissible.toarray()  # Z (99, f) are the motions free of pins
x, tension = np.c_[0.1 + 0.8 * s, cloth.X[:, 1], -1.1 * s * (1 - s)], np.full(30, 0.05)

for _ in range(6):
    state, length = system.state(x), norm(ends @ x, axis=1)
    dC = np.einsum("ea,ei->eai", ends, ends @ x / length[:, None]).reshape(30, 99)
    w = (tension / length)[:, None]  # K gets λ ∂²C, summed over the edges
    K = system.stiffness(state) + np.kron(ends.T @ (w * ends), np.eye(3)) - dC.T @ (w * dC)
    A = np.block([[Z.T @ K @ Z, Z.T @ dC.T], [dC @ Z, np.zeros((30, 30))]])
    step = solve(A, np.r_[Z.T @ (system.force(state).ravel() - dC.T @ tension), 0.1 - length])
    x, tension = x + (Z @ step[:-30]).reshape(33, 3), tension + step[-30:]

# %%
plt.style.use(STYLE)
fig, (pull, error, cost) = plt.subplots(1, 3, figsize=(12, 4.5), layout="constrained")
edges = np.column_stack([np.argmin(ends, axis=1), np.argmax(ends, axis=1)])
start = system.state(np.c_[0.1 + 0.8 * s, cloth.X[:, 1], -1.1 * s * (1 - s)])


def penalty(k):  # positions, iterations and condition number
    length = fc.Condition(lambda y: norm(y[:, 1] - y[:, 0], axis=1) - 0.1, edges, stiffness=k)
    stiff = fc.System(cloth, fabric, [fc.StVK(), fc.Gravity(), length], pins=["left", "right"])
    rest = fc.equilibrium(stiff, start)
    return rest.x, rest.iterations, np.linalg.cond(Z.T @ stiff.stiffness(rest) @ Z)


k = np.array([1e2, 1e4, 1e6, 1e8])
softer, iterations, conditions = zip(*map(penalty, k), strict=True)
errors = np.array([norm(y - x, axis=1).max() for y in softer])
a = brentq(lambda a: 2 * a * np.sinh(0.4 / a) - 1, 0.1, 10)  # the catenary z = a cosh(x/a) − …
weight, total = 0.2 * 0.2 * 9.81, tension.reshape(3, 10).sum(axis=0)  # [N/m], [N]
middle = x[edges].mean(axis=1)[:10, 0]
pull.plot(middle, total, **line_style(1) | {"ls": ""}, label="multipliers")
at = np.linspace(0.1, 0.9, 100)
pull.plot(at, weight * a * np.cosh((at - 0.5) / a), "k:", label="catenary")
pull.set(xlabel="x [m]", ylabel="tension of the strip [N]")
error.loglog(k, errors, **line_style(0), label="penalty")
error.loglog(k, errors[-1] * k[-1] / k, "k:", label="1/k")
error.set(xlabel="penalty k [N/m]", ylabel="largest error of a node [m]")
cost.semilogx(k, iterations, **line_style(0), label="iterations, penalty")
cost.axhline(6, color="k", ls="--", label="iterations, exact")
cost.semilogx(k, np.log10(conditions), **line_style(2), label="log₁₀ of condition number, penalty")
cost.axhline(np.log10(np.linalg.cond(A)), color="k", ls=":", label="the same, exact")
cost.set(xlabel="penalty k [N/m]", ylabel="iterations; decades [-]", ylim=(0, 22))
for ax in fig.axes:
    ax.legend()

# %%
assert np.allclose(norm(ends @ x, axis=1), 0.1, rtol=1e-12)
assert norm(step) < 1e-6  # of the last iteration
assert np.isclose(-x[:, 2].min(), a * (np.cosh(0.4 / a) - 1), rtol=6e-3)
assert np.allclose(total, weight * a * np.cosh((middle - 0.5) / a), rtol=0.01)
assert np.allclose(errors[1:] * k[1:], errors[-1] * k[-1], rtol=0.01)
assert np.allclose(conditions[1:] / k[1:], conditions[-1] / k[-1], rtol=0.01)
assert np.allclose((iterations[0], iterations[-1]), (7, 13), atol=1)
every = np.unique(np.sort(cloth.triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)), axis=0)
generic = x + np.random.default_rng(15).normal(0, 0.01, x.shape)
rows = np.zeros((len(every), 33, 3))
for row, (i, j) in zip(rows, every, strict=True):
    row[i], row[j] = generic[i] - generic[j], generic[j] - generic[i]
border = 2 * (10 + 2)
assert 99 - np.linalg.matrix_rank(rows.reshape(-1, 99)) - 6 == border - 3  # 6 rigid motions
