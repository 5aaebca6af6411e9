"""Pins, constraints, states, and the assembled operators of a cloth."""
