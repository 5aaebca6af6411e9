# ---
# jupyter:
#   jupytext:
#     text_representation: {extension: .py, format_name: percent}
#   kernelspec: {display_name: Python 3, language: python, name: python3}
# ---

# %% [markdown]
# # Hessians of the damping
#
# The damping $d=-k_d\,\partial C\,\dot C$, $\dot C=\partial C^Tv$, depends on $v$ and on $x$:
#
# $$-\frac{\partial d}{\partial v}=k_d\,\partial C\,\partial C^T,\quad
# -\frac{\partial d}{\partial x}
# =k_d\,\bigl(\dot C\,\partial^2C+\partial C\,(\partial^2C\,v)^T\bigr).$$
#
# The last term is not symmetric. Baraff and Witkin drop it, since their solver needs a symmetric
# matrix. A cloth turns about its edge at 10 rad/s, in steps of 10 ms. In implicit steps (left)
# Newton's method then needs two to three times the iterations; the solution stays. The linearised
# step has one solve, and its solution changes (right): at $\tau=30$ ms its distance from the
# implicit one grows from 4 to 23 % of the motion. At 100 ms neither is near.
#
# For which $v$ is the dropped term zero?
#
# <details><summary>Answer</summary>
#
# Where $\partial^2C\,v=0$: the motion changes $C$, but not its gradient. A spring is stretched and
# does not turn.
#
# </details>

# %%
import matplotlib.pyplot as plt
import numpy as np

import fecloth as fc
from fecloth.study.figures import STYLE, line_style


def damping(x, v, k_d=0.7):  # of a spring from 0 to x: d, −∂d/∂v, and both terms of −∂d/∂x
    length, n = np.linalg.norm(x), x / np.linalg.norm(x)
    ddC = (np.eye(3) - np.outer(n, n)) / length
    terms = k_d * (n @ v) * ddC, k_d * np.outer(n, ddC @ v)
    return -k_d * (n @ v) * n, k_d * np.outer(n, n), *terms


cloth = fc.Cloth.rectangle(0.4, 0.4, h=0.1, pattern="right")
fabric = fc.Fabric(areal_density=0.2, tensile_stiffness=500.0, poisson_ratio=0.3)


def motion(method, tau, tangent):  # over 5 steps, and iterations a step; "exact" has both terms
    damping = fc.StrainRateDamping(time=tau, tangent=tangent, rate="velocity")
    system = fc.System(cloth, fabric, [fc.StVK(), damping, fc.Gravity()], pins=["left"])
    start = system.state(system.rest().x, np.outer(cloth.X[:, 0], [0, 0, -10]))
    newton = fc.Newton(tolerance=1e-10, reuse=False)
    steps = list(fc.march(system, method, start, dt=0.01, t_end=0.05, newton=newton))
    return steps[-1][0].x - start.x, sum(info.counts.newton for _, info in steps) / 5


# %%
plt.style.use(STYLE)
fig, (newton, linear) = plt.subplots(1, 2, figsize=(10, 4.5), layout="constrained")
taus = np.array([1, 3, 10, 30, 100])  # [ms]
iterations, implicit, error = {}, {}, {}
for i, tangent in enumerate(("exact", "symmetric")):
    runs = [motion(fc.BackwardEuler(), tau / 1000, tangent) for tau in taus]
    iterations[tangent] = np.array([count for _, count in runs])
    implicit[tangent] = np.array([u for u, _ in runs])
    linearised = [motion(fc.LinearlyImplicitEuler(), tau / 1000, tangent)[0] for tau in taus]
    off = np.linalg.norm(linearised - implicit["exact"], axis=(1, 2))
    error[tangent] = 100 * off / np.linalg.norm(implicit["exact"], axis=(1, 2))
    label = f"{tangent} tangent"
    newton.semilogx(taus, iterations[tangent], **line_style(i), label=label)
    linear.semilogx(taus, error[tangent], **line_style(i), label=label)
newton.set(
    xlabel="damping time τ [ms]", ylabel="iterations a step [-]", title="implicit steps", ylim=0
)
linear.set(xlabel="damping time τ [ms]", ylabel="distance from the implicit solution [%]")
linear.set(title="linearised steps", ylim=0)
for ax in (newton, linear):
    ax.legend()

# %%
x, v, e = np.array([0.8, 0.3, -0.2]), np.array([1.0, -0.4, 2.0]), 1e-6
_, by_v, symmetric, other = damping(x, v)
difference = [(damping(x + d, v)[0] - damping(x - d, v)[0]) / (2 * e) for d in e * np.eye(3)]
assert np.allclose(symmetric + other, -np.transpose(difference), atol=1e-8)
difference = [(damping(x, v + d)[0] - damping(x, v - d)[0]) / (2 * e) for d in e * np.eye(3)]
assert np.allclose(by_v, -np.transpose(difference), atol=1e-8)
assert np.allclose(symmetric, symmetric.T)
assert np.abs(other - other.T).max() > 0.1
ratio = iterations["symmetric"] / iterations["exact"]
assert np.all((ratio > 1.6) & (ratio < 3.1))
assert np.allclose(implicit["symmetric"], implicit["exact"], rtol=0, atol=1e-9)
assert np.allclose((error["exact"][3], error["symmetric"][3]), (4, 23), atol=0.5)
