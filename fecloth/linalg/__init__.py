"""Matrices of 3 × 3 blocks and the solution of linear systems, independent of cloth."""
