"""Matrices of 3 × 3 blocks and the solution of linear systems. Nothing here knows of cloth."""
