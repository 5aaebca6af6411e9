"""Engines side by side on the cases of `fecloth bench`."""
