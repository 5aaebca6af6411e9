"""A term of a user: springs that pull each point of the cloth to the plane z = 0.

    U = ½ k ∫ z² dA,   f_a = −k A_a z_a,   K_aa = k A_a e_z e_zᵀ

with the stiffness k [N/m³] of a foundation of Winkler (1867), Die Lehre von der Elasticität und
Festigkeit, and the areas A_a of the nodes. A taut cloth on such a foundation, pinned at X = 0 and
X = L, sinks under its own weight by

    z = −(ρ g/k) (1 − cosh((X − L/2)/ℓ) / cosh(L/(2ℓ))),   ℓ = √(S/k)

with its stress S along X. Farther than a few ℓ from the edges the edges have no influence.
"""

from dataclasses import dataclass

import numpy as np

import fecloth as fc


@dataclass(frozen=True)
class Winkler:
    k: float

    def stencil(self, cloth):
        return None  # couples no two nodes

    def bind(self, panel, slots):
        nodes = np.arange(len(panel.cloth.X), dtype=np.int32)
        return BoundWinkler(self.k * panel.cloth.load(), slots(nodes[:, None]).ravel())


@dataclass(frozen=True, eq=False)
class BoundWinkler(fc.BoundTerm):
    k: np.ndarray  # (n,) k A_a
    own: np.ndarray  # (n,) index of each node's diagonal block in the matrix
    name = "Winkler"
    symmetric = has_energy = True
    dissipative = velocity_dependent = False
    conserves = True  # the energy is quadratic in x

    def energy(self, x, t):
        return 0.5 * float(self.k @ x[:, 2] ** 2)

    def add_force(self, x, v, t, f):
        f[:, 2] -= self.k * x[:, 2]

    def add_tangent(self, x, v, t, wx, wv, J, definite):
        J.values[self.own, 2, 2] += wx * self.k


def sag(k, h=0.02, weight=1e-3):
    """Return z at the middle of a cloth stretched by a tenth, over ρ g/k."""
    cloth = fc.Cloth.rectangle(1.0, 0.1, h=h, pattern="right")
    loads = [fc.Gravity((0, 0, -weight)), Winkler(k)]
    system = fc.System(cloth, fc.Fabric(0.2, 1000.0), [fc.StVK(), *loads], ["left", "right"])
    x = fc.equilibrium(system, system.state(system.rest().x * [1.1, 1, 1])).x
    return x[cloth.nodes(lambda X: abs(X[:, 0] - 0.5) < 1e-9), 2].mean() / (0.2 * weight / k)


if __name__ == "__main__":
    fc.verify.check_term(Winkler(300.0))
    for k in (1e2, 1e3, 1e4, 1e5):
        exact = 1 / np.cosh(0.5 * np.sqrt(k / 105)) - 1  # S = Y E11 = 1000 (1.1² − 1)/2
        print(f"k = {k:8.0f} N/m³: sinks by {-sag(k):.5f} ρ g/k, by the formula {-exact:.5f}")
