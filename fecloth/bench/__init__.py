"""Cases with known answers, stated without any solver, and solvers compared on them."""
