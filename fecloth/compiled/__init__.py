"""Compilation by Numba, calls of kernels without Python between them, and threads."""
