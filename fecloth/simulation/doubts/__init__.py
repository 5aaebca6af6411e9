"""Doubts about a run: warnings before its first step, and what they look at."""
