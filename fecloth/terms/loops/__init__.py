"""Compiled loops over triangles and stencils that all terms share, and their bound terms."""
