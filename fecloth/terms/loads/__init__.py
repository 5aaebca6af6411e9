"""External loads: gravity, pressure, gas, drag and wind, forces on points."""
