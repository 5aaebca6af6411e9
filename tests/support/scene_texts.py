"""Texts of scenes that tests of several studies share."""

# a string that is taut between two ends and swings
STRING = """
cloth = { shape = "rectangle", width = 1.0, height = 0.25, h = 0.125, pattern = "right" }
fabric = { areal_density = 0.2, tensile_stiffness = 100.0 }
terms = [{ type = "StVK" }]
pins = [{ where = "left" }, { where = "right" }]
start = { position = ["1.1 * X", "Y", "0"], velocity = ["0", "0", "sin(pi * X)"] }
time = { method = "implicit_midpoint", dt = 0.01, t_end = 0.1 }
probes = [{ name = "middle", point = [0.5, 0.125] }]
"""

# a strip that hangs from its left end, at rest
STRIP = """
cloth = { shape = "rectangle", width = 1.0, height = 0.25, h = 0.125, pattern = "right" }
fabric = { areal_density = 0.2, tensile_stiffness = 20.0 }
terms = [{ type = "StVK" }, { type = "Gravity", acceleration = [9.81, 0, 0] }]
pins = [{ where = "left" }]
equilibrium = {}
probes = [{ name = "tip", where = "right" }]
interest = { end = ["tip.x"] }
"""
