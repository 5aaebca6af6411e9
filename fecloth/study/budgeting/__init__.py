"""`budget`: one uncertainty of mesh, step, solver, constants, start and measurement."""
