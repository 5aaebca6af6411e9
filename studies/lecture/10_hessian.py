# ---
# jupyter:
#   jupytext:
#     text_representation: {extension: .py, format_name: percent}
#   kernelspec: {display_name: Python 3, language: python, name: python3}
# ---

# %% [markdown]
# # Both terms of the Hessian
#
# The force of a condition is $f=-kC\,\partial C$. Its derivative is $\partial f/\partial x=-K$
# with
#
# $$K=k\,(\partial C\,\partial C^T+C\,\partial^2C).$$
#
# The first term is positive semi-definite. The second can be negative: for a spring, $C=|x|-l$,
# it is $k(1-l/|x|)$ across the spring, negative under compression. Then $K$ is indefinite.
#
# A ball hangs on two springs. Newton's iteration with both terms converges quadratically, without
# the second term linearly: each iteration leaves 0.356 of the error, the largest eigenvalue of
# $K_1^{-1}K_2$, where $K_1$ and $K_2$ are the two terms.
#
# To what kind of point does a step lead where $K$ is indefinite?
#
# <details><summary>Answer</summary>
#
# To a saddle point of the quadratic model, where the energy is not the least.
#
# </details>

# %%
import matplotlib.pyplot as plt
import numpy as np

from fecloth.study.figures import STYLE, line_style

k, l, load = 100.0, 1.0, np.array([0.0, -30.0])  # [N/m], [m], [N]
supports = np.array([[-1.0, 0.0], [1.0, 0.0]])  # [m]


def spring(r):  # the force on the end r of a spring, and both terms of its K
    length, n = np.linalg.norm(r), r / np.linalg.norm(r)
    C, second = length - l, (np.eye(2) - np.outer(n, n)) / length
    return -k * C * n, k * np.outer(n, n), k * C * second


def newton(both, x=(0.1, -0.6), iterations=30):
    path = [np.array(x)]
    for _ in range(iterations):
        f, first, second = map(sum, zip(*map(spring, path[-1] - supports), strict=True))
        path.append(path[-1] + np.linalg.solve(first + both * second, f + load))
    return np.array(path)


rest = newton(both=True)[-1]
error = {both: np.linalg.norm(newton(both) - rest, axis=1) for both in (True, False)}

# %%
plt.style.use(STYLE)
fig, (eigen, converge) = plt.subplots(1, 2, figsize=(10, 4.5), layout="constrained")
stretch = np.linspace(0.5, 1.5, 101)
along, across = np.transpose([np.diag(sum(spring(np.array([s, 0.0]))[1:])) for s in stretch])
eigen.plot(stretch, along, label="along: the first term")
eigen.plot(stretch, across, label="across: the second term")
eigen.axhline(0, color="k", lw=0.8)
eigen.axvspan(0.5, 1, color="0.93", label="compressed")
eigen.set(xlabel="stretch |x|/l [-]", ylabel="eigenvalues of K [N/m]", title="one spring")
converge.semilogy(error[True][:5], **line_style(0), label="both terms")
converge.semilogy(error[False], **line_style(1), label="first term only")
converge.set(xlabel="iteration [-]", ylabel="error of x [m]", title="a ball on two springs")
for ax in (eigen, converge):
    ax.legend()

# %%
at, e = np.array([0.7, -0.2]), 1e-6
K = sum(spring(at)[1:])
assert np.allclose([(spring(at - d)[0] - spring(at + d)[0]) / (2 * e) for d in e * np.eye(2)], K)
assert np.allclose(along, k)
assert np.array_equal(across < 0, stretch < 1 - 1e-9)
_, first, second = map(sum, zip(*map(spring, rest - supports), strict=True))
rate = np.max(np.linalg.eigvals(np.linalg.solve(first, second)))
assert np.isclose(rate, 0.356, atol=5e-4)
assert np.allclose(error[False][6:20] / error[False][5:19], rate, rtol=5e-3)  # linear
e1, e2, e3 = error[True][1:4]
assert np.log(e3 / e2) / np.log(e2 / e1) > 1.9  # quadratic
