"""The stage equation of an implicit step, Newton's method, and static equilibrium."""
