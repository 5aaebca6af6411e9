# ---
# jupyter:
#   jupytext:
#     text_representation: {extension: .py, format_name: percent}
#   kernelspec: {display_name: Python 3, language: python, name: python3}
# ---

# %% [markdown]
# # Forward Euler
#
# The simplest method takes the slopes at the old state:
#
# $$x_1 = x_0 + h\,v_0, \qquad v_1 = v_0 + h\,M^{-1} f(x_0, v_0).$$
#
# A small vibration $\ddot c = -\omega^2 c$ of the cloth is multiplied by $1 \pm i\omega h$ in each
# step. Its amplitude grows by $|1 \pm i\omega h| = \sqrt{1 + \omega^2 h^2} > 1$ for every $h$, its
# energy by the square. The page takes the cloth's fastest mode and measures both: the growth, and
# the error at a given time, which is of first order.
#
# So a small $h$ makes the error small, yet no $h$ is stable. How does damping change this?
#
# <details><summary>Answer</summary>
#
# A mode that decays as $e^{-\delta t}$ is stable for $h<2\delta/\omega^2$. Damping of the strain
# rate with the time $\tau$ has $\delta=\tau\omega^2/2$: every vibration is stable for $h<\tau$.
#
# </details>

# %%
import matplotlib.pyplot as plt
import numpy as np
from scipy.linalg import eigh

import fecloth as fc
from fecloth.study.figures import COLOURS, STYLE, use_plain_ticks

cloth = fc.Cloth.rectangle(1.0, 1.0, h=0.25)
system = fc.System(cloth, fc.Fabric(0.2, 1000.0, 0.3), [fc.StVK()])
rest = system.rest()
K, M = system.stiffness(rest).toarray(), system.mass.toarray()
squares, modes = eigh(K, M)  # K φ = ω² M φ, φ·M φ = 1
omega, mode = np.sqrt(squares[-1]), modes[:, -1]


def amplitudes(h, t_end, size=1e-8):
    """c + i ċ/ω at each step, 1 at the start; exactly it is e^(−iωt)."""
    start = system.state(rest.x + size * mode.reshape(-1, 3), rest.v)
    steps = fc.march(system, fc.ForwardEuler(beyond_limit=True), start, h, t_end)
    states = [start, *(state for state, info in steps)]
    return [mode @ M @ ((s.x - rest.x) + 1j * s.v / omega).ravel() / size for s in states]


products = np.array([0.05, 0.1, 0.2, 0.5, 1.0, 2.0])  # ω h
growth = [np.abs(amplitudes(p / omega, 5 * p / omega)[5]) ** (1 / 5) for p in products]

# %%
period, numbers = 2 * np.pi / omega, np.array([160, 320, 640, 1280])  # of steps in a period
errors = [np.abs(amplitudes(period / n, period)[-1] - 1) for n in numbers]

plt.style.use(STYLE)
fig, (motion, energy, error) = plt.subplots(1, 3, figsize=(12, 4), layout="constrained")
for i, product in enumerate((0.2, 0.1, 0.05)):
    c = np.real(amplitudes(product / omega, 3 * period))
    phases = np.linspace(0, 3, len(c))
    motion.plot(phases, c, color=COLOURS[i], label=f"ωh = {product}")
motion.plot(phases, np.cos(2 * np.pi * phases), "k:", label="exact")
motion.set(xlabel="time in periods [-]", ylabel="amplitude over its start [-]")
energy.loglog(products, np.square(growth) - 1, "o", color=COLOURS[0], label="measured")
energy.loglog(products, products**2, "k:", label="ω²h²")
energy.set(xlabel="ωh [-]", ylabel="energy gained in a step over energy [-]")
error.loglog(2 * np.pi / numbers, errors, "o-", color=COLOURS[1], label="after one period")
error.loglog(2 * np.pi / numbers, errors[-1] * numbers[-1] / numbers, "k:", label="slope 1")
error.set(xlabel="ωh [-]", ylabel="error of the amplitude [-]")
for ax in (motion, energy, error):
    use_plain_ticks(ax)
    ax.legend()

# %%
assert np.allclose(growth, np.sqrt(1 + products**2), rtol=1e-5)
assert np.all(np.array(growth) > 1)
orders = np.log2(np.divide(errors[:-1], errors[1:]))
assert np.all(np.abs(orders - 1) < 0.06)
print("growth a step", np.round(growth, 4), "orders", orders.round(3))
