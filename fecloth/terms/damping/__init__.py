"""Damping forces."""
