"""Bias extension of a glass weave."""
