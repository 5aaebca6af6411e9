# ---
# jupyter:
#   jupytext:
#     text_representation: {extension: .py, format_name: percent}
#   kernelspec: {display_name: Python 3, language: python, name: python3}
# ---

# %% [markdown]
# # Bending
#
# Bending is "much smaller but can be important". Smaller: for the fabric of trousers and
# $L=0.1$ m, the bending rigidity $B$ is $8\cdot10^{-7}$ of the membrane's $YL^2$. Important:
# bending bears the weight where the membrane cannot. The ratio of weight to bending is
#
# $$\Gamma=\rho gL^3/B$$
#
# with the areal density $\rho$. A strip that sticks out from a table sags by $L\,\Gamma/8$ if
# $\Gamma\ll1$, and hangs down if $\Gamma\gg1$. Without bending it hangs down at every length. The
# line is the elastica, $B\theta''=-\rho g(L-s)\cos\theta$, for large rotations.
#
# These trousers have $\Gamma=1$ at $L=24$ mm. At which length does a strip of your shirt hang down,
# and what is its $B$?
#
# <details><summary>Answer</summary>
#
# Let the strip hang until the line from the edge to its tip falls at 41.5°. Then $c=L/2$ is its
# bending length and $B=\rho gc^3$ (Peirce 1930). A shirt of 0.12 kg/m² with $L=35$ mm has
# $6\cdot10^{-6}$ N m.
#
# </details>

# %%
import matplotlib.pyplot as plt
import numpy as np
from scipy.integrate import solve_bvp

import fecloth as fc
from fecloth.study.figures import STYLE, line_style

fabric = fc.Fabric.preset("trousers")
(B, _), weight = fabric.bending_rigidity, 9.81 * fabric.areal_density  # [N m], [N/m²]


def sag(L):  # of a strip of length L [m], over L
    cloth = fc.Cloth.rectangle(L, L / 4, h=L / 16, pattern="right")
    terms = [fc.StVK(), fc.PlateBending(), fc.Gravity()]
    system = fc.System(cloth, fabric, terms, [fc.Pin("left", clamp=True)])
    state = fc.equilibrium(system, system.rest())
    return -state.x[cloth.nodes("right"), 2].mean() / L


lengths = np.array([0.01, 0.02, 0.03, 0.05, 0.08, 0.12, 0.2])  # [m]
gamma, sags = weight * lengths**3 / B, np.array([sag(L) for L in lengths])


# %%
def elastica(gamma):  # the sag over L; y = θ, θ′ L and z/L over s/L
    s = np.linspace(0, 1, 101)
    slope = lambda s, y: [y[1], -gamma * (1 - s) * np.cos(y[0]), np.sin(y[0])]  # noqa: E731
    ends = lambda a, b: [a[0], b[1], a[2]]  # noqa: E731
    guess = np.minimum(gamma / 6, 1.4) * np.array([1 - np.exp(-5 * s), 5 * np.exp(-5 * s), s])
    return solve_bvp(slope, ends, s, guess, tol=1e-6).sol(1)[2]


plt.style.use(STYLE)
fig, ax = plt.subplots(figsize=(9, 5), layout="constrained")
grid = np.geomspace(gamma[0], gamma[-1], 50)
ax.loglog(grid, [elastica(number) for number in grid], "k-", lw=1, label="elastica")
ax.loglog(grid[grid < 8], grid[grid < 8] / 8, "k:", label=r"$\Gamma/8$")
ax.axhline(1, color="0.5", ls="--", label="without bending")
ax.loglog(gamma, sags, **line_style(0) | {"ls": ""}, label="strip of trousers, computed")
ax.set(xlabel=r"$\Gamma = \rho g L^3/B$ [-]", ylabel="sag over L [-]", ylim=(0.005, 1.6))
ax.legend(loc="lower right")
for L, at, height in zip(lengths, gamma, sags, strict=True):
    below = {"xytext": (6, -14), "textcoords": "offset points"}
    ax.annotate(f"{1000 * L:.0f} mm", (at, height), **below)

# %%
exact = np.array([elastica(number) for number in gamma])
assert np.allclose(sags, exact, rtol=0.012)
assert np.isclose(sags[0], gamma[0] / 8, rtol=0.005)
assert 0.97 < sags[-1] < 1
assert np.isclose(elastica(1e-3), 1e-3 / 8, rtol=1e-5)
assert np.isclose((B / weight) ** (1 / 3), 0.024, atol=5e-4)
assert np.isclose(B / (fabric.tensile[0] * 0.1**2), 8e-7, rtol=0.05)
cloth = fc.Cloth.rectangle(0.02, 0.005, h=0.00125, pattern="right")
soft = fc.System(cloth, fabric, [fc.StVK(), fc.Gravity()], pins=["left"])
hanging = fc.equilibrium(soft, soft.rest()).x[cloth.nodes("right"), 2]
assert np.allclose(hanging, -0.02, rtol=1e-3)  # without bending, also at 20 mm
