"""Bending on hinges, the edges between two triangles."""
