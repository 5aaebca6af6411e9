# ---
# jupyter:
#   jupytext:
#     text_representation: {extension: .py, format_name: percent}
#   kernelspec: {display_name: Python 3, language: python, name: python3}
# ---

# %% [markdown]
# # Conditions C(x)
#
# A condition $C(x)=0$ says what the cloth should do, such as keep its lengths. The energy
# $\tfrac k2C^2$ has the force $-kC\,\partial C$ with $\partial C=\partial C/\partial x$. The
# lecture calls conditions a "numerical device, not physics". A sheet that hangs from its top edge
# shows why.
#
# As published (Baraff and Witkin 1998), a triangle of area $a$ has $C=a(|w|-1)$ with the stretch
# $|w|$ of warp or weft. The sheet's energy is then proportional to $a$: on finer meshes, $h\to0$,
# the sheet loses its stiffness. With $C=F^TF-I$ (slide 11) and the energy $a\tfrac k2C:C$ the
# answer stays: $4k$ is the $Y$ of a fabric.
#
# As $k\to\infty$ both reach $C=0$, and explicit steps shrink as $1/\sqrt k$. Which power of $a$
# would make the published condition a fabric?
#
# <details><summary>Answer</summary>
#
# $C=\sqrt a\,(|w|-1)$: then the energy is proportional to the area, as a fabric's is.
#
# </details>

# %%
import matplotlib.pyplot as plt
import numpy as np

import fecloth as fc
from fecloth.study.figures import STYLE, line_style

fabric = fc.Fabric(areal_density=0.2, tensile_stiffness=1000.0)  # conditions have their own k


def hang(condition, h):
    cloth = fc.Cloth.rectangle(0.5, 1.0, h=h, pattern="right")
    system = fc.System(cloth, fabric, [condition, fc.Gravity((0, -9.81, 0))], pins=["top"])
    state = fc.equilibrium(system, system.rest())
    elongation = -state.x[cloth.nodes("bottom"), 1].mean()
    return elongation, fc.critical_dt(system, state, fc.CentralDifference())


def published(k):  # k [N/m³]: C has the unit m²
    return fc.BaraffWitkin(stretch=(k, k), shear=k, area_exponent=1.0)


h, k = np.array([1 / 4, 1 / 8, 1 / 16, 1 / 32]), np.array([100.0, 1e3, 1e4, 1e5])
refined = [hang(fc.TensorCondition(250.0), size)[0] for size in h]
refined_published = [hang(published(1e6), size)[0] for size in h]
stiffened, steps = np.transpose([hang(fc.TensorCondition(stiffness), 1 / 8) for stiffness in k])
stiffened_published = [hang(published(1e3 * stiffness), 1 / 8)[0] for stiffness in k]

# %%
weight = 0.2 * 9.81  # [N/m²]; the sheet is 1 m long
plt.style.use(STYLE)
fig, (over_h, over_k) = plt.subplots(1, 2, figsize=(10, 4.5), layout="constrained")
over_h.loglog(h, refined_published, **line_style(1), label=r"published, $k = 10^6$ N/m³")
over_h.loglog(h, weight / (1e6 * h**2), "k:", label=r"$\rho g L^2/(k h^2)$")
over_h.loglog(h, refined, **line_style(0), label=r"$F^TF - I$, $k = 250$ N/m")
over_h.axhline(weight / (8 * 250), color="k", ls="--", label=r"$\rho g L^2/(2 \cdot 4k)$")
over_h.set(xlabel="edge length h [m]", ylabel="the sheet's elongation [m]", title="finer meshes")
over_h.set_xticks(h, [f"1/{1 / size:.0f}" for size in h])
over_h.minorticks_off()
over_k.loglog(k, stiffened_published, **line_style(1), label="elongation [m], published")
over_k.loglog(k, stiffened, **line_style(0), label=r"elongation [m], $F^TF - I$")
over_k.loglog(k, steps, **line_style(2), label="largest explicit step [s]")
over_k.set(xlabel="k [N/m], published: k/1000 [N/m³]", title="stiffer, at h = 1/8 m")
for ax in (over_h, over_k):
    ax.legend()

# %%
assert np.allclose(refined_published, weight / (1e6 * h**2), rtol=2e-3)  # a = h²/2
assert np.ptp(refined) < 1e-3 * refined[-1]  # the mesh does not matter
assert np.isclose(refined[-1], weight / (8 * 250), rtol=5e-3)  # small strains: ρ g L²/(2 Y)
ten_times = k[1:] / k[:-1]
assert np.allclose(stiffened[:-1], ten_times * stiffened[1:], rtol=0.01)
assert np.allclose(stiffened_published[:-1], ten_times * stiffened_published[1:], rtol=1e-3)
assert np.allclose(steps[:-1], np.sqrt(ten_times) * steps[1:], rtol=0.02)
