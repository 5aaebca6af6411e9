"""The constants of a fabric, published fabrics, instruments, and which fabric lies where."""
