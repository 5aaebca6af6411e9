# ---
# jupyter:
#   jupytext:
#     text_representation: {extension: .py, format_name: percent}
#   kernelspec: {display_name: Python 3, language: python, name: python3}
# ---

# %% [markdown]
# # The deformation tensor
#
# Two edges of a triangle are the columns of $D$ on the flat cloth (2 × 2) and of $d$ in space
# (3 × 2). Then $F=dD^{-1}$ and
#
# $$F^TF=D^{-T}(d^Td)D^{-1}.$$
#
# The Gram matrix $d^Td$ has the products of the edges, which are lengths and angles. So
# $C_2=F^TF-I_2$ does not change when the cloth turns. The entries of $C_3=FF^T-I_3$ turn with it.
# With the constant matrix $(D^TD)^{-1}=\mathrm{adj}(D^TD)/\det(D)^2$ of the flat triangle,
# $FF^T=d\,(D^TD)^{-1}d^T$. Yet both make the same force, since
#
# $$\|C_3\|^2=\|C_2\|^2+1,$$
#
# and a constant has no gradient. The 1 is from the direction across the cloth, where $FF^T$ is
# zero.
#
# Left are 100 random triangles, right one triangle that turns. Which of the two conditions would
# you compute with?
#
# <details><summary>Answer</summary>
#
# $C_2$: it has three different entries in place of six, and no turn of the cloth changes them.
#
# </details>

# %%
import matplotlib.pyplot as plt
import numpy as np

import fecloth as fc
from fecloth.study.figures import STYLE, line_style

D = np.array([[0.3, 0.1], [0.0, 0.2]])  # [m]
to_F = np.linalg.inv(D)


def conditions(d):  # C₂ and C₃ of the edges d (3, 2) in space [m]
    F, gram = d @ to_F, d.T @ d
    return to_F.T @ gram @ to_F - np.eye(2), F @ F.T - np.eye(3)


def turn(angle):  # about the axis z
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


rng = np.random.default_rng(11)
edges = [np.vstack([D, [0, 0]]) + rng.normal(0, 0.1, (3, 2)) for _ in range(100)]
norms = np.array([[np.sum(C**2) for C in conditions(d)] for d in edges])
angles = np.linspace(0, np.pi, 61)
turned = [conditions(turn(angle) @ edges[0]) for angle in angles]

# %%
plt.style.use(STYLE)
fig, (compare, over_angle) = plt.subplots(1, 2, figsize=(10, 4.5), layout="constrained")
compare.loglog(norms[:, 0], norms[:, 1], ".", label="random triangles")
range_ = np.geomspace(norms[:, 0].min(), norms[:, 0].max())
compare.loglog(range_, range_ + 1, "k:", label=r"$\|C_2\|^2+1$")
compare.set(xlabel=r"$\|C_2\|^2$ [-]", ylabel=r"$\|C_3\|^2$ [-]")
for i, (name, entry) in enumerate({"11": (0, 0), "22": (1, 1), "12": (0, 1)}.items()):
    for C, dash, which in zip(zip(*turned, strict=True), ("-", "--"), "23", strict=True):
        look = line_style(i) | {"ls": dash, "marker": ""}
        over_angle.plot(
            np.degrees(angles), [c[entry] for c in C], **look, label=f"$C_{which}$, entry {name}"
        )
over_angle.set(
    xlabel="angle of the turn [°]", ylabel="entry of the condition [-]", ylim=(-1.7, 1.05)
)
for ax, columns in ((compare, 1), (over_angle, 2)):
    ax.legend(ncols=columns)

# %%
(p, q), (_, r) = D.T @ D  # the constant matrix of the slide, by hand
constant = np.array([[r, -q], [-q, p]]) / np.linalg.det(D) ** 2
for d in edges:
    C2, C3 = conditions(d)
    assert np.allclose(d @ constant @ d.T - np.eye(3), C3, rtol=0, atol=1e-12)
    assert np.isclose(np.trace(constant @ d.T @ d), np.trace(C2) + 2, rtol=1e-12)
assert np.allclose(norms[:, 1], norms[:, 0] + 1, rtol=1e-13, atol=1e-13)
assert np.allclose([C2 for C2, _ in turned], turned[0][0], rtol=0, atol=1e-13)
for angle, (_, C3) in zip(angles, turned, strict=True):
    assert np.allclose(C3, turn(angle) @ turned[0][1] @ turn(angle).T, rtol=0, atol=1e-13)
k, area, e, d = 50.0, np.linalg.det(D) / 2, 1e-5, edges[0]
force = np.zeros((2, 3, 2))  # of the energies area k/2 ‖C‖², on the ends of both edges
for at in np.ndindex(3, 2):
    step = np.zeros((3, 2))
    step[at] = e
    for C_ahead, C_behind, f in zip(conditions(d + step), conditions(d - step), force, strict=True):
        f[at] = -area * k / 2 * (np.sum(C_ahead**2) - np.sum(C_behind**2)) / (2 * e)
cloth = fc.Cloth.from_arrays(np.vstack([[0, 0], D.T]), [[0, 1, 2]], renumber=False)
fabric = fc.Fabric(areal_density=0.2, tensile_stiffness=1.0)  # the condition has its own k
system = fc.System(cloth, fabric, [fc.TensorCondition(k)])
expected = system.force(system.state(np.vstack([np.zeros(3), d.T])))[1:].T
assert np.allclose(force, expected, rtol=1e-6, atol=1e-6 * np.abs(expected).max())
