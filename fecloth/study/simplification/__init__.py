"""`simplify`: which terms, triangles and steps a scene does not need."""
