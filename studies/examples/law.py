"""A membrane law of a user: a fabric that stiffens exponentially with its strain.

    W = c/2 (exp Q − 1),   Q = E:ℂ₀:E / c,   c = ε² C₁₁
    S = exp(Q) T,   ℂ = exp(Q) (ℂ₀ + 2/c T ⊗ T),   T = ℂ₀:E

At small strain the moduli are ℂ₀ of the fabric. At the strain ε along the warp alone the
stress is e times the stress of `StVK`. W is convex in E. The form is from Fung, Fronek and
Patitucci (1979), Pseudoelasticity of arteries and the choice of its mathematical expression, Am. J.
Physiol. 237, H620–H631; its constants are the moduli of the fabric and ε.
"""

import math
from dataclasses import dataclass

import fecloth as fc
from fecloth.terms.loops.green_strain import contract


@dataclass(frozen=True)
class Fung(fc.MembraneLaw):
    strain: float = 0.2  # ε

    def constants(self, fabric):
        C = fabric.moduli()
        return [*C, self.strain**2 * C[0]]

    @staticmethod
    def law(E, c):
        T = contract((c[0], c[1], c[2], c[3], c[4], c[5]), E)
        Q = (T[0] * E[0] + T[1] * E[1] + 2 * T[2] * E[2]) / c[6]
        s = math.exp(Q)
        d = 2 * s / c[6]
        C = (
            s * c[0] + d * T[0] ** 2,
            s * c[1] + d * T[1] ** 2,
            s * c[2] + d * T[2] ** 2,
            s * c[3] + d * T[0] * T[1],
            s * c[4] + d * T[0] * T[2],
            s * c[5] + d * T[1] * T[2],
        )
        return 0.5 * c[6] * (s - 1), (s * T[0], s * T[1], s * T[2]), C


def pull(law, stretch):
    """Return the force per width of a cloth at this stretch along the warp [N/m]."""
    cloth = fc.Cloth.rectangle(1.0, 0.5, h=0.1)
    system = fc.System(cloth, fc.Fabric(0.2, 1000.0), [law])
    f = system.force(system.state(system.rest().x * [stretch, 1, 1]))
    return -f[cloth.nodes("right"), 0].sum() / 0.5


if __name__ == "__main__":
    fc.verify.check_term(Fung())
    for stretch in (1.02, 1.1, 1.2, 1.3):
        print(f"stretch {stretch}: {pull(Fung(), stretch):7.1f} N/m", end=", ")
        print(f"with StVK {pull(fc.StVK(), stretch):5.1f} N/m")
