"""Rows of a study of two methods, one of which fails once."""

from __future__ import annotations


def rows_of_two():
    right = [
        {"method": m, "dt": dt, "error": c * dt, "status": "ok", "cause": "", "path": [1, 2]}
        for m, c in (("A", 1.0), ("B", 2.0))
        for dt in (0.1, 0.2)
    ]
    bad = {"method": "B", "dt": 0.4, "status": "failed", "cause": "StepFailed: a|b\nmore"}
    return [*right, bad]
