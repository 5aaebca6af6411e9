"""Independent forms of the membrane, written in scikit-fem, for the compiled loop to meet."""

from __future__ import annotations

import numpy as np
import skfem
from skfem.helpers import ddot, grad, transpose


def _space(cloth):
    shapes, order = {"P1": (skfem.ElementTriP1(), 1), "P2": (skfem.ElementTriP2(), 4)}[
        cloth.element
    ]
    return skfem.Basis(cloth.mesh, skfem.ElementVector(shapes, dim=3), intorder=order)


def fourth_order(moduli):
    """(2, 2, 2, 2) tensor of (C11, C22, C66, C12, C16, C26)."""
    C11, C22, C66, C12, C16, C26 = moduli
    C = np.zeros((2, 2, 2, 2))
    C[0, 0, 0, 0], C[1, 1, 1, 1] = C11, C22
    C[0, 0, 1, 1] = C[1, 1, 0, 0] = C12
    for i, j in ((0, 1), (1, 0)):
        for k, l in ((0, 1), (1, 0)):
            C[i, j, k, l] = C66
        C[0, 0, i, j] = C[i, j, 0, 0] = C16
        C[1, 1, i, j] = C[i, j, 1, 1] = C26
    return C


def _product(A, B):
    return np.einsum("ij...,jk...->ik...", A, B)


def _strain(F):
    E = 0.5 * _product(transpose(F), F)
    E[0, 0] -= 0.5
    E[1, 1] -= 0.5
    return E


def _stress(C, E):
    return np.einsum("ijkl,kl...->ij...", C, E)


def dofs(x):
    """Node-major dof vector of positions (n, 3); scikit-fem orders its vector dofs likewise."""
    return np.ascontiguousarray(x).ravel()


def energy(cloth, moduli, x) -> float:
    """∫ ½ E:ℂ:E dA."""
    basis, C = _space(cloth), fourth_order(moduli)

    def density(w):
        E = _strain(grad(w["x"]))
        return 0.5 * ddot(E, _stress(C, E))

    return skfem.Functional(density).assemble(basis, x=basis.interpolate(dofs(x)))


def force(cloth, moduli, x) -> np.ndarray:
    """(n, 3), −∫ F S : ∇δx dA."""
    basis, C = _space(cloth), fourth_order(moduli)

    def form(v, w):
        F = grad(w["x"])
        return ddot(_product(F, _stress(C, _strain(F))), grad(v))

    return -skfem.LinearForm(form).assemble(basis, x=basis.interpolate(dofs(x))).reshape(-1, 3)


def stiffness(cloth, moduli, x):
    """(3n, 3n), ∫ (δE : ℂ : ΔE + S : (∇δxᵀ ∇Δx)) dA."""
    basis, C = _space(cloth), fourth_order(moduli)

    def form(u, v, w):
        F, dU, dV = grad(w["x"]), grad(u), grad(v)
        S = _stress(C, _strain(F))
        EU = 0.5 * (_product(transpose(F), dU) + _product(transpose(dU), F))
        EV = 0.5 * (_product(transpose(F), dV) + _product(transpose(dV), F))
        return ddot(EV, _stress(C, EU)) + ddot(S, _product(transpose(dV), dU))

    return skfem.BilinearForm(form).assemble(basis, x=basis.interpolate(dofs(x)))


def viscous_force(cloth, moduli, x, v) -> np.ndarray:
    """(n, 3), −∫ F (τℂ : sym(FᵀḞ)) : ∇δx dA, `moduli` = τℂ."""
    basis, C = _space(cloth), fourth_order(moduli)

    def form(test, w):
        F, rate = grad(w["x"]), grad(w["v"])
        Edot = 0.5 * (_product(transpose(F), rate) + _product(transpose(rate), F))
        return ddot(_product(F, _stress(C, Edot)), grad(test))

    fields = {"x": basis.interpolate(dofs(x)), "v": basis.interpolate(dofs(v))}
    return -skfem.LinearForm(form).assemble(basis, **fields).reshape(-1, 3)
