# ---
# jupyter:
#   jupytext:
#     text_representation: {extension: .py, format_name: percent}
#   kernelspec: {display_name: Python 3, language: python, name: python3}
# ---

# %% [markdown]
# # Constraints at points
#
# A pin prescribes where a node is. It is no force: it removes equations. Every node has a projector
# $P$ (3 × 3) onto its free directions: $0$ in a pin, $ss^T$ on a rail along $s$, $I-nn^T$ in a
# plane of normal $n$. Newton's method solves
#
# $$(PKP+I-P)\,\Delta x=Pf.$$
#
# In the held directions this says $\Delta x=0$; a moved pin has its new place from the start. What
# the removed equations lack is the reaction, $r=-(I-P)f$. In equilibrium it balances all loads.
#
# A curtain hangs from a rail. One corner is pinned, its right edge drawn away by 6 cm. All nodes
# stay in the plane $z=0$. Arrows are reactions. Why have those at the rail no horizontal part?
#
# <details><summary>Answer</summary>
#
# $r=-(I-P)f$, and $I-P$ is zero along the rail: there the nodes slide until no force is left.
#
# </details>

# %%
import matplotlib.pyplot as plt
import numpy as np
import scipy.sparse as sparse
from scipy.sparse.linalg import spsolve

import fecloth as fc
from fecloth.study.figures import COLOURS, STYLE

cloth = fc.Cloth.rectangle(0.6, 0.6, h=0.1)
fabric = fc.Fabric(areal_density=0.2, tensile_stiffness=20.0, poisson_ratio=0.3)
system = fc.System(cloth, fabric, [fc.StVK(), fc.Gravity((0, -9.81, 0))])  # without pins

each = np.tile(np.diag([1.0, 1.0, 0.0]), (len(cloth.X), 1, 1))  # (n, 3, 3), in the plane z = 0
each[cloth.nodes("top")] = np.diag([1, 0, 0])  # on the rail
each[cloth.nodes("right")] = each[np.argmin(cloth.X @ [1, -1])] = 0  # pinned
P = sparse.block_diag(each).tocsr()
held = sparse.identity(P.shape[0]) - P
x = system.rest().x + np.outer(cloth.X[:, 0] > 0.599, [0.06, 0, 0])  # moved
for _ in range(8):
    state = system.state(x)
    f, K = system.force(state).ravel(), system.stiffness(state)
    x = x + spsolve((P @ K @ P + held).tocsc(), P @ f).reshape(-1, 3)
reaction = -(held @ system.force(system.state(x)).ravel()).reshape(-1, 3)

# %%
plt.style.use(STYLE)
fig, ax = plt.subplots(figsize=(8, 5.5), layout="constrained")
ax.triplot(*cloth.X.T, cloth.triangles, color="0.8", lw=0.8)
ax.triplot(*x[:, :2].T, cloth.triangles, color=COLOURS[0], lw=1.2)
ax.set(xlabel="x [m]", ylabel="y [m]", aspect="equal", xlim=(-0.3, 1.05), ylim=(-0.05, 0.75))
rank = np.trace(each, axis1=1, axis2=2)
for name, of_rank, marker in (("pinned", 0, "s"), ("on the rail", 1, "o")):
    at = rank == of_rank
    ax.plot(*x[at, :2].T, marker, color=COLOURS[1 + of_rank], label=name)
    ax.legend(loc="center right", bbox_to_anchor=(1, 0.7))
    arrows = ax.quiver(*x[at, :2].T, *reaction[at, :2].T, scale=2.6, width=0.005, zorder=3)
key = ax.quiverkey(arrows, 0.92, 0.45, 0.2, "0.2 N", labelpos="N")

# %%
weight = fabric.areal_density * cloth.area * 9.81
assert np.allclose(reaction.sum(axis=0), (0, weight, 0), atol=1e-9)
assert np.linalg.norm(P @ system.force(system.state(x)).ravel()) < 1e-9
rail, free = np.flatnonzero(rank == 1), np.flatnonzero(rank == 2)
assert np.all(reaction[rail, 0] == 0)
assert np.all(reaction[free] == 0)
assert np.all(reaction[rail, 1] != 0)
pins = [
    fc.Pin([np.argmin(cloth.X @ [1, -1])]),
    fc.Pin("right", motion=("0.06 * t", "0", "0")),
    fc.Slide(rail, direction=(1, 0, 0)),
    fc.Slide(free, normal=(0, 0, 1)),
]
same = fc.System(cloth, fabric, system.terms, pins)
rest = fc.equilibrium(same, same.rest(), load_steps=1)
assert np.allclose(rest.x, x, rtol=0, atol=1e-8)
