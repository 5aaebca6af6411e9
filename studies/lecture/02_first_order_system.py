# ---
# jupyter:
#   jupytext:
#     text_representation: {extension: .py, format_name: percent}
#   kernelspec: {display_name: Python 3, language: python, name: python3}
# ---
# %% [markdown]
# # Position, velocity, acceleration: a first-order system
#
# Newton's law $M\ddot x = f(x, \dot x)$ is of second order. With the velocity $v = \dot x$ as a
# second unknown it is a system of first order,
#
# $$y = \begin{pmatrix} x \\ v \end{pmatrix}, \qquad
# \dot y = \begin{pmatrix} v \\ M^{-1} f(x, v) \end{pmatrix},$$
#
# and every method for ordinary differential equations applies. Here SciPy's general solver takes
# the forces of fecloth and follows the nodes that are free. The implicit midpoint rule of fecloth
# gives the same motion: halving its step divides the difference by four.
#
# This cloth is as soft as a thin sheet of rubber. Which of the two suffers more from a stiffer one?
#
# <details><summary>Answer</summary>
#
# The general solver. It is explicit: its steps shrink as $1/\sqrt Y$ with the stiffness $Y$. The
# midpoint rule is stable at every step.
#
# </details>

# %%
import matplotlib.pyplot as plt
import numpy as np
from scipy.integrate import solve_ivp

import fecloth as fc
from fecloth.study.figures import COLOURS, STYLE, use_plain_ticks

cloth = fc.Cloth.rectangle(1.0, 1.0, h=0.25)
system = fc.System(cloth, fc.Fabric(0.2, 50.0, 0.3), [fc.StVK(), fc.Gravity()], ["left"])
start, mass, is_free = system.rest(), system.nodal_mass[:, None], cloth.X[:, :1] > 0


def rate(t, y):
    x, v = y.reshape(2, -1, 3)
    a = system.force(system.state(x, v)) / mass
    return np.ravel([v, is_free * a])


y0 = np.ravel([start.x, start.v])
ode = solve_ivp(rate, (0, 0.6), y0, "DOP853", rtol=1e-9, atol=1e-10, dense_output=True)
paths, sizes = {}, np.array([0.02, 0.01, 0.005, 0.0025])
for dt in sizes:
    steps = fc.march(system, fc.ImplicitMidpoint(), start, dt, 0.6, newton=fc.Newton(1e-9))
    paths[dt] = [start, *(state for state, info in steps)]

# %%
end = ode.y[:, -1].reshape(2, -1, 3)
errors = [np.abs(path[-1].x - end[0]).max() for path in paths.values()]
middle = np.argmin(np.linalg.norm(cloth.X - 0.5, axis=1))
t = np.linspace(0, 0.6, 200)
z, w = ode.sol(t).reshape(2, -1, 3, 200)[:, middle, 2]

plt.style.use(STYLE)
fig, (left, right) = plt.subplots(1, 2, figsize=(10, 4.2), layout="constrained")
left.plot(t, z, color=COLOURS[0], label="z [m], solve_ivp")
left.plot(t, w, color=COLOURS[1], label="dz/dt [m/s], solve_ivp")
coarse = [(state.t, state.x[middle, 2], state.v[middle, 2]) for state in paths[sizes[0]]]
times, heights, speeds = np.transpose(coarse)
left.plot(times, heights, "o", color=COLOURS[0], label="z, midpoint rule")
left.plot(times, speeds, "s", color=COLOURS[1], label="dz/dt, midpoint rule")
left.set(xlabel="time t [s]", ylabel="height and its rate in the middle")
right.loglog(sizes, errors, "o-", color=COLOURS[2], label="largest difference at 0.6 s")
right.loglog(sizes, errors[0] * (sizes / sizes[0]) ** 2, "k:", label="slope 2")
right.set(xlabel="time step [s]", ylabel="difference in x [m]")
use_plain_ticks(right)
for ax in (left, right):
    ax.legend()

# %%
orders = np.log2(np.divide(errors[:-1], errors[1:]))
assert np.all(np.abs(orders - 2) < 0.05)
assert errors[-1] < 3e-4
assert np.abs(np.diff(z) / np.diff(t) - (w[1:] + w[:-1]) / 2).max() < 1e-3  # v is dx/dt
print("orders", orders.round(2), "evaluations of the force by SciPy", ode.nfev)
