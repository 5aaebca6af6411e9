# ---
# jupyter:
#   jupytext:
#     text_representation: {extension: .py, format_name: percent}
#   kernelspec: {display_name: Python 3, language: python, name: python3}
# ---

# %% [markdown]
# # The linearised step
#
# Backward Euler, with the force expanded to first order about the old state, is one equation:
#
# $$\left(M - h\,\frac{\partial f}{\partial v} - h^2 \frac{\partial f}{\partial x}\right) \Delta v
# = h \left(f + h\,\frac{\partial f}{\partial x}\,v\right), \qquad \Delta x = h\,(v + \Delta v).$$
#
# (The lecture's slide has $\partial^2 f/\partial x^2$ in place of $\partial f/\partial x$: a slip.
# What is of second order is $-\partial^2 E/\partial x^2$.)
#
# Baraff and Witkin (1998, eq. 6) have it divided by $M$:
# $I - h M^{-1} \partial f/\partial v - h^2 M^{-1} \partial f/\partial x$. The answer is the same,
# but this matrix is not symmetric. The symmetric one has half the entries to store, and conjugate
# gradients apply. The damping is symmetric here by an approximation (slide 13).

# %%
import matplotlib.pyplot as plt
import numpy as np
from scipy import sparse
from scipy.sparse.linalg import bicgstab, cg

import fecloth as fc
from fecloth.study.figures import COLOURS, STYLE

cloth = fc.Cloth.rectangle(1.0, 1.0, h=0.1)
terms = [fc.StVK(), fc.StrainRateDamping(time=0.01, rate="velocity"), fc.Gravity()]
system = fc.System(cloth, fc.Fabric(0.2, 1000.0, 0.3), terms, ["left"])
X, Y = cloth.X.T
x = np.column_stack([1.05 * X, (1 + 0.05 * X) * Y, 0.05 * X * np.sin(3 * X) * np.cos(3 * Y)])
state, h = system.state(x, np.column_stack([X * Y, X**2, X * np.sin(5 * X)])), 0.01

f, v, free = system.force(state).ravel(), state.v.ravel(), system.free
M, df_dx, df_dv = system.mass, -system.stiffness(state), -system.damping(state)
A = (M - h * df_dv - h**2 * df_dx)[free][:, free]
b = (h * (f + h * df_dx @ v))[free]
inverse = sparse.diags_array(1 / M.diagonal()[free])
B, c = inverse @ A, inverse @ b
step, info = next(fc.march(system, fc.LinearlyImplicitEuler(), state, h, h, solver="direct"))
dv = (step.v - state.v).ravel()[free]


# %%
def residuals(solver, matrix, rhs):
    """‖b − A Δv‖/‖b‖ after each iteration."""
    left = []

    def record(y):
        left.append(np.linalg.norm(b - A @ y) / np.linalg.norm(b))

    solver(matrix, rhs, rtol=1e-9, maxiter=400, callback=record)
    return left


cases = {
    "conjugate gradients on symmetric A": (cg, A, b, 1),
    "conjugate gradients on B, no guarantee": (cg, B, c, 1),
    "BiCGStab on B": (bicgstab, B, c, 2),
}
plt.style.use(STYLE)
fig, ax = plt.subplots(figsize=(8, 5), layout="constrained")
ax.set(xlabel="products with the matrix [-]", ylabel="residual [-]")
ax.set_title("A Δv = b, and B Δv = c with B = M⁻¹A")
products = {}
for i, (name, (*problem, each)) in enumerate(cases.items()):
    left = residuals(*problem)
    products[name] = each * len(left)
    ax.semilogy(each * np.arange(1, len(left) + 1), left, color=COLOURS[i], label=name)
    ax.legend()

# %%
# dv of fecloth's step solves both equations to round-off
assert np.abs(A @ dv - b).max() < 1e-12 * np.abs(b).max()
assert np.abs(B @ dv - c).max() < 1e-12 * np.abs(c).max()
assert np.allclose(step.x - state.x, h * step.v, rtol=0, atol=1e-14)
assert abs(A - A.T).max() < 1e-12 * abs(A).max()
assert abs(B - B.T).max() > 0.1 * abs(B).max()
symmetric, wrong, general = products.values()
assert general > 1.1 * symmetric
assert wrong > 1.3 * symmetric
print(*(f"{name}: {count} products" for name, count in products.items()), sep="\n")
