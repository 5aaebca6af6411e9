# ---
# jupyter:
#   jupytext:
#     text_representation: {extension: .py, format_name: percent}
#   kernelspec: {display_name: Python 3, language: python, name: python3}
# ---

# %% [markdown]
# # Springs
#
# Springs along the edges of a mesh are simple: $f = k\,(l - l_0)$. Which fabric are they?
#
# Strips are cut at an angle from two models of one fabric, $Y = 1000$ N/m and $\nu = 0.3$, and
# pulled. The elements have these two numbers in every direction, on every mesh.
#
# Springs (Van Gelder 1998) take their $k$ from $Y$. Where the springs of each node come in opposite
# pairs, $C_{12} = C_{33}$, whatever $k$ is. So a network that is the same in all directions has
# $\nu = 1/3$, as equilateral triangles have; no $k$ makes it 0.3. On squares with a diagonal a
# strip along it is three times as stiff as one across it.
#
# Does a finer mesh help?
#
# <details><summary>Answer</summary>
#
# No. The moduli depend on the directions of the springs, not on their length.
#
# </details>

# %%
import matplotlib.pyplot as plt
import numpy as np

import fecloth as fc
from fecloth.study.figures import COLOURS, STYLE

Y, nu = 1000.0, 0.3
fabric = fc.Fabric(areal_density=0.2, tensile_stiffness=Y, poisson_ratio=nu)
models = {"elements": fc.StVK(), "springs": fc.Springs(kind="van_gelder")}
cases = [(name, pattern) for name in models for pattern in ("right", "cross", "equilateral")]
C = {(name, mesh): fc.plane_moduli(models[name], fabric, mesh) for name, mesh in cases}


def pull(C, angle):  # stiffness and Poisson's ratio of a strip: stress (σ₁₁, σ₂₂, σ₁₂) = C ε
    c, s = np.cos(angle), np.sin(angle)
    along, across = np.array([c * c, s * s, c * s]), np.array([s * s, c * c, -c * s])
    strain = np.linalg.solve(C, along)  # a stress of 1 N/m along the strip
    return 1 / (along @ strain), -(across @ strain) / (along @ strain)


# %%
angles = np.radians(np.linspace(0, 180, 73))
strips = {case: np.array([pull(C[case], angle) for angle in angles]).T for case in cases}

plt.style.use(STYLE)
fig, (stiffness, ratio) = plt.subplots(1, 2, figsize=(11, 4.5), layout="constrained")
for i, ((name, mesh), (Y_strip, nu_strip)) in enumerate(strips.items()):
    dash = {"right": "-", "cross": "--", "equilateral": ":"}[mesh]
    look = {"color": COLOURS[i // 3], "ls": dash, "lw": 2.5}
    stiffness.plot(np.degrees(angles), Y_strip, label=f"{name}, {mesh}", **look)
    ratio.plot(np.degrees(angles), nu_strip, **look)
stiffness.set(xlabel="angle of the strip [°]", ylabel="tensile stiffness [N/m]", ylim=(0, None))
ratio.set(xlabel="angle of the strip [°]", ylabel="Poisson's ratio [-]", ylim=(-0.05, 1.05))
fig.legend(loc="outside right center")
for ax in (stiffness, ratio):
    ax.set_xticks(range(0, 181, 45))

# %%
for mesh in ("right", "cross", "equilateral"):
    assert np.allclose(strips["elements", mesh], [[Y], [nu]], rtol=1e-8)
    C_springs = C["springs", mesh]
    assert np.isclose(C_springs[0, 1], C_springs[2, 2], rtol=1e-8)
    assert not np.isclose(C_springs[0, 1], C["elements", mesh][0, 1], rtol=0.1)
assert np.allclose(strips["springs", "equilateral"], [[Y], [1 / 3]], rtol=1e-8)
assert np.allclose(4 * C["springs", "right"] / Y, [[5, 1, 1], [1, 5, 1], [1, 1, 1]], rtol=1e-8)
along, across = (pull(C["springs", "right"], np.radians(angle))[0] for angle in (45, 135))
assert np.isclose(along / across, 3, rtol=1e-8)
print("stiffness of springs at 0, 45, 90, 135°", strips["springs", "right"][0, :72:18].round(1))
