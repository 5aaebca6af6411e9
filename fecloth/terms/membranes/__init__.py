"""Membrane laws: energy, stress and tangent as functions of the Green strain."""
