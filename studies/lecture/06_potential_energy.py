# ---
# jupyter:
#   jupytext:
#     text_representation: {extension: .py, format_name: percent}
#   kernelspec: {display_name: Python 3, language: python, name: python3}
# ---

# %% [markdown]
# # Potential energy
#
# Elastic forces and weight come from one function, the potential energy $E(x)$:
#
# $$f = -\frac{\partial E}{\partial x}.$$
#
# Two consequences are tested. Central differences of $E$ agree with $f$ to order $\varepsilon^2$,
# until round-off takes over. And on a closed path these forces do no work:
# $\oint f \cdot \mathrm{d}x = 0$.
#
# Other forces have no potential. Air of velocity $u$ pushes a triangle, of area $A$ and normal
# $n$, by
#
# $$f=-A\,(k_n|w_n|\,w_n\,n+k_t|w_t|\,w_t),$$
#
# with the parts $w_n$ along $n$ and $w_t$ across it of $w=v-u$. It does work on this path, however
# slowly the cloth moves. A user's force $q(x,v,t)$ per area gives a node with the area $A_a$
# $f_a=A_a\,q$. Damping takes energy on every path.
#
# Could weight drive a windmill?
#
# <details><summary>Answer</summary>
#
# No. A turn of the mill is a closed path, on which weight does no work.
#
# </details>

# %%
import matplotlib.pyplot as plt
import numpy as np
from scipy.integrate import cumulative_trapezoid

import fecloth as fc
from fecloth.study.figures import COLOURS, STYLE

cloth = fc.Cloth.rectangle(0.5, 0.5, h=0.1)
fabric = fc.Fabric(0.2, 1000.0, 0.3, bending_rigidity=1e-5)
elastic = fc.System(cloth, fabric, [fc.StVK(), fc.HingeBending(), fc.Gravity()])
X, Y = cloth.X.T
x0 = np.column_stack([1.02 * X, Y, 0.05 * np.sin(6 * X)])
a = 0.02 * np.column_stack([np.cos(5 * Y), np.sin(5 * X), np.cos(4 * X + 2 * Y)])
b = 0.02 * np.column_stack([np.sin(3 * X), np.cos(6 * Y), np.sin(5 * X * Y)])


def energy(x):
    return sum(elastic.energies(elastic.state(x, 0 * x)).values())


def power(system, s, speed):  # f · dx/ds on the path x(s) = x0 + a sin s + b (1 − cos s)
    x, dx_ds = x0 + a * np.sin(s) + b * (1 - np.cos(s)), a * np.cos(s) + b * np.sin(s)
    return np.sum(system.force(system.state(x, speed * dx_ds)) * dx_ds)


# %%
f_a = np.sum(elastic.force(elastic.state(x0, 0 * x0)) * a)
sizes = np.logspace(0, -8, 17)
slopes = np.array([(energy(x0 + e * a) - energy(x0 - e * a)) / (2 * e) for e in sizes])
errors = np.abs(slopes + f_a) / np.abs(f_a)
wind = fc.System(cloth, fabric, [fc.Wind((5.0, 0.0, 2.0), normal=0.7)])
damping = fc.System(cloth, fabric, [fc.MassDamping(2.0)])
angles = np.linspace(0, 2 * np.pi, 101)


def work(system, speed=0.1):
    powers = [power(system, s, speed) for s in angles]
    return cumulative_trapezoid(powers, angles, initial=0)


works = {"elasticity, weight": elastic, "wind": wind, "damping": damping}
works = {name: work(system) for name, system in works.items()}
plt.style.use(STYLE)
fig, (left, right) = plt.subplots(1, 2, figsize=(10, 4.2), layout="constrained")
left.loglog(sizes, errors, "o-", color=COLOURS[0], label="central differences")
left.loglog(sizes, errors[0] * sizes**2, "k:", label="slope 2")
left.set(xlabel="ε [-]", ylabel="error of −f · a, relative [-]", ylim=(1e-10, 10))
for i, (name, w) in enumerate(works.items()):
    right.plot(np.degrees(angles), w / np.abs(w).max(), color=COLOURS[i], label=name)
right.set(xlabel="path parameter s [°]", ylabel="work over its largest value [-]")
right.set_xticks(range(0, 361, 90))
for ax in (left, right):
    ax.legend()

# %%
orders = np.log10(errors[:8:2] / errors[2:10:2])
assert np.all(np.abs(orders - 2) < 0.01)
assert errors.min() < 1e-7
closed = {name: w[-1] / np.abs(w).max() for name, w in works.items()}
assert abs(closed["elasticity, weight"]) < 1e-9
assert abs(work(wind, speed=1e-6)[-1]) > 0.05 * np.abs(works["wind"]).max()
M = damping.mass.diagonal()  # ∮ −2 v·M dx with v = 0.1 dx/ds
assert np.isclose(works["damping"][-1], -0.2 * np.pi * M @ (a**2 + b**2).ravel(), rtol=1e-9)
air = fc.System(cloth, fabric, [fc.Wind((5.0, 0.0, 2.0), normal=0.7, tangential=0.1)])
corners = (x0 + a)[cloth.triangles]
N = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])  # 2 A n
A = np.linalg.norm(N, axis=1, keepdims=True) / 2
n, w = N / (2 * A), b[cloth.triangles].mean(axis=1) - [5.0, 0.0, 2.0]
w_n = np.sum(w * n, axis=1, keepdims=True)
w_t = w - w_n * n
f = -A * (0.7 * abs(w_n) * w_n * n + 0.1 * np.linalg.norm(w_t, axis=1, keepdims=True) * w_t)
at_nodes = np.zeros_like(x0)
np.add.at(at_nodes, cloth.triangles, f[:, None] / 3)  # a third to each corner
assert np.allclose(air.force(air.state(x0 + a, b)), at_nodes, rtol=1e-12, atol=1e-14)
user = fc.System(cloth, fabric, [fc.UserForce(("-3*vx", "x*z", "2*t"))])
q = np.column_stack([-3 * b[:, 0], x0[:, 0] * x0[:, 2], 0.5 + 0 * X])  # at t = 0.25 s
areas = M[::3, None] / 0.2  # of the nodes, from their mass
assert np.allclose(user.force(user.state(x0, b, t=0.25)), areas * q, rtol=1e-12, atol=1e-14)
print("work left at the end", {name: round(float(w), 9) for name, w in closed.items()})
