"""Forces from outside: gravity, pressure, air, points."""
