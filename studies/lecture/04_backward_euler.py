# ---
# jupyter:
#   jupytext:
#     text_representation: {extension: .py, format_name: percent}
#   kernelspec: {display_name: Python 3, language: python, name: python3}
# ---

# %% [markdown]
# # Backward Euler: "stable!"
#
# Backward Euler takes the slopes at the new state,
#
# $$v_1 = v_0 + h\,M^{-1} f(x_1, v_1), \qquad x_1 = x_0 + h\,v_1,$$
#
# an equation for $v_1$. Here an undamped cloth, squeezed by up to 3 %, is let go.
#
# - Stable: each step multiplies a vibration by $1/(1 \mp i\omega h)$, whose modulus is below 1. A
#   mass of 1 in a potential $E$ changes its energy by
#   $-\tfrac{1}{2}|\Delta v|^2-\tfrac{1}{2}h^2E''|v_1|^2$, a loss if $E''\ge0$. Compressed flat
#   cloth has $E''<0$ and can gain.
# - Accurate: of first order. A step of 12 ms loses 88 % of the energy.
# - Solvable: at large $h$ the compressed cloth's matrix is indefinite; Newton's iteration fails
#   without a remedy.
#
# Which of the three limits the step of a falling flag?
#
# <details><summary>Answer</summary>
#
# Accuracy. The step is stable, and a remedy makes it solvable; but each step takes energy from the
# waves of the flag.
#
# </details>

# %%
import matplotlib.pyplot as plt
import numpy as np

import fecloth as fc
from fecloth.study.figures import COLOURS, STYLE

cloth = fc.Cloth.rectangle(1.0, 1.0, h=0.1)
system = fc.System(cloth, fc.Fabric(0.2, 1000.0, 0.3), [fc.StVK()])
X, Y = cloth.X.T
x = np.column_stack([X + 0.01 * np.cos(np.pi * X), Y, 1e-3 * np.sin(2 * np.pi * X)])
start, t_end = system.state(x, 0 * x), 0.012


def run(h, definiteness="on_failure"):
    newton = fc.Newton(tolerance=1e-8, definiteness=definiteness)
    return list(fc.march(system, fc.BackwardEuler(), start, h, t_end, newton=newton))


def iterations(h):
    try:
        return np.mean([info.counts.newton for state, info in run(h, definiteness="none")])
    except fc.StepFailed:
        return np.nan


*_, (exact, info) = fc.march(system, fc.CentralDifference(), start, 5e-5, t_end)


# %%
def rms(d):
    return np.sqrt(np.mean(d**2))


sizes = t_end / 2.0 ** np.arange(8)
motions = [[state for state, info in run(h)] for h in sizes]
energies = [[sum(system.energies(s).values()) for s in [start, *motion]] for motion in motions]
left = np.array([energy[-1] / energy[0] for energy in energies])
errors = np.array([rms(motion[-1].x - exact.x) for motion in motions])
newton = np.array([iterations(h) for h in sizes])
failed = np.isnan(newton)

plt.style.use(STYLE)
fig, axes = plt.subplots(3, 1, figsize=(8, 8), sharex=True, layout="constrained")
axes[0].semilogx(1e3 * sizes, left, "o-", color=COLOURS[0], label="backward Euler")
axes[0].axhline(1, color="k", ls=":", label="exact")
axes[0].set(ylabel="energy left at 12 ms [-]", ylim=(0, 1.3), title="Stable at every step")
axes[1].loglog(1e3 * sizes, 1e3 * errors, "s-", color=COLOURS[1], label="backward Euler")
axes[1].loglog(1e3 * sizes, 1e3 * errors[-1] * sizes / sizes[-1], "k:", label="slope 1")
axes[1].axhline(1e3 * rms(x - exact.x), color="0.6", label="error of no motion at all")
axes[1].set(ylabel="rms error at 12 ms [mm]", title="Accurate at small steps")
axes[2].semilogx(1e3 * sizes, newton, "^-", color=COLOURS[2], label="without a remedy")
axes[2].semilogx(1e3 * sizes[failed], 5 + 0 * sizes[failed], "rx", mew=2, label="fails")
axes[2].set(ylabel="Newton iterations a step [-]", ylim=(0, 6), xlabel="time step h [ms]")
axes[2].set_title("Solvable at small steps")
for ax in axes:
    ax.legend()

# %%
assert all(np.all(np.diff(energy) < 0) for energy in energies)  # stable from this start
strip = fc.Cloth.rectangle(1.0, 0.25, h=0.25, pattern="right")
held = fc.System(strip, fc.Fabric(0.2, 1000.0), [fc.StVK()], pins=["left", "right"])
places, weights = np.polynomial.legendre.leggauss(3)  # exact: the energy is of fourth degree
exactly = fc.Newton(tolerance=1e-12)
wave = np.sin(np.pi * strip.X[:, 0])
for press in (0.9, 0.97, 1.0, 1.02):  # of the length between the pins; it starts flat, or bent
    for height, h in ((0, 1e-3), (0, 5e-3), (0.2, 1e-3), (0.2, 5e-3)):
        flat = strip.X * [press, 1]
        a = held.state(np.c_[flat, height * wave], np.outer(wave, [0, 0, 1]))  # at 1 m/s
        ((b, info),) = fc.march(held, fc.BackwardEuler(), a, h, h, newton=exactly)
        gain = sum(held.energies(b).values()) - sum(held.energies(a).values())
        v, change = b.v.ravel(), (b.v - a.v).ravel()
        formula = -change @ held.mass @ change / 2
        for s, weight in zip((1 + places) / 2, weights / 2, strict=True):  # mean of E'' on the way
            K = held.stiffness(held.state(b.x - s * h * b.v))
            formula -= weight * (1 - s) * h**2 * v @ K @ v
        assert np.isclose(gain, formula, rtol=1e-6, atol=1e-12 * held.energies(a)["StVK"])
        assert (gain > 0) == (press < 1 and height == 0)
orders = np.log2(errors[:-1] / errors[1:])
assert np.all(np.abs(orders[-2:] - 1) < 0.08)  # accurate where h is small
assert abs(left[0] - 0.12) < 0.01
assert list(failed) == [True] * 2 + [False] * 6  # solvable where h is small
print("orders", orders.round(2))
