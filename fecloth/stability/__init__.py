"""Stability: the largest stable step, and the amplification of one step."""

from fecloth.stability.amplification_matrix import amplification
from fecloth.stability.critical_step import critical_dt, element_bound, rate_bounds
from fecloth.stability.lanczos_estimate import estimate

__all__ = ["amplification", "critical_dt", "element_bound", "estimate", "rate_bounds"]
