# ---
# jupyter:
#   jupytext:
#     text_representation: {extension: .py, format_name: percent}
#   kernelspec: {display_name: Python 3, language: python, name: python3}
# ---

# %% [markdown]
# # Damping
#
# The lecture calls damping, $-\tau k\,\partial C\,\dot C$, "necessary for simulation". Is it? A
# cloth swings down for 0.4 s. Central differences with short steps compute it without damping.
# Against their result:
#
# - Forward Euler needs damping: without it no step is stable.
# - Central differences need none. Damping makes their stable steps shorter.
# - Backward Euler damps by itself, the swing too: $\tau$ changes next to nothing.
# - The midpoint rule gets the shape without damping. Its steps of 10 ms raise the membrane's energy
#   to 2.8 times the true one; $\tau=30$ ms leaves 1.8 times.
#
# What $\tau$ changes of the true motion is the tension: it is a property of the fabric. Which step
# would give the midpoint rule the right tension?
#
# <details><summary>Answer</summary>
#
# About 2 ms: then the energy is 4 % too large. Central differences are stable up to 1.7 ms. The
# step must resolve the waves in the membrane.
#
# </details>

# %%
import matplotlib.pyplot as plt
import numpy as np

import fecloth as fc
from fecloth.study.figures import STYLE, line_style

cloth = fc.Cloth.rectangle(0.4, 0.4, h=0.1, pattern="right")
fabric = fc.Fabric(areal_density=0.2, tensile_stiffness=300.0, poisson_ratio=0.3)


def swing(method, tau, dt=0.01, t_end=0.4):  # states at 20 times, and the cost
    damping = [fc.StrainRateDamping(time=tau)] if tau else []
    system = fc.System(cloth, fabric, [fc.StVK(), fc.Gravity(), *damping], pins=["left"])
    dt = min(dt, 0.8 * fc.critical_dt(system, system.rest(), method))
    n = int(np.ceil(t_end / dt / 20))  # steps from one of the times to the next
    steps = list(fc.march(system, method, system.rest(), dt=t_end / (20 * n), t_end=t_end))
    return [s for s, _ in steps[n - 1 :: n]], sum(info.counts.newton for _, info in steps) or 20 * n


forward, central = fc.ForwardEuler(), fc.CentralDifference()
taus = {forward: (1, 3), central: (0, 1, 3)}  # [ms]
taus |= dict.fromkeys((fc.BackwardEuler(), fc.ImplicitMidpoint()), (0, 1, 3, 10, 30))
runs = {m: [swing(m, tau / 1000) for tau in each] for m, each in taus.items()}

# %%
plt.style.use(STYLE)
fig, axes = plt.subplots(1, 3, figsize=(12, 4.5), layout="constrained")
truth, _ = swing(central, 0, dt=5e-4)
membrane, right = fc.System(cloth, fabric, [fc.StVK()]), cloth.nodes("right")
x = np.array([state.x[right] for state in truth])
W = max(membrane.energies(state)["StVK"] for state in truth)
ticks, table = (0, 1, 3, 10, 30), {}  # of each method rows of error, energy, cost
for i, (method, by_tau) in enumerate(runs.items()):
    name = type(method).__name__
    table[name] = np.empty((len(by_tau), 3))
    for row, (states, count) in zip(table[name], by_tau, strict=True):
        error = np.array([state.x[right] for state in states]) - x
        energy = max(membrane.energies(state)["StVK"] for state in states)
        row[:] = np.sqrt(np.mean(np.sum(error**2, axis=-1))), energy / W, count
    for ax, column in zip(axes, table[name].T, strict=True):
        at = [ticks.index(tau) for tau in taus[method]]
        ax.plot(at, column, **line_style(i), label=name)
what = (
    "error of the tip [m]",
    "membrane's largest energy, over true [-]",
    "iterations, or explicit steps [-]",
)
axes[0].set_yscale("log")
axes[2].set_yscale("log")
axes[0].legend()
for ax, label in zip(axes, what, strict=True):
    ax.set(xlabel="damping time τ [ms]", ylabel=label, xticks=range(5), xticklabels=ticks)

# %%
f, c, b, m = (table[type(method).__name__] for method in taus)
undamped = fc.System(cloth, fabric, [fc.StVK(), fc.Gravity()], pins=["left"])
assert fc.critical_dt(undamped, undamped.rest(), forward) == 0
try:  # a quarter of the stable step of central differences
    list(fc.march(undamped, fc.ForwardEuler(beyond_limit=True), undamped.rest(), 4e-4, 0.4))
    raise AssertionError("forward Euler is stable without damping")
except fc.StepFailed:
    pass
assert c[0, 0] < 1e-4
assert c[-1, 2] > 5 * c[0, 2]  # steps
assert np.ptp(b[:, 0]) < 0.005 * b[0, 0]  # backward Euler: the tip, whatever τ is
assert b[0, 0] > 10 * m[0, 0]
assert np.allclose(m[[0, -1], 1], (2.8, 1.8), atol=0.05)
assert c[0, 1] - c[-1, 1] > 0.1  # the tension of the true motion
assert c[-1, 0] < 3e-4
