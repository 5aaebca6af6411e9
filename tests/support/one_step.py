"""A step of Newmark's and the generalised-α method on a linear system, as their equations read."""

import numpy as np


def newmark(beta, gamma, am=0.0, af=0.0):
    """The matrix of a step of (x, v, a) with M x'' + D x' + K x = 0, by solving for all of them."""

    def step(K, D, M, dt):
        K, D, M = map(np.atleast_2d, (K, D, M))
        one, nil = np.eye(len(M)), 0 * M
        new = [
            [one, nil, -beta * dt**2 * one],
            [nil, one, -gamma * dt * one],
            [(1 - af) * K, (1 - af) * D, (1 - am) * M],
        ]
        old = [
            [one, dt * one, (0.5 - beta) * dt**2 * one],
            [nil, one, (1 - gamma) * dt * one],
            [-af * K, -af * D, -am * M],
        ]
        return np.linalg.solve(np.block(new), np.block(old))

    return step


def generalized_alpha(rho):
    """Chung and Hulbert's parameters."""
    am, af = (2 * rho - 1) / (rho + 1), rho / (rho + 1)
    return newmark(0.25 * (1 - am + af) ** 2, 0.5 - am + af, am, af)
